"""Steps through one segment of the motion, and the event that ends it.

An event is a zero of one of the `EventFunctions`. It is found in four stages:

1. *Step.* Diffrax tries a step. An event function that is no longer positive at the end of an
   accepted step has a zero inside, and only one: a segment is monotone, and `limit_step` lets
   a step pass over one peak at most. The step is then discarded.
2. *Bracket.* The interpolant of the solver, which costs no evaluation of the equation, is
   bisected for the time of the event. It is less exact than the steps themselves, for
   Dopri8 by orders of magnitude, so that the result is only a first guess.
3. *Refine.* The step is repeated so that it ends at the guess, and the state there improves
   the guess by Halley's method. This is done twice, and a third repetition gives the state.
4. *Differentiate.* The guess of stage 2 has no derivatives. Halley's method converges
   cubically, in derivatives too: the first refinement makes the time exact, the second one its
   first and second derivatives as well. Nothing else has to be done for derivatives.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from .contact_forces import ForceExtremes, add_step
from .solver_steps import Segment, Step, Stepper, choose_first_step, limit_step

# How a segment ends: the velocity vanishes; the rotation reaches pi / 2 or, falling, 0; it
# passes the critical angle; the time is over.
PEAK, CONTACT, CRITICAL, STOP = range(4)

# Steps of one segment, after which the response counts as stopped.
_MAX_STEPS = 2**20
# Repetitions of the step in which a segment ends: two refine the time of the event, and the
# third one gives the state at that time.
_REPETITIONS = 3
# Relative width to which an event is bracketed on the interpolant. The first refinement cubes
# it, to below the rounding of float64, so that a narrower bracket would gain nothing.
_BRACKET_WIDTH = 1e-6


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
    return jax.lax.while_loop(
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
    # step accepted, event  | the event lies in this step       | repetition 1, to the bracket
    # repetition 1 or 2     | y near the event: as near as the  | the next one, to the refined
    #                       |   bracket, then to rounding       |   time
    # repetition 3          | y at the event                    | done
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
    found = jnp.array(False)
    if event_functions is not None:
        # Which event it is has no derivative. Over all of a step more than one function may
        # have changed its sign: the first repetition, which ends within the bracket of the
        # earliest, decides again.
        event_values = jax.lax.stop_gradient(event_functions).evaluate(
            jax.lax.stop_gradient(step.y)
        )
        found = (
            advances & (before.step_end > event_functions.earliest) & (event_values.min() <= 0)
        )
        advances = advances & ~found
        event = jnp.where(found | (before.repetitions == 1), jnp.argmin(event_values), event)
    repetitions = jnp.where(repeats | found, before.repetitions + 1, 0)
    done = (advances & (before.step_end >= length)) | (repetitions > _REPETITIONS)

    # Steps that are rejected or will be repeated leave the state where it was.
    counts = advances | done
    elapsed = jnp.where(counts, before.step_end, before.elapsed)
    y = jnp.where(counts, step.y, before.y)

    # A kink of the input cuts steps short, and from a short step the controller proposes a
    # short one. What it had proposed before the cut still holds.
    wanted = jnp.where(
        advances, jnp.maximum(step.next_length, before.wanted_length), step.next_length
    )
    acceleration, forces = _add_forces(segment, before, step, elapsed, y, advances, counts)
    step_end = limit_step(segment, length, elapsed, elapsed + wanted, y, acceleration)
    if event_functions is not None:
        next_end = step_end
        step_end = jax.lax.switch(
            jnp.where(found, 2, jnp.where(repeats, 1, 0)),
            [
                lambda: next_end,
                lambda: _refine_event_time(
                    segment, event_functions, before.step_end, step.y, event
                ),
                lambda: _bracket_event(stepper, event_functions, before, step),
            ],
        )

    # Written so that a NaN counts as no progress.
    stuck = ~done & ~repeats & ~found & ~(step_end > elapsed)
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
    step: Step,
    elapsed: Reals,
    y: Reals,
    advances: Booleans,
    counts: Booleans,
) -> tuple[Reals, ForceExtremes | None]:
    """Add the forces in a step, if it counts; return the acceleration where the next begins."""
    forces = before.forces
    # The acceleration only limits the next step, which needs no derivative.
    fixed = jax.lax.stop_gradient(segment)
    if forces is None:
        acceleration = fixed.field(*jax.lax.stop_gradient((elapsed, y)))[1]
    else:
        # The forces need both ends of the step: the same evaluation serves the limit.
        times = jnp.stack([before.elapsed, before.step_end])
        states = jnp.stack([before.y, step.y], axis=1)
        accelerations = fixed.field(*jax.lax.stop_gradient((times, states)))[1]
        acceleration = jnp.where(advances, accelerations[1], accelerations[0])
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


def _refine_event_time(
    segment: Segment,
    event_functions: EventFunctions,
    time: Reals,
    y: Reals,
    event: Integers,
) -> Reals:
    """Refine the time of an event by Halley's method, from a time and the state there."""
    rate = segment.field(time, y)
    # The second derivative of the state along the motion, which Halley's method needs.
    _, change = jax.jvp(segment.field, (time, y), (jnp.ones_like(time), rate))
    parts = (
        event_functions.evaluate(y),
        event_functions.apply_linear_part(rate),
        event_functions.apply_linear_part(change),
    )
    value, slope, curvature = (part[event] for part in parts)
    steep = jnp.where(slope < 0, slope, -1)
    newton = value / steep
    # The series of Halley's step, to the second power of Newton's: as exact, and it has no
    # denominator that could vanish.
    move = newton + 0.5 * newton * newton * curvature / steep
    # The bracket is known to be right to its width, with room for the error of the
    # interpolant. A longer move would leave it, as where a segment ends as it begins and the
    # slope is nearly 0. Its value is dropped then, and the time still gets its derivative.
    near = jnp.abs(move) <= 1e3 * _BRACKET_WIDTH * time
    move = jnp.where(near, move, move - jax.lax.stop_gradient(move))
    # A function that does not fall here has no event here: the bracket stands.
    return jnp.where(slope < 0, time - move, time)
