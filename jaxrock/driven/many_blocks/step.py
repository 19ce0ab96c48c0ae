"""Many blocks side by side, each at its own pace through a ground motion.

Every lane takes a step at a time by a Taylor polynomial: as long as its last terms allow, to a
corner of the input at most, or to the impact, which is a root of that polynomial. A block at
rest goes to the next time that might lift it. What a lane does depends on no other.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from ...impact import velocity_after_impact
from ...numerics import larger
from ...resonance import Linearized, RockingModel
from ...validation import Booleans, Integers, Number, Reals
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from .flight import LONGEST, StepFlight
from .ground_inputs import PulseInput, RecordInput, negligible
from .taylor import (
    Coefficients,
    accurate_step,
    derivative,
    evaluate,
    materialized,
    rotation_series,
    sine_cosine,
)


class Case(NamedTuple):
    """What follows from the arguments once for all steps. Times are in units of `unit`."""

    equation: Equation
    on_ground: tuple[Reals, Reals]  # sine and cosine of the tilt on the ground
    unit: Reals  # of time
    longest: Reals  # part of a step behind the end of the input
    restitution: Reals
    strength: Reals  # factor over g
    length: Reals  # of an interval
    rate: Reals  # of the phase of the input
    start: Reals
    duration: Reals
    first: Integers  # place of the first interval of the motion
    intervals: Integers  # of the motion
    grade: Integers  # of intervals that might lift the block
    uplifts: tuple[Reals, ...]  # times at which a pulse might, and to which side
    finite: Booleans  # whether the motion is

    @classmethod
    def of(
        cls, ground: PulseInput | RecordInput, arguments: tuple[Any, ...], model: RockingModel
    ) -> "Case":
        """Make the case of the arguments of `respond_batch`, elementwise.

        `factor` is on the motion (its amplitude or scale), `length` that of an interval,
        `motion` the index where there are several.
        """
        block, restitution, factor, length, start, duration, motion = arguments
        motion = motion.astype(jnp.int32)
        equation = Equation.of(block, model)
        angle = equation.critical_angle
        strength = factor / equation.gravity
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
        first, intervals = ground.extent_of(motion)
        return cls(
            equation=equation,
            on_ground=(angle, jnp.ones_like(angle))
            if isinstance(model, Linearized)
            else sine_cosine(angle),
            unit=unit,
            longest=LONGEST / (natural * unit),
            restitution=restitution,
            strength=strength,
            length=length / unit,
            rate=rate,
            start=start / unit,
            duration=duration / unit,
            first=first,
            intervals=intervals,
            grade=ground.grade(needed),
            uplifts=uplifts,
            finite=ground.is_finite(motion),
        )

    def for_steps(self) -> "Case":
        """Return the part that the steps need."""
        unused = (None, None)
        equation = eqx.tree_at(lambda e: (e.gravity, e.inertia_ratio), self.equation, unused)
        return self._replace(equation=equation, unit=None, finite=None)

    def valid(self) -> Booleans:
        """Tell whether all arguments are allowed."""
        equation = self.equation
        restitution = self.restitution
        total = equation.p_squared + equation.tangent + self.strength + self.start
        finite = jnp.isfinite(total + restitution + self.length + self.duration) & self.finite
        positive = (equation.p_squared > 0) & (self.length > 0) & (self.duration > 0)
        return finite & positive & (self.start >= 0) & (restitution >= 0) & (restitution <= 1)


class Lanes(NamedTuple):
    """Where the blocks are."""

    interval: Integers
    along: Reals  # time in the interval
    side: Reals
    rotation: Reals
    velocity: Reals
    reach: Reals  # longest step
    moves: Booleans
    peak: Reals
    impacts: Integers
    steps: Integers  # in motion
    end_rotation: Reals  # at the end of the input, or now if that is earlier
    end_velocity: Reals

    @classmethod
    def at_rest(cls, interval: Integers, dtype: DTypeLike) -> "Lanes":
        """Blocks that have not moved, in an interval."""
        zero = jnp.zeros(interval.shape, dtype)
        count = jnp.zeros_like(interval)
        fields = dict.fromkeys(cls._fields, zero) | dict.fromkeys(("impacts", "steps"), count)
        fields |= {"interval": interval, "side": zero + 1, "reach": zero + jnp.inf}
        return cls(**fields | {"moves": jnp.zeros(interval.shape, bool)})

    def active(self, case: Case) -> Booleans:
        """Tell whether the motion goes on."""
        return self.moves | (self.interval < case.intervals)


def max_steps(case: Case) -> Integers:
    """Largest number of steps of a lane, which bounds the time; reported where it is reached."""
    return 1000 * jnp.minimum(case.intervals, 2 * 10**6) + 10**6


def take_step(
    lanes: Lanes,
    case: Case,
    ground: PulseInput | RecordInput,
    tolerance: Number,
    order: int,
) -> Lanes:
    """Take each lane a step further: to its impact, its uplift or the end of its interval."""
    acts = lanes.interval < case.intervals
    begin = case.start + lanes.interval.astype(lanes.rotation.dtype) * case.length
    length = jnp.where(acts, case.length, jnp.inf)
    stop = jnp.minimum(length, case.duration - begin)
    left = stop - lanes.along
    # All that follows uses these many times. Without a barrier (here and at each
    # `materialized` in this file), XLA would fuse their computation into every use and repeat
    # it there.
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
    longest = jnp.where(acts, LONGEST, case.longest)
    step = jnp.minimum(jnp.minimum(left, longest), lanes.reach)
    step = materialized(
        jnp.where(lanes.moves, jnp.minimum(step, accurate_step(path, tolerance)), 0)
    )
    flight = StepFlight.of(path, step, lanes.moves, lanes.peak, tolerance)
    leaving = velocity_after_impact(case.restitution, jnp.abs(flight.velocity))
    settles = _settles(case, push, lift, flight.time, step, leaving, lanes.peak)
    settles = materialized(flight.lands & settles)

    over = flight.highest >= TOPPLED_ROTATION
    ends_there = ~(flight.lands | flight.blocked) & (flight.time >= left)
    arrives = jnp.where(lanes.moves, ends_there, ~lifted)
    exhausted = over | (lanes.steps >= max_steps(case))
    ended = (arrives & ~(stop >= length)) | (lanes.moves & exhausted)
    interval = jnp.where(arrives, lanes.interval + 1, lanes.interval)
    interval = jnp.where(lanes.moves | lifted, interval, ground.next_interval(interval, case))
    side = jnp.where(flight.lands, -lanes.side, jnp.where(lifted, uplift_side, lanes.side))
    velocity = jnp.where(flight.lands, jnp.where(settles, 0, leaving), flight.velocity)
    velocity = jnp.where(lanes.moves, velocity, lanes.velocity)
    rotation = jnp.minimum(flight.rotation, TOPPLED_ROTATION)
    rotation = jnp.where(lanes.moves, rotation, lanes.rotation)
    taken = jnp.where(lanes.moves, flight.time, jnp.where(lifted, wait, 0))
    # The state for the overturning criterion is that where the input ends.
    return materialized(
        Lanes(
            interval=jnp.where(ended, case.intervals, interval),
            along=jnp.where(arrives, 0, lanes.along + taken),
            side=side,
            rotation=rotation,
            velocity=velocity,
            reach=jnp.where(flight.blocked, flight.reach, jnp.inf),
            moves=jnp.where(lanes.moves, ~(settles | ended), lifted),
            peak=jnp.where(lanes.moves, larger(lanes.peak, flight.highest), lanes.peak),
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
    flight: Reals,
    step: Reals,
    leaving: Reals,
    peak: Reals,
) -> Booleans:
    """Tell whether a block comes to rest after an impact: all further bounces end in the step.

    Their time is bounded by that of bounces to the side where the ground presses less, under
    an acceleration that must not change much meanwhile, whatever the input does.
    """
    equation = case.equation
    sine, cosine = case.on_ground
    sideways = jnp.abs(evaluate(push, flight))
    upward = evaluate(lift, flight) if lift else 0.0
    down = -equation.right_hand_side(sine, cosine, sideways, upward)
    down, leaving = materialized((down, leaving))
    little = 0.125 * (1 - case.restitution) * down
    bounces = 3 * leaving / jnp.where(little > 0, 8 * little, 1)
    settled = flight + bounces
    change = cosine * _fastest(push, settled)
    if lift:
        change = change + sine * _fastest(lift, settled)
    steady = bounces * change * equation.p_squared <= little
    low = equation.p_squared * leaving * leaving <= little * down
    tiny = negligible(leaving.dtype)
    nothing = leaving <= tiny * equation.critical_velocity
    level = -down <= 2 * tiny * equation.p_squared * case.on_ground[0]
    # The next bounce is not computed any more: it must not be the highest.
    low = low & (leaving * leaving <= down * peak)
    return ((little > 0) & (settled <= step) & steady & low) | (nothing & level)


def _fastest(series: Coefficients, time: Reals) -> Reals:
    """Bound the magnitude of the derivative of a series up to a time."""
    return evaluate(derivative(tuple(map(jnp.abs, series))), time)
