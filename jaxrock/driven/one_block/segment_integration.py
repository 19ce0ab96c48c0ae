"""Steps through one segment of the motion, and the event that ends it.

An event is a zero of one of the `EventFunctions`. It is found in three stages:

1. *Step.* Diffrax tries a step. An event function that is no longer positive at the end of an
   accepted step has a zero inside, and only one: a segment is monotone, and `limit_step` lets
   a step pass over one peak at most.
2. *Bracket.* Unless the step ends so close to the event that stage 3 suffices, it is
   discarded. The interpolant of the solver, which costs no evaluation of the equation, is
   bisected for the time of the event, and the step is repeated so that it ends there. The
   interpolant is less exact than the steps themselves, for Dopri8 by orders of magnitude, so
   that its zero is only a first guess.
3. *Reach.* From the end of a step the motion goes on along its Taylor polynomial, back to the
   zero of the event function (`_reach_event`). Newton's method, whose steps are part of the
   program, gives the time its derivatives too: nothing else has to be done for them.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from .contact_forces import ForceExtremes, add_step
from .packed_loop import repeat_packed
from .solver_steps import Segment, Step, Stepper, choose_first_step, limit_step

# How a segment ends: the velocity vanishes; the rotation reaches pi / 2 or, falling, 0; it
# passes the critical angle; the time is over.
PEAK, CONTACT, CRITICAL, STOP = range(4)

# Steps of one segment, after which the response counts as stopped.
_MAX_STEPS = 2**20
# Repetitions of the step in which a segment ends. The first one ends at the bracket, which is
# nearly always close enough to the event.
_REPETITIONS = 3
# Relative width to which an event is bracketed on the interpolant.
_BRACKET_WIDTH = 1e-6
# Fraction of a step within which the Taylor polynomial from its end reaches an event. Relative
# to a term that the tolerance has made small over the whole step, its remainder is this to the
# fourth power; the remainder of second derivatives is this squared. `_OVERSHOOT` in
# `solver_steps` is half of it, and has to be changed with it.
_REACH = 2e-3
# Within its reach, Newton's method takes these steps. The relative change of the slope on the
# way is at most `_BEND`, which each step squares: three would do for values, a fourth one makes
# second derivatives exact.
_NEWTON_STEPS = 4
_BEND = 1e-2


class EventFunctions(eqx.Module):
    """Event functions g(y) of a segment, each positive before its event.

    They are linear in the state y, scaled by the critical angle and the frequency parameter:

    ==========  =========================  =========================
    event       g of a rising block        g of a falling block
    ==========  =========================  =========================
    `PEAK`      velocity                   -velocity
    `CONTACT`   pi / 2 - rotation          rotation
    `CRITICAL`  alpha_c - rotation         none (infinite)
    ==========  =========================  =========================

    A block that begins its segment beyond the critical angle has no `CRITICAL` either.
    """

    equation: Equation
    rising: Booleans
    crossed: Booleans  # the segment begins beyond the critical angle
    earliest: Reals  # time from which on an event counts

    def evaluate(self, y: Reals) -> Reals:
        """Evaluate the functions of `PEAK`, `CONTACT` and `CRITICAL` for a state."""
        unit = 1 / self.equation.critical_angle
        none = jnp.zeros_like(self.earliest)
        contact = jnp.where(self.rising, TOPPLED_ROTATION * unit, 0)
        critical = jnp.where(self.rising & ~self.crossed, 1, jnp.inf)
        return jnp.stack([none, contact, critical]) + self.apply_linear_part(y)

    # Jitted, so that it enters the program once, however often it is called.
    @jax.jit
    def apply_linear_part(self, y: Reals) -> Reals:
        """Apply the linear part of the functions to a state, or to its derivative in time."""
        unit = 1 / self.equation.critical_angle
        up = jnp.where(self.rising, unit, -unit)
        critical = jnp.where(self.rising & ~self.crossed, -unit, 0)
        peak = up / jnp.sqrt(self.equation.p_squared)
        return jnp.stack([peak * y[1], -up * y[0], critical * y[0]])


class SegmentState(NamedTuple):
    """The state of the loop over the steps of a segment; see the table in `_advance`."""

    elapsed: Reals  # time since the segment began
    y: Reals  # rotation and velocity at that time
    step_end: Reals  # time at which the next step is to end
    wanted_length: Reals  # of the next step, before kinks and peaks limited it
    repetitions: Integers  # number of the repetition that comes next, 0 for a new step
    event: Integers  # `PEAK`, `CONTACT` or `CRITICAL` once one was found, else `STOP`
    done: Booleans
    forces: ForceExtremes | None  # None where nobody asks for them
    steps: Integers  # that have been tried
    solver_state: PyTree


def integrate_segment(
    stepper: Stepper,
    segment: Segment,
    length: Reals,
    y: Reals,
    *,
    moves: Booleans,
    lifted: Booleans,
    event_functions: EventFunctions | None = None,
    forces: ForceExtremes | None = None,
) -> SegmentState:
    """Integrate a segment to its first event, or for its whole length.

    Parameters
    ----------
    stepper : Stepper
    segment : Segment
    length : Array
        Time after which the segment ends if there is no event before [s].
    y : Array, shape (2,)
        Rotation and velocity at its beginning.
    moves : Array of bool
        Where this is False no step is taken.
    lifted : Array of bool
        Whether the input has just lifted the block from the ground.
    event_functions : EventFunctions, optional
        None for no events, as in a history, whose events are known.
    forces : ForceExtremes, optional
        Extremes so far.
    """
    zero = jnp.zeros_like(length)
    none = jnp.zeros((), int)
    step_end = choose_first_step(segment, length, y, lifted)
    solver_state = stepper.begin(segment, y)
    begin = SegmentState(
        elapsed=zero,
        y=y,
        step_end=step_end,
        wanted_length=zero,
        repetitions=none,
        event=none + STOP,
        done=~moves,
        forces=forces,
        steps=none,
        solver_state=solver_state,
    )
    return repeat_packed(
        lambda state: ~state.done & (state.steps < _MAX_STEPS),
        lambda state: _advance(stepper, segment, length, event_functions, state),
        begin,
    )


def _advance(
    stepper: Stepper,
    segment: Segment,
    length: Reals,
    event_functions: EventFunctions | None,
    before: SegmentState,
) -> SegmentState:
    """Try one step, or repeat the last one so that it ends closer to the event."""
    # State of the loop     | What is known                     | What happens next
    # ----------------------|-----------------------------------|------------------------------
    # step rejected         | its error is too large            | a shorter one from the same y
    # step accepted,        | y at its end                      | the next one; at the end of
    #   no event            |                                   |   the length: done
    # step accepted, event  | the event lies in this step, so   | on to the event: done
    #   within reach        |   close to its end that a Taylor  |
    #                       |   polynomial leads there          |
    # step accepted, event  | the event lies in this step       | repetition 1, to the bracket
    # repetition            | y near the event: as near as the  | on to the event: done; if it
    #                       |   bracket                         |   is out of reach, the next
    #                       |                                   |   repetition, closer to it
    # no progress           | the clock cannot resolve the next | y is NaN: done
    #                       |   step, or y is NaN               |
    #
    # One call of the solver serves all states: it is most of the program.
    step = stepper.step(
        segment, before.elapsed, before.step_end, before.y, before.solver_state
    )
    repeats = before.repetitions > 0
    event = before.event
    advances = step.accepted & ~repeats
    detected = jnp.array(False)
    reached = jnp.array(False)
    end = before.step_end
    last = step.y
    if event_functions is not None:
        # Which event it is has no derivative. Over all of a step more than one function may
        # have changed its sign: the first repetition, which ends within the bracket of the
        # earliest, decides again.
        event_values = jax.lax.stop_gradient(event_functions).evaluate(
            jax.lax.stop_gradient(step.y)
        )
        ended = event_values <= 0
        detected = advances & (before.step_end > event_functions.earliest) & ended.any()
        advances = advances & ~detected
        event = jnp.where(
            detected | (before.repetitions == 1), jnp.argmin(event_values), event
        )
        reaches = repeats | (ended.sum() == 1)
        reached, end, last = jax.lax.cond(
            repeats | detected,
            lambda: _reach_event(segment, event_functions, before, step.y, event, reaches),
            lambda: (reached, end, last),
        )
    done = (advances & (before.step_end >= length)) | reached
    repetitions = jnp.where((repeats | detected) & ~reached, before.repetitions + 1, 0)

    # Steps that are rejected or will be repeated leave the state where it was.
    counts = advances | done
    elapsed = jnp.where(counts, end, before.elapsed)
    y = jnp.where(counts, last, before.y)

    # A kink of the input cuts steps short, and from a short step the controller proposes a
    # short one. What it had proposed before the cut still holds.
    wanted = jnp.where(
        advances, jnp.maximum(step.next_length, before.wanted_length), step.next_length
    )
    acceleration, forces = _add_forces(segment, before, end, last, advances, counts)
    step_end = limit_step(segment, length, elapsed, elapsed + wanted, y, acceleration)
    step_end = jnp.where(repeats, end, step_end)
    if event_functions is not None:
        next_end = step_end
        step_end = jax.lax.cond(
            detected & ~reached,
            lambda: _bracket_event(stepper, event_functions, before, step),
            lambda: next_end,
        )

    # Written so that a NaN counts as no progress.
    stuck = ~done & ~repeats & ~detected & ~(step_end > elapsed)
    y = jnp.where(stuck, jnp.nan, y)
    # Only a step that advances has a proposal that a kink may have cut.
    wanted = jnp.where(advances, wanted, 0)
    done = done | stuck
    steps = before.steps + 1
    states = step.solver_state, before.solver_state
    solver_state = jax.tree.map(lambda new, old: jnp.where(advances, new, old), *states)
    return SegmentState(
        elapsed=elapsed,
        y=y,
        step_end=step_end,
        wanted_length=wanted,
        repetitions=repetitions,
        event=event,
        done=done,
        forces=forces,
        steps=steps,
        solver_state=solver_state,
    )


def _add_forces(
    segment: Segment,
    before: SegmentState,
    end: Reals,
    last: Reals,
    advances: Booleans,
    counts: Booleans,
) -> tuple[Reals, ForceExtremes | None]:
    """Add the forces in a step, if it counts; return the acceleration where the next begins."""
    forces = before.forces
    # The forces need both ends of the step: the same evaluation serves the limit.
    times = jnp.stack([before.elapsed, end])
    states = jnp.stack([before.y, last], axis=1)
    accelerations = segment.field(times, states)[1]
    acceleration = jnp.where(advances, accelerations[1], accelerations[0])
    if forces is not None:
        forces = add_step(forces, segment, times, states, accelerations, counts)
    return acceleration, forces


def _bracket_event(
    stepper: Stepper, event_functions: EventFunctions, before: SegmentState, step: Step
) -> Reals:
    """Bracket the event in a step by bisection on the interpolant; return the later end."""
    # Derivatives of a bisection mean nothing; the refinements bring the right ones.
    event_functions, before, step = jax.lax.stop_gradient((event_functions, before, step))
    limits = jnp.finfo(before.elapsed.dtype)
    # Below this time the relative width of a bracket would underflow: the loop would not end.
    smallest = float(limits.tiny) / float(limits.eps)

    def is_wide(bracket: tuple[Reals, Reals]) -> Booleans:
        return bracket[1] - bracket[0] > _BRACKET_WIDTH * jnp.maximum(bracket[1], smallest)

    def halve(bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        middle = 0.5 * (bracket[0] + bracket[1])
        y = stepper.interpolate(before.elapsed, before.step_end, step, middle)
        ended = (event_functions.evaluate(y).min() <= 0) & (middle > event_functions.earliest)
        return jnp.where(ended, bracket[0], middle), jnp.where(ended, middle, bracket[1])

    return jax.lax.while_loop(is_wide, halve, (before.elapsed, before.step_end))[1]


def _reach_event(
    segment: Segment,
    event_functions: EventFunctions,
    before: SegmentState,
    y: Reals,
    event: Integers,
    may_reach: Booleans,
) -> tuple[Booleans, Reals, Reals]:
    """Go from the end of a step to an event close to it, along the Taylor polynomial.

    Parameters
    ----------
    segment : Segment
    event_functions : EventFunctions
    before : SegmentState
        Before the step.
    y : Array, shape (2,)
        The state at the end of the step.
    event : Array of int
    may_reach : Array of bool
        False where several events lie in the step.

    Returns
    -------
    reached : Array of bool
        Whether the segment ends here.
    time : Array
        Of the event, or a better guess of it.
    y : Array, shape (2,)
        State at this time.
    """
    end = before.step_end
    rotation, velocity = y
    acceleration = segment.field(end, y)[1]

    def accelerate(time: Reals) -> Reals:
        """Compute the acceleration after a time, exact to its second derivative."""
        moved = rotation + time * (velocity + 0.5 * time * acceleration)
        return segment.field(end + time, jnp.stack([moved, velocity]))[1]

    def change(time: Reals) -> Reals:
        """Compute the derivative of the acceleration after a time."""
        return jax.jvp(accelerate, (time,), (jnp.ones_like(time),))[1]

    here = jnp.zeros_like(end)
    jerk, snap = jax.jvp(change, (here,), (jnp.ones_like(here),))
    # The function of the event as a polynomial in the time after the end, of these powers.
    derivatives = jnp.stack(
        [
            jnp.stack([velocity, acceleration, jerk, snap]),
            jnp.stack([acceleration, jerk, snap, here]),
        ]
    )
    inverse_factorials = 1 / np.array([1, 2, 6, 24])
    powers = event_functions.apply_linear_part(derivatives)[event]
    slope, bend, third, fourth = powers * jnp.asarray(inverse_factorials, powers.dtype)
    value = event_functions.evaluate(y)[event]
    # A function that does not fall here has no event here: the end stands.
    falls = slope < 0
    steep = jnp.where(falls, slope, -1)
    newton = value / steep
    ratio = newton * bend / steep
    near = falls & (jnp.abs(newton) <= _REACH * (end - before.elapsed))
    near = near & (jnp.abs(ratio) <= _BEND) & (end - newton > event_functions.earliest)
    back = -here
    for _ in range(_NEWTON_STEPS):
        change_of_value = back * (slope + back * (bend + back * (third + back * fourth)))
        tangent = slope + back * (2 * bend + back * (3 * third + back * 4 * fourth))
        back = back - (value + change_of_value) / jnp.where(near, tangent, -1)

    # Out of reach, Halley's method guesses the time, as a series to the second power of
    # Newton's step, which has no denominator that could vanish. A move that leaves the
    # bracket, with room for the error of the interpolant, is dropped, for example where a
    # segment ends as soon as it begins and the slope is nearly 0. In the last repetition the
    # derivative of the move still counts.
    move = jnp.where(falls, newton * (1 + ratio), 0)
    fixed = jax.lax.stop_gradient(move)
    stays = jnp.abs(fixed) > 1e3 * _BRACKET_WIDTH * end
    reached = (near & may_reach) | (before.repetitions >= _REPETITIONS)
    shift = jnp.where(near, back, fixed - move)
    guess = jax.lax.stop_gradient(end) - jnp.where(stays, 0, fixed)
    time = jnp.where(reached, end + shift, guess)
    further = (0.5 * acceleration, jerk / 6, snap / 24)
    rotation = rotation + shift * (
        velocity + shift * (further[0] + shift * (further[1] + shift * further[2]))
    )
    velocity = velocity + shift * (acceleration + shift * (0.5 * jerk + shift * snap / 6))
    return reached, time, jnp.stack([rotation, velocity])
