"""A block in motion from one event to the next, and what the event does to it.

The inner loop takes steps of a segment. A step in which the segment ends is located on the
interpolant of the solver and then repeated with the length that ends there, improved by
Halley's method: each repetition but the last improves the time, the first one its value, the
second its two derivatives as well.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..impact import velocity_after_impact
from ..validation import Booleans, Reals
from .contact_forces import with_step
from .motion_state import FALLING, REST, RISING, TOPPLED, Ints, Problem, State
from .solver_steps import (
    CONTACT,
    CRITICAL,
    PEAK,
    STOP,
    EventFunctions,
    Segment,
    Step,
    close_to,
    first_step,
    limited,
)

_MAX_STEPS = 2**20  # of a segment
_REPETITIONS = 3  # of the step in which it ends
_LOCATED = 1e-6  # relative accuracy of its end on the interpolant
_SETTLED = 1e-3  # part of `rtol` by which all further bounces may change the motion


class _Flight(NamedTuple):
    """From step to step of a segment."""

    elapsed: Reals  # since it began
    y: Reals
    until: Reals  # end of the next step
    wanted: Reals  # length of a step, before it was limited
    repetitions: Ints  # of the last step; 0 before it is known
    event: Ints  # that ends the segment
    done: Booleans
    forces: tuple[Reals, Reals]
    steps: Ints
    solver_state: Any


class _Context(NamedTuple):
    """What the steps of a segment have in common."""

    problem: Problem
    segment: Segment
    events: EventFunctions
    hold: Reals  # time before which it does not end
    length: Reals


def fly(problem: Problem, state: State, stop: Reals) -> State:
    """Through a segment and the event at its end, unless the block has come to rest."""
    equation, motion = problem.equation, problem.motion
    segment = problem.segment(state.time, state.side, motion.acts(state.time))
    length, y, zero = stop - state.time, state.y, jnp.zeros_like(state.time)
    lifted = (state.rotation == 0) & (state.velocity == 0)
    acceleration = jax.lax.stop_gradient(segment).field(zero, jax.lax.stop_gradient(y))[1]
    state = state._replace(phase=_next_phase(state, acceleration))
    rising = state.phase == RISING
    crossed = state.rotation >= equation.critical_angle
    events = EventFunctions.of(equation, rising, crossed)
    # A block that has just been lifted has no acceleration but by rounding, which must not put
    # it down again; nor is a time that the clock cannot resolve one in which it moves.
    hold = jnp.where(lifted, problem.just_lifted + close_to(motion, state.time), 0)
    context = _Context(problem, segment, events, hold, length)
    none = jnp.zeros((), int)
    begin = _Flight(
        elapsed=zero,
        y=y,
        until=first_step(segment, length, y, lifted),
        wanted=zero,
        repetitions=none,
        event=none + STOP,
        done=state.phase == REST,
        forces=state.forces,
        steps=none,
        solver_state=problem.stepper.begin(segment, y),
    )
    end = jax.lax.while_loop(
        lambda flight: ~flight.done & (flight.steps < _MAX_STEPS),
        lambda flight: _advance(context, flight),
        begin,
    )
    return jax.lax.cond(
        state.phase == REST, lambda: state, lambda: _land(problem, stop, state, end)
    )


def _next_phase(state: State, acceleration: Reals) -> Ints:
    """The phase of a block that may have stopped at an edge of the input."""
    still = state.velocity == 0
    on_ground = jnp.where(state.phase == FALLING, REST, state.phase)
    down = jnp.where(state.rotation > 0, FALLING, on_ground)
    phase = jnp.where(still & (acceleration < 0), down, state.phase)
    return jnp.where(still & (acceleration > 0), RISING, phase)


def _advance(context: _Context, flight: _Flight) -> _Flight:
    """One step, or one more repetition of the last."""
    problem, segment, events, hold, length = context
    step = problem.stepper.step(
        segment, flight.elapsed, flight.until, flight.y, flight.solver_state
    )
    repeats = flight.repetitions > 0
    left = jax.lax.stop_gradient(events).value(jax.lax.stop_gradient(step.y))
    goes_on = step.accepted & ~repeats
    ends = goes_on & (flight.until > hold) & (left.min() <= 0)
    goes_on = goes_on & ~ends
    repetitions = jnp.where(repeats | ends, flight.repetitions + 1, 0)
    event = jnp.where(ends | (flight.repetitions == 1), jnp.argmin(left), flight.event)
    done = (goes_on & (flight.until >= length)) | (repetitions > _REPETITIONS)
    counts = goes_on | done

    times = jnp.stack([flight.elapsed, flight.until])
    states = jnp.stack([flight.y, step.y], axis=1)
    fixed_segment, *fixed = jax.lax.stop_gradient((segment, times, states))
    accelerations = fixed_segment.field(*fixed)[1]
    forces = flight.forces
    if problem.with_forces:
        forces = with_step(forces, segment, times, states, accelerations, counts)
    elapsed = jnp.where(counts, flight.until, flight.elapsed)
    y = jnp.where(counts, step.y, flight.y)
    wanted = jnp.where(goes_on, jnp.maximum(step.next_length, flight.wanted), step.next_length)
    acceleration = jnp.where(goes_on, accelerations[1], accelerations[0])
    until = limited(segment, length, elapsed, elapsed + wanted, y, acceleration)
    until = jax.lax.switch(
        jnp.where(ends, 2, jnp.where(repeats, 1, 0)),
        [
            lambda: until,
            lambda: _improved(segment, events, flight.until, step.y, event),
            lambda: _located(context, flight, step),
        ],
    )
    stuck = ~done & ~repeats & ~ends & ~(until > elapsed)
    return _Flight(
        elapsed=elapsed,
        y=jnp.where(stuck, jnp.nan, y),
        until=until,
        wanted=jnp.where(goes_on, wanted, 0),
        repetitions=repetitions,
        event=event,
        done=done | stuck,
        forces=forces,
        steps=flight.steps + 1,
        solver_state=jax.tree.map(
            lambda new, old: jnp.where(goes_on, new, old), step.solver_state, flight.solver_state
        ),
    )


def _located(context: _Context, flight: _Flight, step: Step) -> Reals:
    """Where the segment ends within a step, nearly: by bisection on the interpolant."""
    events, hold, flight, step = jax.lax.stop_gradient((context.events, context.hold, flight, step))
    limits = jnp.finfo(flight.elapsed.dtype)
    smallest = float(limits.tiny) / float(limits.eps)  # below it a bracket underflows

    def wide(bracket: tuple[Reals, Reals]) -> Booleans:
        return bracket[1] - bracket[0] > _LOCATED * jnp.maximum(bracket[1], smallest)

    def halve(bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        middle = 0.5 * (bracket[0] + bracket[1])
        stepper = context.problem.stepper
        y = stepper.interpolated(flight.elapsed, flight.until, step, middle)
        ended = (events.value(y).min() <= 0) & (middle > hold)
        return jnp.where(ended, bracket[0], middle), jnp.where(ended, middle, bracket[1])

    return jax.lax.while_loop(wide, halve, (flight.elapsed, flight.until))[1]


def _improved(
    segment: Segment, events: EventFunctions, time: Reals, y: Reals, event: Ints
) -> Reals:
    """The end of a segment by Halley's method, from a time and the state there."""
    rate = segment.field(time, y)
    _, change = jax.jvp(segment.field, (time, y), (jnp.ones_like(time), rate))
    parts = jnp.stack([events.value(y), events.slope(rate), events.slope(change)])
    value, slope, curvature = parts[:, event]
    steep = jnp.where(slope < 0, slope, -1)
    newton = value / steep
    # The series of Halley's step, to the second power of Newton's.
    move = newton + 0.5 * newton * newton * curvature / steep
    # No further than the search was good for. Where it would go further, as where a segment
    # ends as it begins, it still gives the time its derivative.
    near = jnp.abs(move) <= 1e3 * _LOCATED * time
    move = jnp.where(near, move, move - jax.lax.stop_gradient(move))
    return jnp.where(slope < 0, time - move, time)


def _land(problem: Problem, stop: Reals, state: State, flight: _Flight) -> State:
    """From the end of a segment to what follows it: a peak, an impact, rest."""
    equation, restitution = problem.equation, problem.driven.restitution
    rising = state.phase == RISING
    time = jnp.where(flight.event == STOP, stop, state.time + flight.elapsed)
    rotation, velocity = flight.y
    turns = flight.event == PEAK
    crosses = rising & (flight.event == CRITICAL)
    topples = rising & (flight.event == CONTACT)
    lands = ~rising & (flight.event == CONTACT)
    velocity = jnp.where(turns, 0, velocity)
    rotation = jnp.where(turns, jnp.maximum(rotation, 0), rotation)
    rotation = jnp.where(crosses, equation.critical_angle, rotation)
    rotation = jnp.where(topples, 0.5 * jnp.pi, rotation)
    higher = rotation > state.peak
    phase = jnp.where(turns, jnp.where(rising, FALLING, RISING), state.phase)
    phase = jnp.where(topples, TOPPLED, phase)

    # Impact: the block goes on to the other side with what restitution leaves.
    arriving = -velocity
    leaving = jnp.where(lands, velocity_after_impact(restitution, arriving), 0)
    zero = jnp.zeros_like(time)
    other_side = problem.segment(time, -state.side, problem.motion.acts(time))
    fixed = jax.lax.stop_gradient((other_side, jnp.stack([zero, leaving])))
    deceleration = -fixed[0].field(zero, fixed[1])[1]
    # Bounces under a constant deceleration end in finite time. Once that is short beside the
    # tolerance, the block is at rest. Both sides are times p and the deceleration.
    pressed = deceleration > 0
    lost = (1 - restitution) * jnp.where(pressed, deceleration, 1)
    bounces = 2 * leaving * jnp.sqrt(equation.p_squared)
    rests = lands & pressed & (bounces <= _SETTLED * problem.rtol * lost)
    return state._replace(
        time=time,
        side=jnp.where(lands, -state.side, state.side),
        rotation=jnp.where(lands, 0, rotation),
        velocity=jnp.where(rests, 0, jnp.where(lands, leaving, velocity)),
        phase=jnp.where(lands, jnp.where(rests, REST, RISING), phase),
        impacts=jnp.where(lands, state.impacts + 1, state.impacts),
        last_impact=jnp.where(lands, jnp.stack([time, -state.side * arriving]), state.last_impact),
        peak=jnp.where(higher, rotation, state.peak),
        peak_time=jnp.where(higher, time, state.peak_time),
        crossing=jnp.where(crosses, time, state.crossing),
        forces=flight.forces,
        failed=~(flight.done & jnp.isfinite(time + rotation + velocity)),
    )
