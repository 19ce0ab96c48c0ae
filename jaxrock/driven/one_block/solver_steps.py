"""The equation of motion in a segment, and single steps of diffrax through it.

In a *segment* the block stays on one side and its rotation is monotone. Time is counted from
the beginning of the segment, so that the smallest bounce keeps all its digits.

Diffrax is called step by step, since two of its parts do not fit here:

- Its choice of the first step (``dt0=None``) takes the motion at the beginning as typical.
  For blocks that start on the ground, its first step passed over the whole arc in 704 of
  2,000 random cases. So the first step comes from the physics (`choose_first_step`).
- Its search for events ends on the interpolant, whose error exceeds the error of a step. So
  `segment_integration` repeats the step to the event.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

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
    def field(self, time: Reals, y: Reals) -> Reals:
        """Rates of rotation and velocity: the right-hand side of y' = f(t, y)."""
        return jnp.stack([y[1], self.equation.acceleration(y[0], *self.ground(time))])


class Step(NamedTuple):
    """A trial step and what the step-size control makes of it."""

    y: Reals  # the state at its end
    accepted: Booleans
    next_length: Reals  # of the next step, or of this one when it is repeated
    interpolant: PyTree  # from which the solver interpolates the states between
    solver_state: PyTree


class Stepper:
    """Diffrax's solver and step-size control, one step at a time."""

    def __init__(self, method: str, rtol: Reals | float, atol: Reals | float):
        import diffrax  # which loads slowly

        # The default way to run over the stages has no forward derivatives; "lax" has.
        self.solver = getattr(diffrax, method)(scan_kind="lax")
        self.term = diffrax.ODETerm(lambda t, y, segment: segment.field(t, y))
        self.controller = diffrax.PIDController(rtol=rtol, atol=atol)
        self.order = self.solver.error_order(self.term)

    def begin(self, segment: Segment, y: Reals) -> PyTree:
        """Make the state of the solver before the first step of a segment."""
        zero = jnp.zeros_like(y[0])
        return self.solver.init(self.term, zero, zero + 1, y, segment)

    def step(
        self, segment: Segment, begin: Reals, end: Reals, y: Reals, solver_state: PyTree
    ) -> Step:
        """Try a step from one time to another."""
        last, error, interpolant, solver_state, _ = self.solver.step(
            self.term, begin, end, y, segment, solver_state, made_jump=False
        )
        inverse_error = jnp.ones_like(begin)
        # The length of a step has no derivative: results do not depend on it, up to the
        # tolerance, but its derivative would enter them and be noise.
        tried = jax.lax.stop_gradient((begin, end, y, last, None, error))
        accepted, start, stop, *_ = self.controller.adapt_step_size(
            *tried, self.order, (inverse_error, inverse_error, jnp.array(False))
        )
        length = jnp.asarray(stop - start)
        return Step(last, jnp.asarray(accepted), length, interpolant, solver_state)

    def interpolate(self, begin: Reals, end: Reals, step: Step, time: Reals) -> Reals:
        """Interpolate the state at a time within a step."""
        return self.solver.interpolation_cls(t0=begin, t1=end, **step.interpolant).evaluate(
            time
        )


@jax.jit
def limit_step(
    segment: Segment, length: Reals, begin: Reals, end: Reals, y: Reals, acceleration: Reals
) -> Reals:
    """Limit the end of a step by the next kink, the end of the segment, and one peak."""
    begin, end, y, acceleration = jax.lax.stop_gradient((begin, end, y, acceleration))

    # Under a constant acceleration a block stops after abs(velocity / acceleration), and is
    # back after twice that. A longer step could hide a peak and what comes after it: at both
    # of its ends the event functions would be positive.
    slowing = y[1] * acceleration < 0
    braking = 2 * jnp.abs(y[1] / jnp.where(slowing, acceleration, 1))
    end = jnp.where(slowing, jnp.minimum(end, begin + braking), end)

    # What lies within rounding of a kink is at the kink: a step that ends there, or a segment.
    # Otherwise a step of the length of a rounding error would follow, or a step that begins at
    # the kink with the slope of the interval before it, since a step that ends at a kink moves
    # with it and another one does not. But a step that was rejected must become shorter.
    rounding = segment.motion.time_rounding(segment.origin + length)
    kink = segment.motion.next_kink(segment.origin + begin) - segment.origin
    stop = jnp.where((kink > begin) & (kink < length - rounding), kink, length)
    near = jnp.minimum(rounding, 0.05 * (end - begin))
    return jnp.where(stop <= end + near, stop, end)


def choose_first_step(segment: Segment, length: Reals, y: Reals, lifted: Booleans) -> Reals:
    """Choose the end of the first step, which is at most a quarter of the arc, or just its end.

    Nor is it more than a twentieth of 1 / p, or half the time until the acceleration changes
    its sign. The acceleration of a block that has just been lifted has no sign, up to
    rounding.
    """
    zero = jnp.zeros_like(length)
    fixed, longest, y = jax.lax.stop_gradient((segment, length, y))
    rotation, velocity = y

    # At most a twentieth of the block's own time, and no further than the input is smooth.
    step = jnp.minimum(longest, 0.05 / jnp.sqrt(fixed.equation.p_squared))
    kink = fixed.motion.next_kink(fixed.origin) - fixed.origin
    step = jnp.where(kink > 0, jnp.minimum(step, kink), step)

    # If the acceleration changes its sign meanwhile, linearly, half the time until then.
    times = jnp.stack([zero, 0.5 * step, step])
    first, middle, last = fixed.field(times, jnp.stack([y, y, y], axis=1))[1]
    changes_sign = (first * last < 0) & ~lifted
    share = first / jnp.where(changes_sign, first - last, 1)
    jerk = (last - first) / jnp.where(step > 0, step, 1)
    step = jnp.where(changes_sign, 0.5 * share * step, step)

    # A bounce from the ground takes 2 velocity / acceleration: a quarter of that.
    largest = jnp.maximum(jnp.abs(first), jnp.abs(last))
    quarter = 0.5 * jnp.abs(velocity) / jnp.where(largest > 0, largest, 1)
    quarter = jnp.where((largest > 0) & (quarter > 0), quarter, jnp.inf)
    # Where the acceleration is linear in time, as under a record, the time of the peak or of
    # the impact is known nearly exactly: a step that ends just behind it is the only one.
    linear = jnp.abs(2 * middle - first - last) <= _OVERSHOOT * largest
    arc = jnp.where(velocity > 0, _find_peak(velocity, first, jerk), jnp.inf)
    falls = (velocity <= 0) & (rotation > 0)
    arc = jnp.where(falls, _find_impact(rotation, velocity, first, jerk), arc)
    arc = jnp.where(linear & (arc < jnp.inf), (1 + _OVERSHOOT) * arc, quarter)
    step = jnp.minimum(step, arc)
    return limit_step(segment, length, zero, step, y, first)


def _find_peak(velocity: Reals, acceleration: Reals, jerk: Reals) -> Reals:
    """Find when a velocity vanishes under a linear acceleration; inf if it does not."""
    square = acceleration**2 - 2 * jerk * velocity
    root = jnp.sqrt(jnp.maximum(square, 0)) - acceleration
    return jnp.where((square >= 0) & (root > 0), 2 * velocity / root, jnp.inf)


def _find_impact(rotation: Reals, velocity: Reals, acceleration: Reals, jerk: Reals) -> Reals:
    """Estimate when a rotation vanishes under a linear acceleration; inf if it does not."""
    time = jnp.zeros_like(rotation)
    # The equivalent constant acceleration is the acceleration after a third of the time.
    for _ in range(4):
        mean = acceleration + jerk * jnp.where(time < jnp.inf, time, 0) / 3
        square = velocity**2 - 2 * mean * rotation
        root = jnp.sqrt(jnp.maximum(square, 0)) - velocity
        time = jnp.where((square >= 0) & (root > 0), 2 * rotation / root, jnp.inf)
    return time
