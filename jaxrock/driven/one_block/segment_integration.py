"""Steps through one segment of the motion, and the event that ends it.

An event is a zero of one of the `EventFunctions`. It is found in three stages:

1. *Step.* Diffrax tries a step. An event function that is no longer positive at the end of an
   accepted step has a zero inside, and only one: a segment is monotone, and `limit_step` lets
   a step pass over one peak at most.
2. *Bracket.* Unless the step ends so close to the event that stage 3 suffices, it is
   discarded. The quintic through both ends of the step (`Arc`), which costs no evaluation of
   the equation, is bisected for the time of the event, and the step is repeated so that it ends
   there. The quintic is less exact than the steps themselves, so that its zero is only a first
   guess.
3. *Reach.* From the end of a step the motion goes on along its Taylor polynomial, back to the
   zero of the event function (`_reach_event`). Newton's method, whose steps are part of the
   program, gives the time its derivatives too: nothing else has to be done for them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from .contact_forces import ForceExtremes, add_step
from .solver_steps import Arc, Segment, Stepper, limit_step

# How a segment ends: the velocity vanishes; the rotation reaches pi / 2 or, falling, 0; the
# rotation passes the critical angle; the time is over.
PEAK, CONTACT, CRITICAL, STOP = range(4)

# Number of steps of one segment after which the response counts as stopped.
_MAX_STEPS = 2**20
# Repetitions of the step in which a segment ends. The first one ends at the bracket, which is
# nearly always close enough to the event.
_REPETITIONS = 3
# Relative width to which an event is bracketed on the interpolant.
_BRACKET_WIDTH = 1e-6
# Fraction of a step within which the Taylor polynomial from its end reaches an event. Its
# remainder is the fourth power of this fraction of a term that the tolerance has made small
# over the whole step; the remainder of second derivatives is its square. `_OVERSHOOT` in
# `solver_steps` is half of it, and has to be changed with it.
_REACH = 2e-3
# Within its reach, Newton's method takes these steps. The relative change of the slope on the
# way is at most `_BEND`, which each step squares: three would do for values, a fourth one makes
# second derivatives exact.
_NEWTON_STEPS = 4
_BEND = 1e-2


class EventFunctions(NamedTuple):
    """Event functions g(y) of a segment, each positive before its event.

    ==========  =======================  =======================
    event       g of a rising block      g of a falling block
    ==========  =======================  =======================
    `PEAK`      velocity / p             -velocity / p
    `CONTACT`   pi / 2 - rotation        rotation
    `CRITICAL`  alpha_c - rotation       none (infinite)
    ==========  =======================  =======================

    A block that begins its segment beyond the critical angle has no `CRITICAL` either.
    """

    equation: Equation
    rising: Booleans
    crossed: Booleans  # the segment begins beyond the critical angle
    earliest: Reals  # time from which on an event counts

    def weigh(self, event: Integers) -> tuple[Reals, Reals]:
        """Return the derivatives of an event function over rotation and velocity."""
        p = jnp.sqrt(self.equation.p_squared)
        up = jnp.where(self.rising, 1, -1).astype(p.dtype)
        peaks = event == PEAK
        return jnp.where(peaks, 0, -up), jnp.where(peaks, up / p, 0)

    def evaluate(self, y: Reals) -> Reals:
        """Evaluate the functions of `PEAK`, `CONTACT` and `CRITICAL` for a state."""
        rotation, velocity = y
        _, peak = self.weigh(jnp.array(PEAK))
        contact = jnp.where(self.rising, TOPPLED_ROTATION - rotation, rotation)
        below = self.rising & ~self.crossed
        critical = jnp.where(below, self.equation.critical_angle - rotation, jnp.inf)
        return jnp.stack([peak * velocity, contact, critical])


class SegmentState(NamedTuple):
    """The state of the loop over the steps of a segment; see the table in `_advance`."""

    elapsed: Reals  # time since the segment began
    y: Reals  # rotation and velocity at that time
    rates: Reals  # of both
    step_end: Reals  # time at which the next step is to end
    wanted_length: Reals  # of the next step, before kinks and peaks limited it
    repetitions: Integers  # number of the repetition that comes next, 0 for a new step
    event: Integers  # `PEAK`, `CONTACT` or `CRITICAL` once one was found, else `STOP`
    done: Booleans
    forces: ForceExtremes | None  # None where forces are not asked for
    steps: Integers  # number of steps that have been tried


def integrate_segment(
    stepper: Stepper,
    segment: Segment,
    length: Reals,
    y: Reals,
    beginning: tuple[Reals, Reals],
    *,
    moves: Booleans,
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
    beginning : tuple of Array
        Rates of both, and the end of the first step; see `choose_first_step`.
    moves : Array of bool
        Where this is False no step is taken.
    event_functions : EventFunctions, optional
        None for no events, as in a history, whose events are known.
    forces : ForceExtremes, optional
        Extremes so far.
    """
    zero = jnp.zeros_like(length)
    none = jnp.zeros((), int)
    begin = SegmentState(
        elapsed=zero,
        y=y,
        rates=beginning[0],
        step_end=jnp.minimum(beginning[1], length),
        wanted_length=zero,
        repetitions=none,
        event=none + STOP,
        done=~moves,
        forces=forces,
        steps=none,
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
    end = before.step_end
    tried, accepted, next_length = stepper.step(
        segment, before.elapsed, end, before.y, before.rates
    )
    arc = tried
    repeats = before.repetitions > 0
    event = before.event
    advances = accepted & ~repeats
    detected = jnp.array(False)
    reached = jnp.array(False)
    bracket_end = end
    if event_functions is not None:
        # Over all of a step more than one function may have changed its sign: the first
        # repetition, which ends within the bracket of the earliest, decides again.
        values = event_functions.evaluate(arc.last)
        ended = values <= 0
        detected = advances & (end > event_functions.earliest) & ended.any()
        advances = advances & ~detected
        event = jnp.where(detected | (before.repetitions == 1), jnp.argmin(values), event)
        # The last repetition counts wherever it ends.
        may_reach = repeats | (ended.sum() == 1)
        forced = before.repetitions >= _REPETITIONS
        reached, arc = jax.lax.cond(
            repeats | detected,
            lambda: _reach_event(
                segment, event_functions, arc, event, values, may_reach, forced
            ),
            lambda: (reached, arc),
        )
        misses = detected & ~reached
        bracket_end = _bracket_event(event_functions, tried, misses)
        bracket_end = jnp.where(misses, bracket_end, arc.end)
    done = (advances & (end >= length)) | reached
    repetitions = jnp.where((repeats | detected) & ~reached, before.repetitions + 1, 0)

    # Steps that are rejected or will be repeated leave the state where it was.
    counts = advances | done
    elapsed = jnp.where(counts, arc.end, before.elapsed)
    y = jnp.where(counts, arc.last, before.y)
    rates = jnp.where(counts, arc.last_rates, before.rates)
    forces = before.forces
    if forces is not None:
        forces = jax.lax.cond(
            counts,
            lambda so_far: add_step(so_far, segment, arc),
            lambda so_far: so_far,
            forces,
        )

    # A kink of the input cuts steps short, and from a short step the controller proposes a
    # short one. Its proposal before the cut is kept.
    wanted = jnp.where(advances, jnp.maximum(next_length, before.wanted_length), next_length)
    step_end = limit_step(segment, length, elapsed, elapsed + wanted, y, rates[1])
    step_end = jnp.where(repeats | detected, bracket_end, step_end)

    # Written so that a NaN counts as no progress.
    stuck = ~done & ~repeats & ~detected & ~(step_end > elapsed)
    return SegmentState(
        elapsed=elapsed,
        y=jnp.where(stuck, jnp.nan, y),
        rates=rates,
        step_end=step_end,
        # Only a step that advances has a proposal that a kink may have cut.
        wanted_length=jnp.where(advances, wanted, 0),
        repetitions=repetitions,
        event=event,
        done=done | stuck,
        forces=forces,
        steps=before.steps + 1,
    )


def _bracket_event(event_functions: EventFunctions, arc: Arc, misses: Booleans) -> Reals:
    """Bracket the event in a step by bisection on its interpolant; return the later end.

    Only if `misses`: otherwise the end of the step is returned.
    """
    # A bisection has no meaningful derivatives; the refinements have the right ones.
    event_functions, arc = jax.lax.stop_gradient((event_functions, arc))
    limits = jnp.finfo(arc.end.dtype)
    # Below this time the relative width of a bracket would underflow: the loop would not end.
    smallest = float(limits.tiny) / float(limits.eps)

    def is_wide(bracket: tuple[Reals, Reals]) -> Booleans:
        width = _BRACKET_WIDTH * jnp.maximum(bracket[1], smallest)
        return misses & (bracket[1] - bracket[0] > width)

    def halve(bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        middle = 0.5 * (bracket[0] + bracket[1])
        y = arc.interpolate((middle - arc.begin) / (arc.end - arc.begin))
        values = event_functions.evaluate(jnp.stack(y))
        ended = (values.min() <= 0) & (middle > event_functions.earliest)
        return jnp.where(ended, bracket[0], middle), jnp.where(ended, middle, bracket[1])

    return jax.lax.while_loop(is_wide, halve, (arc.begin, arc.end))[1]


def _reach_event(
    segment: Segment,
    event_functions: EventFunctions,
    arc: Arc,
    event: Integers,
    values: Reals,
    may_reach: Booleans,
    forced: Booleans,
) -> tuple[Booleans, Arc]:
    """Go from the end of a step to an event close to it, along the Taylor polynomial.

    Parameters
    ----------
    segment : Segment
    event_functions : EventFunctions
    arc : Arc
        The step.
    event : Array of int
    values : Array, shape (3,)
        Of the event functions at the end of the step.
    may_reach : Array of bool
        False where several events lie in the step.
    forced : Array of bool
        Whether the segment ends here in any case.

    Returns
    -------
    reached : Array of bool
        Whether the segment ends here.
    arc : Arc
        The step to the event; where the event is not reached, up to a better guess of its time.
    """
    end = arc.end
    rotation, velocity = arc.last

    def differentiate_ground(time: Reals) -> tuple[Reals, Reals]:
        return jax.jvp(segment.ground, (time,), (jnp.ones_like(time),))[1]

    first, second = jax.jvp(differentiate_ground, (end,), (jnp.ones_like(end),))
    inputs = (jnp.stack(part) for part in zip(segment.ground(end), first, second, strict=True))
    acceleration, jerk, snap = segment.equation.expand_acceleration(
        rotation, velocity, *inputs
    )
    # Rotation and velocity as polynomials in the time after the end, of the powers 1 to 4.
    rates = velocity, 0.5 * acceleration, jerk / 6, snap / 24
    velocity_rates = acceleration, 0.5 * jerk, snap / 6, jnp.zeros_like(end)
    weight, rate_weight = event_functions.weigh(event)
    slope, bend, third, fourth = (
        weight * r + rate_weight * v for r, v in zip(rates, velocity_rates, strict=True)
    )
    value = values[event]
    # A function that does not fall here has no event here: the end of the step is kept.
    falls = slope < 0
    steep = jnp.where(falls, slope, -1)
    newton = value / steep
    ratio = newton * bend / steep
    near = falls & (jnp.abs(newton) <= _REACH * (end - arc.begin))
    near = near & (jnp.abs(ratio) <= _BEND) & (end - newton > event_functions.earliest)

    def take_newton_step(_: object, back: Reals) -> Reals:
        change = back * (slope + back * (bend + back * (third + back * fourth)))
        tangent = slope + back * (2 * bend + back * (3 * third + back * 4 * fourth))
        return back - (value + change) / jnp.where(near, tangent, -1)

    back = jax.lax.fori_loop(0, _NEWTON_STEPS, take_newton_step, jnp.zeros_like(end))
    # Out of reach, Halley's method guesses the time, as a series to the second power of
    # Newton's step, which has no denominator that could vanish. A move that leaves the
    # bracket, with room for the error of the interpolant, is dropped, for example where a
    # segment ends as soon as it begins and the slope is nearly 0. In the last repetition the
    # derivative of the move still counts.
    move = jnp.where(falls, newton * (1 + ratio), 0)
    fixed = jax.lax.stop_gradient(move)
    stays = jnp.abs(fixed) > 1e3 * _BRACKET_WIDTH * end
    reached = (near & may_reach) | forced
    shift = jnp.where(near, back, fixed - move)
    guess = jax.lax.stop_gradient(end) - jnp.where(stays, 0, fixed)

    def follow(rates: tuple[Reals, ...]) -> Reals:
        first, second, third, fourth = rates
        return shift * (first + shift * (second + shift * (third + shift * fourth)))

    last = arc.last + jnp.stack([follow(rates), follow(velocity_rates)])
    last_rates = jnp.stack([last[1], acceleration + shift * (jerk + 0.5 * shift * snap)])
    time = jnp.where(reached, end + shift, guess)
    return reached, arc._replace(end=time, last=last, last_rates=last_rates)
