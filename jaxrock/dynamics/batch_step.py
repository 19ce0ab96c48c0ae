"""Many blocks side by side, each at its own pace through a ground motion.

Every lane takes a step at a time by a Taylor polynomial: as long as its last terms allow, to a
corner of the input at most, or to the impact, which is a root of that polynomial. A block at
rest goes to the next time that might lift it. What a lane does depends on no other.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..impact import velocity_after_impact
from ..resonance import Linearized, RockingModel
from ..validation import Booleans
from .batch_input import PulseInput, RecordInput, negligible
from .equation import Equation
from .overturning_criterion import TOPPLED_ROTATION
from .taylor import (
    Coefficients,
    binary_logarithm,
    binary_power,
    derivative,
    evaluate,
    materialized,
    rotation_series,
)

# Longest part of a step times the fastest rate: on it, the rotation is close to a parabola.
_LONGEST = 0.45


class Case(NamedTuple):
    """What follows from the arguments once for all steps. Times are in units of `unit`."""

    equation: Equation
    on_ground: tuple[Any, Any]  # sine and cosine of the tilt on the ground
    unit: Any  # of time
    longest: Any  # part of a step behind the end of the input
    restitution: Any
    strength: Any  # factor over g
    length: Any  # of an interval
    rate: Any  # of the phase of the input
    start: Any
    duration: Any
    first: Any  # interval of the motion
    trail: Any  # of intervals that might lift the block
    uplifts: tuple[Any, ...]  # times at which a pulse might, and to which side
    finite: Any  # whether the motion is

    @classmethod
    def of(
        cls, ground: PulseInput | RecordInput, arguments: tuple[Any, ...], model: RockingModel
    ) -> "Case":
        """The case of the arguments of `respond_batch`, elementwise.

        `factor` is on the motion (its amplitude or scale), `length` that of an interval, `motion`
        the index where there are several.
        """
        block, restitution, factor, length, start, duration, motion = arguments
        motion = motion.astype(jnp.int32)
        equation = Equation.of(block, model)
        angle, strength = equation.critical_angle, factor / equation.gravity
        rate = ground.rate(length)
        natural = fastest = jnp.sqrt(equation.p_squared)
        if isinstance(ground, PulseInput):
            fastest = jnp.maximum(fastest, jnp.abs(rate))
        # The unit is arbitrary, so that no derivative depends on it.
        unit = jax.lax.stop_gradient(1 / fastest)
        equation = eqx.tree_at(
            lambda e: (e.p_squared, e.critical_velocity),
            equation,
            (equation.p_squared * unit * unit, equation.critical_velocity * unit),
        )
        needed = equation.tangent / jnp.abs(strength)
        rate = rate * unit
        # By rounding alone no block is lifted, as in `uplift`.
        uplifts = ground.uplifts(rate, needed * (1 + negligible(rate.dtype)))
        if ground.vertical:
            needed = needed / (1 + equation.tangent)
        pulse = isinstance(ground, PulseInput)
        return cls(
            equation=equation,
            on_ground=(angle, jnp.ones_like(angle))
            if isinstance(model, Linearized)
            else (jnp.sin(angle), jnp.cos(angle)),
            unit=unit,
            longest=_LONGEST / (natural * unit),
            restitution=restitution,
            strength=strength,
            length=length / unit,
            rate=rate,
            start=start / unit,
            duration=duration / unit,
            first=motion * (0 if pulse else ground.room),
            trail=ground.trail(motion, needed),
            uplifts=uplifts,
            finite=jnp.isfinite(strength) if pulse else ground.finite[motion],
        )

    def for_steps(self) -> "Case":
        """What the steps need of it."""
        equation = eqx.tree_at(lambda e: e.gravity, self.equation, None)
        return self._replace(equation=equation, unit=None, finite=None)

    def valid(self) -> Booleans:
        """Whether all arguments are allowed."""
        equation, restitution = self.equation, self.restitution
        total = equation.p_squared + equation.tangent + self.strength + self.start
        finite = jnp.isfinite(total + restitution + self.length + self.duration) & self.finite
        positive = (equation.p_squared > 0) & (self.length > 0) & (self.duration > 0)
        return finite & positive & (self.start >= 0) & (restitution >= 0) & (restitution <= 1)


class Lanes(NamedTuple):
    """Where the blocks are."""

    interval: Any
    along: Any  # time in the interval
    side: Any
    rotation: Any
    velocity: Any
    reach: Any  # longest step
    moves: Any
    peak: Any
    impacts: Any
    steps: Any  # in motion
    end_rotation: Any  # at the end of the input, or now if that is earlier
    end_velocity: Any

    @classmethod
    def at_rest(cls, interval: Any, dtype: Any) -> "Lanes":
        """Blocks that have not moved, in an interval."""
        zero, count = jnp.zeros(interval.shape, dtype), jnp.zeros_like(interval)
        fields = dict.fromkeys(cls._fields, zero) | dict.fromkeys(("impacts", "steps"), count)
        fields |= {"interval": interval, "side": zero + 1, "reach": zero + jnp.inf}
        return cls(**fields | {"moves": jnp.zeros(interval.shape, bool)})

    def active(self, ground: PulseInput | RecordInput) -> Booleans:
        """Whether the motion goes on."""
        return self.moves | (self.interval < ground.intervals)


def max_steps(ground: PulseInput | RecordInput) -> Any:
    """Largest number of steps of a lane, which bounds the time; reported where it is reached."""
    return 1000 * jnp.minimum(ground.intervals, 2 * 10**6) + 10**6


def _accurate(path: Any, tolerance: Any) -> Any:
    """The longest step in which the last two terms are small beside the largest of the first.

    Jorba and Zou's rule, but relative to the motion in the step: right after uplift its third
    power is the whole motion.
    """
    order = len(path) - 1
    log = [binary_logarithm(part) for part in jax.lax.stop_gradient(path)]
    allowed = jnp.log2(tolerance).astype(jnp.float32)

    def length(last: int) -> Any:
        terms = ((log[k] - log[last] + allowed) * (1 / (last - k)) for k in range(min(4, last - 1)))
        return jax.tree.reduce(jnp.maximum, list(terms))

    return binary_power(jnp.minimum(length(order), length(order - 1)), path[0].dtype)


class _Piece(NamedTuple):
    """A part of a step, or what of it comes before the impact."""

    start: Any
    end: Any
    rotation: Any
    end_rotation: Any
    slope: Any
    end_slope: Any

    def until(self, time: Any, rotation: Any, slope: Any) -> "_Piece":
        """The piece up to a time, if that is in it."""
        ends = (self.end, self.end_rotation, self.end_slope)
        cut = [
            jnp.where(time < self.end, new, old)
            for new, old in zip((time, rotation, slope), ends, strict=True)
        ]
        return self._replace(end=cut[0], end_rotation=cut[1], end_slope=cut[2])


class _Parts(NamedTuple):
    """A step in parts of equal length."""

    part: Any  # their length
    times: list[Any]
    rotations: list[Any]
    slopes: list[Any]

    @classmethod
    def of(cls, path: Coefficients, slope: Coefficients, step: Any, parts: int) -> "_Parts":
        part = step * (1 / parts)
        times = [k * part for k in range(1, parts)] + [step]
        rotations = materialized([evaluate(path, time) for time in times])
        slopes = materialized([evaluate(slope, time) for time in times])
        start = jnp.zeros_like(step)
        return cls(part, [start, *times], [path[0], *rotations], [slope[0], *slopes])

    def piece(self, number: Any) -> _Piece:
        """The part of a number."""
        ends = (self.times, self.rotations, self.slopes)
        chosen = [_chosen(number, end[k : len(end) - 1 + k]) for end in ends for k in (0, 1)]
        return _Piece(*chosen)

    def bounds(self, k: int) -> tuple[Any, Any]:
        """Between which the cubic through both ends of a part is."""
        third = self.part * (1 / 3)
        left, right = self.rotations[k], self.rotations[k + 1]
        near, far = left + third * self.slopes[k], right - third * self.slopes[k + 1]
        low = jnp.minimum(jnp.minimum(left, right), jnp.minimum(near, far))
        return low, jnp.maximum(jnp.maximum(left, right), jnp.maximum(near, far))


def _chosen(index: Any, values: list[Any]) -> Any:
    """The values at an index, by comparisons, which run on SIMD lanes."""
    chosen = values[-1]
    for k in reversed(range(len(values) - 1)):
        chosen = jnp.where(index == k, values[k], chosen)
    return chosen


def _extreme(slope: Coefficients, piece: _Piece, sign: float, newtons: int) -> Any:
    """When a rotation is highest (sign 1) or lowest (-1) in a piece; its end if never.

    From the parabola that the slope of a cubic is, and Newton's method. Only its last step has a
    derivative, which the second derivative of the extreme value needs.
    """
    changing = slope
    slope, piece = jax.lax.stop_gradient((slope, piece))
    start, width = piece.start, piece.end - piece.start
    mean = (piece.end_rotation - piece.rotation) / jnp.where(width > 0, width, 1)
    a = sign * piece.slope
    b = sign * (3 * mean - 2 * piece.slope - piece.end_slope)
    c = sign * 3 * (piece.slope + piece.end_slope - 2 * mean)
    square, up = b * b - a * c, b > 0
    root = jnp.sqrt(jnp.maximum(square, 0))
    # -(root + b) / c, without cancellation
    above, below = jnp.where(up, -(root + b), a), jnp.where(up, c, root - b)
    share = above / jnp.where(below == 0, 1, below)
    inside = (square > 0) & (below != 0) & (share > 0) & (share < 1)
    time = materialized(jnp.where(inside, start + share * width, piece.end))
    bend = derivative(slope)
    for k in range(newtons):
        value = evaluate(changing if k == newtons - 1 else slope, time)
        curved = evaluate(bend, time)
        better = time - value / jnp.where(curved == 0, 1, curved)
        inside = inside & (better > start) & (better < piece.end)
        time = materialized(jnp.where(inside, better, time))
    return time


def _landing(
    path: Coefficients, slope: Coefficients, start: Any, parabola: Any, latest: Any
) -> tuple[Any, Booleans]:
    """When a rotation falls through 0 that is negative at `latest`, and whether that was located.

    By Halley's method from the root of a parabola. One more step shows whether that was enough,
    and gives the time its derivatives.
    """
    a, b, c = parabola
    bend = derivative(slope)
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    time = start + jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    inside = (below > 0) & (time > start) & (time < latest)
    time = materialized(jnp.where(inside, time, 0.5 * (start + latest)))
    for _ in range(2):
        value, steep, bent = (evaluate(each, time) for each in (path, slope, bend))
        below = steep * steep - 0.5 * value * bent
        time = materialized(time - value * steep / jnp.where(below > 0, below, jnp.inf))
    before = jax.lax.stop_gradient(time)
    steep, bent = materialized((evaluate(slope, before), evaluate(bend, before)))
    below = jnp.where(steep < 0, steep, -1)
    off = evaluate(path, before) / below
    # The square matters only in the second derivative of the time.
    time = materialized(before - off - 0.5 * off * off * bent / below)
    near = jnp.abs(time - before) <= float(jnp.finfo(time.dtype).eps) ** 0.5 * time
    return time, near & (steep < 0) & (time > start) & (time <= latest)


class _Flight(NamedTuple):
    """What a block in motion does in a step."""

    time: Any  # until its impact or the end of the step
    rotation: Any  # then
    velocity: Any  # then, before the impact
    highest: Any  # rotation
    lands: Any
    blocked: Any  # whether it lands at a time that was not located
    latest: Any  # time at which it would be below the ground

    @classmethod
    def of(cls, path: Coefficients, step: Any, parts: int, moves: Any) -> "_Flight":
        """The flight on a polynomial, up to a time."""
        slope = derivative(path)
        split = _Parts.of(path, slope, step, parts)
        bounds = [split.bounds(k) for k in range(parts)]
        # The first part in which the block might land.
        number = jnp.full(step.shape, parts, jnp.int32)
        for k in reversed(range(parts)):
            number = jnp.where(bounds[k][0] < 0, k, number)
        suspect = moves & (number < parts)
        number = materialized(jnp.minimum(number, parts - 1))
        part = split.piece(number)
        dip = _extreme(slope, part, -1.0, 1)
        lowest = materialized(evaluate(path, dip))
        below = lowest < 0
        lands = suspect & (jnp.minimum(part.end_rotation, lowest) < 0)
        latest = jnp.where(below, dip, part.end)
        lands, latest = materialized((lands, latest))
        width = jnp.where(latest > part.start, latest - part.start, 1)
        depth = jnp.where(below, lowest, part.end_rotation)
        chord = (depth - part.rotation - part.slope * width) / (width * width)
        # A small bounce fills little of the first part.
        bend = jnp.where(number == 0, path[2], chord)
        parabola = (part.rotation, part.slope, bend)
        landing, located = _landing(path, slope, part.start, parabola, latest)
        # Where the impact is not located, the next step begins here and is half as long.
        blocked, lands = lands & ~located, lands & located
        # Behind a part that was suspected wrongly, there may be another one.
        time = jnp.where(suspect, part.end, step)
        time = jnp.where(lands, landing, jnp.where(blocked, 0, time))
        time, blocked, lands = materialized((time, blocked, lands))

        velocity = materialized(evaluate(slope, time))
        # Never on the ground without an impact, which could not be located from there.
        above = jnp.maximum(evaluate(path, time), float(jnp.finfo(step.dtype).tiny))
        rotation = materialized(jnp.where(lands, 0, above))
        # The highest rotation is in the part with the highest bound, before the impact.
        bound, number = bounds[0][1], jnp.zeros_like(number)
        for k in range(1, parts):
            higher = (bounds[k][1] > bound) & (split.times[k] < time)
            bound, number = jnp.where(higher, bounds[k][1], bound), jnp.where(higher, k, number)
        part = split.piece(materialized(number)).until(time, rotation, velocity)
        top = _extreme(slope, part, 1.0, 1 if parts == 1 else 2)
        highest = jnp.where(top < time, materialized(evaluate(path, top)), 0)
        highest = materialized(jnp.maximum(rotation, highest))
        return cls(time, rotation, velocity, highest, lands, blocked, latest)


def take_step(
    lanes: Lanes,
    case: Case,
    ground: PulseInput | RecordInput,
    tolerance: Any,
    order: int,
    parts: int,
) -> Lanes:
    """Take each lane a step further: to its impact, its uplift or the end of its interval."""
    acts = lanes.interval < ground.intervals
    begin = case.start + lanes.interval.astype(lanes.rotation.dtype) * case.length
    length = jnp.where(acts, case.length, jnp.inf)
    stop = jnp.minimum(length, case.duration - begin)
    left = stop - lanes.along
    # All that follows uses these many times. Without a barrier (here and at each `materialized`
    # in this file), XLA would fuse their computation into every use and repeat it there.
    strength = materialized(jnp.where(acts, case.strength, 0))
    horizontal, lift = ground.series(
        case._replace(strength=strength), lanes.interval, lanes.along, order
    )
    push = tuple(lanes.side * part for part in horizontal)
    horizontal, lift, push, left = materialized((horizontal, lift, push, left))

    lifted, wait, uplift_side = ground.uplift(case, lanes, horizontal, lift, left)
    lifted = ~lanes.moves & acts & lifted & (left > wait)
    lifted, wait, uplift_side = materialized((lifted, wait, uplift_side))

    path = rotation_series(case.equation, lanes.rotation, lanes.velocity, push, lift, order)
    longest = parts * jnp.where(acts, _LONGEST, case.longest)
    step = jnp.minimum(jnp.minimum(left, longest), lanes.reach)
    step = materialized(jnp.where(lanes.moves, jnp.minimum(step, _accurate(path, tolerance)), 0))
    flight = _Flight.of(path, step, parts, lanes.moves)
    leaving = velocity_after_impact(case.restitution, jnp.abs(flight.velocity))
    settles = _settles(case, push, lift, flight.time, step, leaving, lanes.peak)
    settles = materialized(flight.lands & settles)

    over = flight.highest >= TOPPLED_ROTATION
    ends_there = ~(flight.lands | flight.blocked) & (flight.time >= left)
    arrives = jnp.where(lanes.moves, ends_there, ~lifted)
    exhausted = over | (lanes.steps >= max_steps(ground))
    ended = (arrives & ~(stop >= length)) | (lanes.moves & exhausted)
    interval = jnp.where(arrives, lanes.interval + 1, lanes.interval)
    interval = jnp.where(lanes.moves | lifted, interval, ground.next_interval(interval, case.trail))
    side = jnp.where(flight.lands, -lanes.side, jnp.where(lifted, uplift_side, lanes.side))
    velocity = jnp.where(flight.lands, jnp.where(settles, 0, leaving), flight.velocity)
    velocity = jnp.where(lanes.moves, velocity, lanes.velocity)
    rotation = jnp.minimum(flight.rotation, TOPPLED_ROTATION)
    rotation = jnp.where(lanes.moves, rotation, lanes.rotation)
    taken = jnp.where(lanes.moves, flight.time, jnp.where(lifted, wait, 0))
    # The state for the overturning criterion is that where the input ends.
    return materialized(
        Lanes(
            interval=jnp.where(ended, ground.intervals, interval),
            along=jnp.where(arrives, 0, lanes.along + taken),
            side=side,
            rotation=rotation,
            velocity=velocity,
            reach=jnp.where(flight.blocked, 0.5 * flight.latest, jnp.inf),
            moves=jnp.where(lanes.moves, ~(settles | ended), lifted),
            peak=jnp.where(lanes.moves, jnp.maximum(lanes.peak, flight.highest), lanes.peak),
            impacts=lanes.impacts + flight.lands.astype(jnp.int32),
            steps=lanes.steps + lanes.moves.astype(jnp.int32),
            end_rotation=jnp.where(acts, rotation, lanes.end_rotation),
            end_velocity=jnp.where(acts, velocity, lanes.end_velocity),
        )
    )


def _settles(
    case: Case,
    push: Coefficients,
    lift: Coefficients,
    flight: Any,
    step: Any,
    leaving: Any,
    peak: Any,
) -> Booleans:
    """Whether a block comes to rest after an impact: if all further bounces end within the step.

    Their time is bounded by that of bounces to the side where the ground presses less, under an
    acceleration that must not change much meanwhile.
    """
    equation = case.equation

    def onward(time: Any) -> Any:
        sideways = jnp.abs(evaluate(push, time))
        upward = evaluate(lift, time) if lift else 0.0
        return equation.right_hand_side(*case.on_ground, sideways, upward)

    down, leaving = materialized((-onward(flight), leaving))
    little = 0.125 * (1 - case.restitution) * down
    settled = flight + 3 * leaving / jnp.where(little > 0, 8 * little, 1)
    steady = jnp.abs(onward(settled) + down) <= little
    low = equation.p_squared * leaving * leaving <= little * down
    tiny = negligible(leaving.dtype)
    nothing = leaving <= tiny * equation.critical_velocity
    level = -down <= 2 * tiny * equation.p_squared * case.on_ground[0]
    # The next bounce is not computed any more: it must not be the highest.
    low = low & (leaving * leaving <= down * peak)
    return ((little > 0) & (settled <= step) & steady & low) | (nothing & level)
