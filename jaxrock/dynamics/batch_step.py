"""Many blocks side by side, each at its own pace through the intervals of a `Grid`.

Every lane takes a step at a time: by a Taylor polynomial to the end of its interval or, if the
block lands before, to the impact, which is a root of that polynomial. A block at rest goes
to the next interval that might lift it. What a lane does depends on no other.
"""

import math
from operator import sub
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..impact import velocity_after_impact
from ..resonance import Linearized, RockingModel
from ..validation import Booleans
from .equation import Equation
from .input_intervals import Grid
from .overturning_criterion import TOPPLED_ROTATION
from .taylor import Coefficients, derivative, evaluate, materialized, rotation_series

_LONGEST = 0.15  # step times p
# Part of the critical angle beside which the relative error is taken below order 6: right after
# uplift the third power is the whole motion, and no step would be short enough.
_COARSE = 1e-3


class Case(NamedTuple):
    """What follows from the arguments once for all steps."""

    equation: Equation
    on_ground: tuple[Any, Any]  # sine and cosine of the tilt on the ground
    longest: Any  # step in time
    restitution: Any
    strength: Any  # factor over g
    length: Any  # of an interval
    frequency: Any  # 1 / length
    start: Any
    duration: Any
    first: Any  # interval of the motion
    trail: Any  # of intervals that might lift the block
    finite: Any  # whether the motion is

    @classmethod
    def of(cls, grid: Grid, arguments: tuple[Any, ...], model: RockingModel) -> "Case":
        """The case of the arguments of `respond_batch`, elementwise.

        `factor` is on the motion (its amplitude or scale), `length` that of an interval, `motion`
        the index where there are several.
        """
        block, restitution, factor, length, start, duration, motion = arguments
        motion = motion.astype(jnp.int32)
        equation = Equation.of(block, model)
        angle, strength = equation.critical_angle, factor / equation.gravity
        needed = equation.tangent / jnp.abs(strength)
        if grid.vertical:
            needed = needed / (1 + equation.tangent)
        return cls(
            equation=equation,
            on_ground=(angle, jnp.ones_like(angle))
            if isinstance(model, Linearized)
            else (jnp.sin(angle), jnp.cos(angle)),
            longest=_LONGEST / jnp.sqrt(equation.p_squared),
            restitution=restitution,
            strength=strength,
            length=length,
            frequency=1 / length,
            start=start,
            duration=duration,
            first=motion * grid.room,
            trail=grid.trail(motion, needed),
            finite=grid.finite[motion],
        )

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

    def active(self, grid: Grid) -> Booleans:
        """Whether the motion goes on."""
        return self.moves | (self.interval < grid.intervals)


def max_steps(grid: Grid) -> Any:
    """Largest number of steps of a lane, which bounds the time; reported where it is reached."""
    return 1000 * jnp.minimum(grid.intervals, 2 * 10**6) + 10**6


def _tiny(dtype: Any) -> float:
    """What counts as nothing beside 1."""
    return 64 * float(jnp.finfo(dtype).eps)


def _lift(
    case: Case, horizontal: Coefficients, lift: Coefficients, step: Any
) -> tuple[Any, Any, Any]:
    """Whether a block at rest is lifted within a step, when, and to which side."""
    tangent = case.equation.tangent
    needed = (tangent * (1 + _tiny(step.dtype)), *(jnp.zeros_like(step) for _ in horizontal[1:]))
    if lift:
        needed = tuple(a + tangent * b for a, b in zip(needed, lift, strict=True))
    last = evaluate(horizontal, step)
    at_once = jnp.abs(horizontal[0]) > needed[0]
    lifted = at_once | (jnp.abs(last) > evaluate(needed, step))
    side = jnp.where(jnp.where(at_once, horizontal[0], last) < 0, -1.0, 1.0)
    if lift:
        # Where the ground falls away, both sides are lifted within the step: the first counts.
        begin, end = (
            [one * part - need for one in (1.0, -1.0)]
            for part, need in ((horizontal[0], needed[0]), (last, evaluate(needed, step)))
        )
        first = begin[0] * (end[1] - begin[1]) >= begin[1] * (end[0] - begin[0])
        both = (end[0] > 0) & (end[1] > 0) & ~at_once
        side = jnp.where(both, jnp.where(first, 1.0, -1.0), side)
    excess = tuple(map(sub, (side * part for part in horizontal), needed))
    rise = evaluate(excess[1:], step)
    wait = -excess[0] / jnp.where(rise > 0, rise, 1)
    if len(excess) > 2:
        for _ in range(3):
            slope = evaluate(derivative(excess), wait)
            better = wait - evaluate(excess, wait) / jnp.where(slope > 0, slope, 1)
            wait = jnp.where(slope > 0, jnp.clip(better, 0, step), wait)
    return lifted, jnp.where(at_once, 0, wait), side


def _accurate(equation: Equation, path: Coefficients, step: Any) -> Any:
    """The step, or as much of it as the polynomial is accurate for.

    Beside the others, its last term must be at most a tenth of what it is for a free motion in
    the longest step, since a rough input takes many such steps. The term before it counts too,
    since every other term may vanish.
    """
    order = len(path) - 1
    allowed = 0.1 * _LONGEST**order / math.factorial(order)
    path, length, rate = jax.lax.stop_gradient((path, step, jnp.sqrt(equation.p_squared)))
    sizes = tuple(map(jnp.abs, path))
    moved = evaluate(sizes, length)
    if order < 6:
        moved = moved + _COARSE * jax.lax.stop_gradient(equation.critical_angle)
    last = (sizes[-1] + sizes[-2] * rate) * length**order
    excess = last / (allowed * jnp.where(moved > 0, moved, 1))
    # The length of a step need not be exact: a power in float32 is cheaper. The motion grows
    # with the third power of the time at most.
    excess = jnp.maximum(excess, 1).astype(jnp.float32)
    shorter = length * jnp.exp2(jnp.log2(excess) * (-1 / max(order - 3, 1))).astype(length.dtype)
    return jnp.where(excess > 1, shorter, step)


def _dip_and_peak(slope: Coefficients, step: Any) -> tuple[Any, Any]:
    """When a rotation is lowest and when highest within a step; `step` where it is at no time.

    The slope vanishes there: from a parabola and one step of Newton's method, which is enough
    since an extreme value changes little with the time. Only that step has a derivative, which
    the second derivative of the extreme value needs.
    """
    changing = slope
    slope, step = jax.lax.stop_gradient((slope, step))
    a, b, c = slope[0], 0.5 * slope[1], slope[2]
    square, up = b * b - a * c, b > 0
    root = jnp.sqrt(jnp.maximum(square, 0))

    def improved(above: Any, below: Any) -> Any:
        time = above / jnp.where(below == 0, 1, below)
        inside = (square > 0) & (below != 0) & (time > 0) & (time < step)
        time = jnp.where(inside, time, step)
        curved = evaluate(derivative(slope), time)
        better = time - evaluate(changing, time) / jnp.where(curved == 0, 1, curved)
        return jnp.where(inside & (better > 0) & (better < step), better, time)

    # (root - b) / c and -(root + b) / c, without cancellation
    low = improved(jnp.where(up, -a, root - b), jnp.where(up, root + b, c))
    high = improved(jnp.where(up, -(root + b), a), jnp.where(up, c, root - b))
    return low, high


def _landing(path: Coefficients, latest: Any) -> tuple[Any, Booleans]:
    """When a rotation falls through 0 that is negative at `latest`, and whether that was located.

    By Halley's method from the root of a parabola. One more step shows whether that was enough,
    and gives the time its derivatives.
    """
    a, b, c = path[:3]
    slope = derivative(path)
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    time = jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    time = jnp.where((below > 0) & (time > 0) & (time < latest), time, 0.5 * latest)
    for _ in range(2):
        value, steep, bent = (evaluate(each, time) for each in (path, slope, derivative(slope)))
        below = steep * steep - 0.5 * value * bent
        time = time - value * steep / jnp.where(below > 0, below, jnp.inf)
    # A barrier: the series below use it often, and XLA would repeat both iterations.
    before = materialized(jax.lax.stop_gradient(time))
    steep, bent = evaluate(slope, before), evaluate(derivative(slope), before)
    below = jnp.where(steep < 0, steep, -1)
    off = evaluate(path, before) / below
    # The square matters only in the second derivative of the time.
    time = materialized(before - off - 0.5 * off * off * bent / below)
    near = jnp.abs(time - before) <= float(jnp.finfo(time.dtype).eps) ** 0.5 * time
    return time, near & (steep < 0) & (time > 0) & (time <= latest)


def take_step(lanes: Lanes, case: Case, grid: Grid, order: int) -> Lanes:
    """Take each lane to the end of its interval, its impact or its uplift."""
    equation, dtype = case.equation, lanes.rotation.dtype
    acts = lanes.interval < grid.intervals
    begin = case.start + lanes.interval.astype(dtype) * case.length
    length = jnp.where(acts, case.length, jnp.inf)
    stop = jnp.minimum(length, case.duration - begin)
    left = stop - lanes.along
    step = jnp.minimum(jnp.minimum(left, case.longest), lanes.reach)
    step = jnp.where(lanes.moves, step, jnp.where(acts, left, 0))
    strength = materialized(jnp.where(acts, case.strength, 0))
    horizontal, lift = grid.ahead(
        case.first + lanes.interval, lanes.along, case.frequency, strength
    )
    push = tuple(lanes.side * part for part in horizontal)
    # All that follows uses these many times. Without a barrier (here and at each `materialized`
    # below), XLA would fuse their computation into every use and repeat it there.
    horizontal, lift, push, step, left = materialized((horizontal, lift, push, step, left))

    lifted, wait, uplift_side = _lift(case, horizontal, lift, step)
    lifted = ~lanes.moves & lifted & (left > 0)
    lifted, wait, uplift_side = materialized((lifted, wait, uplift_side))

    path = rotation_series(equation, lanes.rotation, lanes.velocity, push, lift, order)
    step = materialized(jnp.where(lanes.moves, _accurate(equation, path, step), step))
    slope = derivative(path)
    dip, top = materialized(_dip_and_peak(slope, step))
    end, lowest, highest = materialized(tuple(evaluate(path, time) for time in (step, dip, top)))
    lands = lanes.moves & (jnp.minimum(end, lowest) < 0)
    lands, latest = materialized((lands, jnp.where(lowest < 0, dip, step)))
    landing, located = materialized(_landing(path, latest))
    # Where the impact is not located, the next step begins here and is half as long.
    blocked, lands = lands & ~located, lands & located
    flight = jnp.where(lands, landing, jnp.where(blocked, 0, step))
    flight, blocked, lands = materialized((flight, blocked, lands))
    velocity = materialized(evaluate(slope, flight))
    # Never on the ground without an impact, which could not be located from there.
    above = jnp.maximum(evaluate(path, flight), float(jnp.finfo(dtype).tiny))
    rotation = materialized(jnp.where(lands, 0, above))
    peak = materialized(jnp.maximum(rotation, jnp.where(top < flight, highest, 0)))

    # Impact. The block comes to rest if all further bounces end within the step. Their time is
    # bounded by that of bounces to the side where the ground presses less, under an acceleration
    # that must not change much meanwhile.
    leaving = velocity_after_impact(case.restitution, jnp.abs(velocity))

    def onward(time: Any) -> Any:
        sideways = jnp.abs(evaluate(push, time))
        upward = evaluate(lift, time) if lift else 0.0
        return equation.right_hand_side(*case.on_ground, sideways, upward)

    down, leaving = materialized((-onward(flight), leaving))
    little = 0.125 * (1 - case.restitution) * down
    settled = flight + 3 * leaving / jnp.where(little > 0, 8 * little, 1)
    steady = jnp.abs(onward(settled) + down) <= little
    low = equation.p_squared * leaving * leaving <= little * down
    nothing = leaving <= _tiny(dtype) * equation.critical_velocity
    level = -down <= 2 * _tiny(dtype) * equation.p_squared * case.on_ground[0]
    # The next bounce is not computed any more: it must not be the highest.
    low = low & (leaving * leaving <= down * lanes.peak)
    settles = (little > 0) & (settled <= step) & steady & low
    settles = materialized(lands & (settles | (nothing & level)))

    over = peak >= TOPPLED_ROTATION
    arrives = jnp.where(lanes.moves, ~(lands | blocked) & (step >= left), ~lifted)
    ended = (arrives & ~(stop >= length)) | (
        lanes.moves & (over | (lanes.steps >= max_steps(grid)))
    )
    interval = jnp.where(arrives, lanes.interval + 1, lanes.interval)
    interval = jnp.where(lanes.moves | lifted, interval, grid.next_interval(interval, case.trail))
    rotation = jnp.where(lanes.moves, jnp.minimum(rotation, TOPPLED_ROTATION), lanes.rotation)
    velocity = jnp.where(lands, jnp.where(settles, 0, leaving), velocity)
    velocity = jnp.where(lanes.moves, velocity, lanes.velocity)
    taken = jnp.where(lanes.moves, flight, jnp.where(lifted, wait, 0))
    # The state for the overturning criterion is that where the input ends.
    return materialized(
        Lanes(
            interval=jnp.where(ended, grid.intervals, interval),
            along=jnp.where(arrives, 0, lanes.along + taken),
            side=jnp.where(lands, -lanes.side, jnp.where(lifted, uplift_side, lanes.side)),
            rotation=rotation,
            velocity=velocity,
            reach=jnp.where(blocked, 0.5 * latest, jnp.inf),
            moves=jnp.where(lanes.moves, ~(settles | ended), lifted),
            peak=jnp.where(lanes.moves, jnp.maximum(lanes.peak, peak), lanes.peak),
            impacts=lanes.impacts + lands.astype(jnp.int32),
            steps=lanes.steps + lanes.moves.astype(jnp.int32),
            end_rotation=jnp.where(acts, rotation, lanes.end_rotation),
            end_velocity=jnp.where(acts, velocity, lanes.end_velocity),
        )
    )
