"""The equation of motion in a segment, and single steps of diffrax through it.

In a *segment* the block stays on one side and its rotation is monotone. Time is counted from
the beginning of the segment, so that the smallest bounce keeps all its digits.

Diffrax is called step by step, since three of its parts do not fit here:

- Its choice of the first step (``dt0=None``) takes the motion at the beginning as typical.
  For blocks that start on the ground, its first step passed over the whole arc in 704 of
  2,000 random cases. So the first step comes from the physics (`choose_first_step`).
- Its search for events ends on the interpolant, whose error exceeds the error of a step. So
  `segment_integration` repeats the step to the event.
- Its control of the length of steps keeps a history that one segment does not need.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...ground_motion import Motion
from ...validation import Booleans, Reals
from ..equation import Equation

# A first step meant to end just after the arc overshoots the estimated end by this fraction:
# half of `_REACH` in `segment_integration`, so that the event is within reach.
_OVERSHOOT = 1e-3


class Segment(eqx.Module):
    """The equation of motion on one side, in a time counted from `origin`."""

    equation: Equation
    motion: Motion
    origin: Reals  # time at which the segment begins
    side: Reals  # +1 or -1
    acts: Booleans  # whether the input acts, which is the same throughout the segment

    # Jitted, so that each is traced and enters the program once for each shape of its
    # arguments, however often it is called.
    @jax.jit
    def ground(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration of the ground over g, towards the side of the block and upward."""
        # `value` goes on smoothly beyond both ends of the motion. `acts` cuts it off, so that
        # no step contains the jump.
        horizontal, vertical = self.motion.value(self.origin + time)
        over_g = jnp.where(self.acts, 1 / self.equation.gravity, 0)
        return self.side * horizontal * over_g, vertical * over_g

    @jax.jit
    def accelerate(self, time: Reals, rotation: Reals) -> Reals:
        """Angular acceleration [rad/s2]."""
        return self.equation.acceleration(rotation, *self.ground(time))

    def field(self, time: Reals, y: Reals) -> Reals:
        """Rates of rotation and velocity: the right-hand side of y' = f(t, y)."""
        return jnp.stack([y[1], self.accelerate(time, y[0])])


class Arc(NamedTuple):
    """The motion in a step: times since the segment began, states and their rates at both ends."""

    begin: Reals
    end: Reals
    y: Reals  # rotation and velocity at the beginning
    rates: Reals
    last: Reals  # rotation and velocity at the end
    last_rates: Reals

    def interpolate(self, fraction: Reals) -> tuple[Reals, Reals]:
        """Interpolate rotation and velocity at fractions of the step, by a quintic.

        It goes through the rotation, velocity and acceleration of both ends.
        """
        # In units of the step: `drift` is the first derivative, `bend` half the second one.
        step = self.end - self.begin
        (drift, curvature), (last_drift, last_curvature) = (
            step * self.rates,
            step * self.last_rates,
        )
        bend = 0.5 * step * curvature
        # The parabola from the beginning, with a term in s^3, s^4 and s^5 for its errors at the
        # end: of the rotation, of the first derivative, and of half the second one.
        excess = self.last[0] - self.y[0] - drift - bend
        steeper = last_drift - drift - 2 * bend
        sharper = 0.5 * step * last_curvature - bend
        third = 10 * excess - 4 * steeper + sharper
        fourth = -15 * excess + 7 * steeper - 2 * sharper
        fifth = 6 * excess - 3 * steeper + sharper
        rotation, slope = fifth * fraction + fourth, fifth
        for coefficient in (third, bend, drift, self.y[0]):
            slope = slope * fraction + rotation
            rotation = rotation * fraction + coefficient
        return rotation, slope / jnp.where(step > 0, step, 1)


class Stepper:
    """Steps of one of diffrax's solvers, and the control of their length."""

    def __init__(self, method: str, rtol: Reals | float, atol: Reals | float):
        import diffrax  # which loads slowly

        # The default loop over the stages has no forward derivatives; "lax" has them.
        self.solver = getattr(diffrax, method)(scan_kind="lax")
        self.term = diffrax.ODETerm(lambda t, y, segment: segment.field(t, y))
        self.tolerances = rtol, atol

    def step(
        self, segment: Segment, begin: Reals, end: Reals, y: Reals, rates: Reals
    ) -> tuple[Arc, Booleans, Reals]:
        """Try a step; return whether it is accurate, and the length of the next one."""
        last, error, _, (_, last_rates), _ = self.solver.step(
            self.term, begin, end, y, segment, (jnp.array(False), rates), made_jump=False
        )
        arc = Arc(begin, end, y, rates, last, last_rates)
        # The length of a step has no derivative: results do not depend on it, up to the
        # tolerance, but its derivative would enter them and be noise.
        start, last, error, length = jax.lax.stop_gradient((y, last, error, end - begin))
        rtol, atol = self.tolerances
        scaled = error / (atol + rtol * jnp.maximum(jnp.abs(start), jnp.abs(last)))
        size = jnp.sqrt(jnp.mean(scaled**2))
        accepted = size < 1
        # The order is 5 for Tsit5. A rejected step is repeated shorter; the next step is at
        # most 10 times as long.
        power = -1 / self.solver.error_order(self.term)
        factor = jnp.clip(
            0.9 * size**power, jnp.where(accepted, 1, 0.2), jnp.where(accepted, 10, 0.9)
        )
        return arc, accepted, length * factor


@jax.jit
def limit_step(
    segment: Segment, length: Reals, begin: Reals, end: Reals, y: Reals, acceleration: Reals
) -> Reals:
    """Limit the end of a step by the next kink, the end of the segment, and one peak."""
    begin, end, y, acceleration = jax.lax.stop_gradient((begin, end, y, acceleration))

    # Under a constant acceleration a block stops after abs(velocity / acceleration), and is
    # back after twice that. A longer step could hide a peak and the motion after it: at both
    # ends the event functions would be positive.
    slowing = y[1] * acceleration < 0
    braking = 2 * jnp.abs(y[1] / jnp.where(slowing, acceleration, 1))
    end = jnp.where(slowing, jnp.minimum(end, begin + braking), end)

    # A step or segment that ends within rounding of a kink ends at the kink. Otherwise a step
    # of the length of a rounding error would follow, or a step that begins at the kink with
    # the slope of the interval before: only a step that ends at the kink moves with it. But a
    # step that was rejected must become shorter.
    rounding = segment.motion.time_rounding(segment.origin + length)
    kink = segment.motion.next_kink(segment.origin + begin) - segment.origin
    stop = jnp.where((kink > begin) & (kink < length - rounding), kink, length)
    near = jnp.minimum(rounding, 0.05 * (end - begin))
    return jnp.where(stop <= end + near, stop, end)


def choose_first_step(
    segment: Segment, length: Reals, y: Reals, lifted: Booleans
) -> tuple[Reals, Reals]:
    """Evaluate the rates where a segment begins, and choose the end of its first step.

    The step is at most a quarter of the arc, or ends just after the arc. It is at most a
    twentieth of 1 / p, and half the time until the acceleration changes its sign. The
    acceleration of a block that has just been lifted has no sign, up to rounding.
    """
    # At most a twentieth of 1 / p, and no further than the next kink of the input.
    fixed, longest, origin = jax.lax.stop_gradient((segment, length, segment.origin))
    step = jnp.minimum(longest, 0.05 / jnp.sqrt(fixed.equation.p_squared))
    kink = fixed.motion.next_kink(origin) - origin
    step = jnp.where(kink > 0, jnp.minimum(step, kink), step)
    times = jnp.stack([jnp.zeros_like(step), 0.5 * step, step])
    accelerations = segment.accelerate(times, y[0])
    first, middle, last = jax.lax.stop_gradient(accelerations)
    rotation, velocity = jax.lax.stop_gradient(y)

    # If a linear acceleration changes its sign meanwhile, half the time until then.
    changes_sign = (first * last < 0) & ~lifted
    fraction = first / jnp.where(changes_sign, first - last, 1)
    jerk = (last - first) / jnp.where(step > 0, step, 1)
    step = jnp.where(changes_sign, 0.5 * fraction * step, step)

    # A bounce from the ground takes 2 velocity / acceleration: a quarter of that.
    largest = jnp.maximum(jnp.abs(first), jnp.abs(last))
    quarter = 0.5 * jnp.abs(velocity) / jnp.where(largest > 0, largest, 1)
    quarter = jnp.where((largest > 0) & (quarter > 0), quarter, jnp.inf)
    # Where the acceleration is linear in time, as under a record, the time of the peak or of
    # the impact is known nearly exactly: one step that ends just after it suffices.
    linear = jnp.abs(2 * middle - first - last) <= _OVERSHOOT * largest
    arc = jnp.where(velocity > 0, _find_peak(velocity, first, jerk), jnp.inf)
    falls = (velocity <= 0) & (rotation > 0)
    arc = jnp.where(falls, _find_impact(rotation, velocity, first, jerk), arc)
    arc = jnp.where(linear & (arc < jnp.inf), (1 + _OVERSHOOT) * arc, quarter)
    step = jnp.minimum(step, arc)
    step_end = limit_step(segment, length, jnp.zeros_like(length), step, y, first)
    return jnp.stack([y[1], accelerations[0]]), step_end


def _find_peak(velocity: Reals, acceleration: Reals, jerk: Reals) -> Reals:
    """Find when a velocity vanishes under a linear acceleration; inf if it does not."""
    square = acceleration**2 - 2 * jerk * velocity
    root = jnp.sqrt(jnp.maximum(square, 0)) - acceleration
    return jnp.where((square >= 0) & (root > 0), 2 * velocity / root, jnp.inf)


def _find_impact(rotation: Reals, velocity: Reals, acceleration: Reals, jerk: Reals) -> Reals:
    """Estimate when a rotation vanishes under a linear acceleration; inf if it does not."""

    def improve(_: object, time: Reals) -> Reals:
        # The equivalent constant acceleration is the acceleration after a third of the time.
        mean = acceleration + jerk * jnp.where(time < jnp.inf, time, 0) / 3
        square = velocity**2 - 2 * mean * rotation
        root = jnp.sqrt(jnp.maximum(square, 0)) - velocity
        return jnp.where((square >= 0) & (root > 0), 2 * rotation / root, jnp.inf)

    return jax.lax.fori_loop(0, 4, improve, jnp.zeros_like(rotation))
