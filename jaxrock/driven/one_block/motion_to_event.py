"""A block in motion from one event to the next, and what the event does to it.

The loop takes steps of a segment. A step in which the segment ends is located on the
interpolant of the solver and then repeated with the length that ends there, improved by
Halley's method: each repetition but the last improves the time, the first one its value, the
second its two derivatives as well.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...impact import velocity_after_impact
from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from ..scene import Driven
from .contact_forces import Forces, with_step
from .solver_steps import Segment, Step, Stepper, close_to, first_step, limited
from .uplift import Uplifts

REST, RISING, FALLING, TOPPLED = range(4)
# How a segment ends: the velocity vanishes; the rotation reaches pi / 2 or, falling, 0; it
# passes the critical angle; the time is over.
PEAK, CONTACT, CRITICAL, STOP = range(4)

_MAX_STEPS = 2**20  # of a segment
_REPETITIONS = 3  # of the step in which it ends
_LOCATED = 1e-6  # relative accuracy of its end on the interpolant
_SETTLED = 1e-3  # part of `rtol` by which all further bounces may change the motion


class State(NamedTuple):
    """The motion up to an event."""

    time: Reals
    side: Reals
    rotation: Reals
    velocity: Reals
    phase: Integers
    events: Integers
    impacts: Integers
    last_impact: Reals  # its time, and the velocity just before it
    peak: Reals
    peak_time: Reals
    crossing: Reals
    margin: Reals
    forces: Forces | None
    balanced: Booleans  # whether it has stood in balance for a time
    failed: Booleans

    @property
    def y(self) -> Reals:
        """Rotation and velocity."""
        return jnp.stack([self.rotation, self.velocity])


@dataclass(frozen=True)
class Integration:
    """What all steps of the loop have in common."""

    driven: Driven
    equation: Equation
    stepper: Stepper
    rtol: Any
    uplifts: Uplifts

    def segment(self, time: Reals, side: Reals, acts: Booleans) -> Segment:
        """Begin a segment at a time."""
        return Segment(self.equation, self.driven.motion, time, side, acts)


class EventFunctions(eqx.Module):
    """Event functions g(y), each positive before its event: the ends of a segment."""

    equation: Equation
    rising: Booleans
    crossed: Booleans
    hold: Reals  # time before which it does not end

    def left(self, y: Reals) -> Reals:
        """Compute event functions, positive until it ends with `PEAK`, `CONTACT`, `CRITICAL`."""
        unit = 1 / self.equation.critical_angle
        none = jnp.zeros_like(self.hold)
        contact = jnp.where(self.rising, TOPPLED_ROTATION * unit, 0)
        critical = jnp.where(self.rising & ~self.crossed, 1, jnp.inf)
        return jnp.stack([none, contact, critical]) + self.change(y)

    @jax.jit
    def change(self, rate: Reals) -> Reals:
        """Compute the rate of the event functions, linear in the rate of the state."""
        unit = 1 / self.equation.critical_angle
        up = jnp.where(self.rising, unit, -unit)
        critical = jnp.where(self.rising & ~self.crossed, -unit, 0)
        peak = up / jnp.sqrt(self.equation.p_squared)
        return jnp.stack([peak * rate[1], -up * rate[0], critical * rate[0]])


class SegmentState(NamedTuple):
    """From step to step of a segment."""

    elapsed: Reals  # since it began
    y: Reals
    until: Reals  # end of the next step
    wanted: Reals  # length of a step, before it was limited
    repetitions: Integers  # of the last step; 0 before it is known
    event: Integers  # that ends the segment
    done: Booleans
    forces: Forces | None
    steps: Integers
    solver_state: Any


def flown(
    stepper: Stepper,
    segment: Segment,
    length: Reals,
    y: Reals,
    *,
    moves: Booleans,
    lifted: Booleans,
    ends: EventFunctions | None = None,
    forces: Forces | None = None,
) -> SegmentState:
    """From the state at its beginning to the end of a segment, or for its whole length."""
    zero = jnp.zeros_like(length)
    none = jnp.zeros((), int)
    until = first_step(segment, length, y, lifted)
    solver_state = stepper.begin(segment, y)
    begin = SegmentState(
        zero, y, until, zero, none, none + STOP, ~moves, forces, none, solver_state
    )
    return jax.lax.while_loop(
        lambda flight: ~flight.done & (flight.steps < _MAX_STEPS),
        lambda flight: _advance(stepper, segment, length, ends, flight),
        begin,
    )


def _advance(
    stepper: Stepper,
    segment: Segment,
    length: Reals,
    ends: EventFunctions | None,
    flight: SegmentState,
) -> SegmentState:
    """One step, or one more repetition of the last."""
    step = stepper.step(segment, flight.elapsed, flight.until, flight.y, flight.solver_state)
    repeats = flight.repetitions > 0
    event = flight.event
    goes_on = step.accepted & ~repeats
    found = jnp.array(False)
    if ends is not None:
        left = jax.lax.stop_gradient(ends).left(jax.lax.stop_gradient(step.y))
        found = goes_on & (flight.until > ends.hold) & (left.min() <= 0)
        goes_on = goes_on & ~found
        event = jnp.where(found | (flight.repetitions == 1), jnp.argmin(left), event)
    repetitions = jnp.where(repeats | found, flight.repetitions + 1, 0)
    done = (goes_on & (flight.until >= length)) | (repetitions > _REPETITIONS)
    counts = goes_on | done

    elapsed = jnp.where(counts, flight.until, flight.elapsed)
    y = jnp.where(counts, step.y, flight.y)
    wanted = jnp.where(goes_on, jnp.maximum(step.next_length, flight.wanted), step.next_length)
    forces = flight.forces
    fixed = jax.lax.stop_gradient(segment)
    if forces is None:
        acceleration = fixed.field(*jax.lax.stop_gradient((elapsed, y)))[1]
    else:
        times = jnp.stack([flight.elapsed, flight.until])
        states = jnp.stack([flight.y, step.y], axis=1)
        accelerations = fixed.field(*jax.lax.stop_gradient((times, states)))[1]
        acceleration = jnp.where(goes_on, accelerations[1], accelerations[0])
        forces = with_step(forces, segment, times, states, accelerations, counts)
    until = limited(segment, length, elapsed, elapsed + wanted, y, acceleration)
    if ends is not None:
        following = until
        until = jax.lax.switch(
            jnp.where(found, 2, jnp.where(repeats, 1, 0)),
            [
                lambda: following,
                lambda: _improved(segment, ends, flight.until, step.y, event),
                lambda: _located(stepper, ends, flight, step),
            ],
        )
    stuck = ~done & ~repeats & ~found & ~(until > elapsed)
    y = jnp.where(stuck, jnp.nan, y)
    wanted = jnp.where(goes_on, wanted, 0)
    done = done | stuck
    steps = flight.steps + 1
    states = step.solver_state, flight.solver_state
    solver_state = jax.tree.map(lambda new, old: jnp.where(goes_on, new, old), *states)
    return SegmentState(
        elapsed, y, until, wanted, repetitions, event, done, forces, steps, solver_state
    )


def _located(
    stepper: Stepper, ends: EventFunctions, flight: SegmentState, step: Step
) -> Reals:
    """Locate where the segment ends in a step, nearly, by bisection on the interpolant."""
    ends, flight, step = jax.lax.stop_gradient((ends, flight, step))
    limits = jnp.finfo(flight.elapsed.dtype)
    smallest = float(limits.tiny) / float(limits.eps)  # below it a bracket underflows

    def wide(bracket: tuple[Reals, Reals]) -> Booleans:
        return bracket[1] - bracket[0] > _LOCATED * jnp.maximum(bracket[1], smallest)

    def halve(bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        middle = 0.5 * (bracket[0] + bracket[1])
        y = stepper.interpolated(flight.elapsed, flight.until, step, middle)
        ended = (ends.left(y).min() <= 0) & (middle > ends.hold)
        return jnp.where(ended, bracket[0], middle), jnp.where(ended, middle, bracket[1])

    return jax.lax.while_loop(wide, halve, (flight.elapsed, flight.until))[1]


def _improved(
    segment: Segment, ends: EventFunctions, time: Reals, y: Reals, event: Integers
) -> Reals:
    """Refine the end of a segment by Halley's method, from a time and the state there."""
    rate = segment.field(time, y)
    _, change = jax.jvp(segment.field, (time, y), (jnp.ones_like(time), rate))
    parts = ends.left(y), ends.change(rate), ends.change(change)
    value, slope, curvature = (part[event] for part in parts)
    steep = jnp.where(slope < 0, slope, -1)
    newton = value / steep
    # The series of Halley's step, to the second power of Newton's.
    move = newton + 0.5 * newton * newton * curvature / steep
    # No further than the search was good for. Where it would go further, as where a segment
    # ends as it begins, it still gives the time its derivative.
    near = jnp.abs(move) <= 1e3 * _LOCATED * time
    move = jnp.where(near, move, move - jax.lax.stop_gradient(move))
    return jnp.where(slope < 0, time - move, time)


def forces_until(
    integration: Integration, state: State, until: Reals, acts: Booleans
) -> Forces | None:
    """Add the forces under a block that moves with the ground until some time."""
    if state.forces is None:
        return None
    demand, normal = integration.uplifts.forces(state.time, until, acts)
    loss = jax.lax.stop_gradient(jnp.where(normal > 0, jnp.inf, until))
    return state.forces.and_also(demand, normal, loss)


def _balance(
    integration: Integration, state: State, segment: Segment, stop: Reals
) -> tuple[Booleans, Booleans, Reals, Forces | None]:
    """Let a block in balance wait until the input changes.

    Between two knots the input changes if it differs at the second one. Returns whether the
    block waits, whether it otherwise falls back to the ground, the end of the segment, and the
    forces.
    """
    until = jnp.where(segment.acts, integration.uplifts.next_knot(state.time, stop), stop)
    fixed, after, y = jax.lax.stop_gradient((segment, until - state.time, state.y))
    later = fixed.field(after, y)[1]
    waits = (later == 0) | ~segment.acts
    meanwhile = forces_until(integration, state, until, segment.acts)
    forces = jax.tree.map(lambda a, b: jnp.where(waits, a, b), meanwhile, state.forces)
    return waits, later < 0, jnp.where(waits, until, stop), forces


def fly(integration: Integration, state: State, stop: Reals) -> State:
    """Through a segment and the event at its end, unless the block has come to rest."""
    motion = integration.driven.motion
    critical_angle = integration.equation.critical_angle
    segment = integration.segment(state.time, state.side, motion.acts(state.time))
    fixed, y = jax.lax.stop_gradient((segment, state.y))
    acceleration = fixed.field(jnp.zeros_like(stop), y)[1]
    # A block that has stopped at an edge of the input may turn.
    still = state.velocity == 0
    lifted = (state.rotation == 0) & (state.velocity == 0)
    on_ground = jnp.where(state.phase == FALLING, REST, state.phase)
    down = jnp.where(state.rotation > 0, FALLING, on_ground)
    phase = jnp.where(still & (acceleration < 0), down, state.phase)
    phase = jnp.where(still & (acceleration > 0), RISING, phase)
    balanced = still & (state.rotation > 0) & (acceleration == 0)
    # A branch, since it looks at all of the input, and hardly ever.
    waits, falls, stop, forces = jax.lax.cond(
        balanced,
        lambda: _balance(integration, state, segment, stop),
        lambda: (balanced, balanced, stop, state.forces),
    )
    phase = jnp.where(balanced, jnp.where(falls, FALLING, RISING), phase)
    state = state._replace(balanced=state.balanced | waits)
    # One that has just been lifted has no acceleration but by rounding, which must not put it
    # down again; nor is a time that the clock cannot resolve one in which it moves. One that
    # leaves its balance begins as slowly.
    slow = lifted | balanced
    hold = jnp.where(slow, integration.uplifts.lasting + close_to(motion, state.time), 0)
    end = flown(
        integration.stepper,
        segment,
        stop - state.time,
        state.y,
        moves=(phase != REST) & ~waits,
        lifted=lifted,
        ends=EventFunctions(
            integration.equation, phase == RISING, state.rotation >= critical_angle, hold
        ),
        forces=forces,
    )
    state = state._replace(phase=phase)
    return jax.lax.cond(
        phase == REST, lambda: state, lambda: _land(integration, stop, state, end)
    )


def _land(integration: Integration, stop: Reals, state: State, flight: SegmentState) -> State:
    """From the end of a segment to what follows it: a peak, an impact, rest."""
    equation = integration.equation
    restitution = integration.driven.restitution
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
    rotation = jnp.where(topples, TOPPLED_ROTATION, rotation)
    higher = rotation > state.peak
    phase = jnp.where(turns, jnp.where(rising, FALLING, RISING), state.phase)
    phase = jnp.where(topples, TOPPLED, phase)

    # Impact: the block goes on to the other side with what restitution leaves.
    arriving = -velocity
    leaving = jnp.where(lands, velocity_after_impact(restitution, arriving), 0)
    zero = jnp.zeros_like(time)
    other_side = integration.segment(time, -state.side, integration.driven.motion.acts(time))
    fixed = jax.lax.stop_gradient((other_side, jnp.stack([zero, leaving])))
    deceleration = -fixed[0].field(zero, fixed[1])[1]
    # Bounces under a constant deceleration end in finite time. Once that is short beside the
    # tolerance, and the velocity is small beside what the block has had, or the clock cannot
    # resolve that time, it is at rest. Where the input lifts the block again meanwhile, all
    # that is dropped is this velocity. The times are multiplied by the deceleration.
    pressed = deceleration > 0
    lost = (1 - restitution) * jnp.where(pressed, deceleration, 1)
    short = 2 * leaving * jnp.sqrt(equation.p_squared) <= _SETTLED * integration.rtol * lost
    slow = leaving**2 <= 2 * integration.rtol**2 * deceleration * state.peak
    unresolved = 2 * leaving <= close_to(integration.driven.motion, time) * lost
    rests = lands & pressed & short & (slow | unresolved)
    return state._replace(
        time=time,
        side=jnp.where(lands, -state.side, state.side),
        rotation=jnp.where(lands, 0, rotation),
        velocity=jnp.where(rests, 0, jnp.where(lands, leaving, velocity)),
        phase=jnp.where(lands, jnp.where(rests, REST, RISING), phase),
        impacts=jnp.where(lands, state.impacts + 1, state.impacts),
        last_impact=jnp.where(
            lands, jnp.stack([time, -state.side * arriving]), state.last_impact
        ),
        peak=jnp.where(higher, rotation, state.peak),
        peak_time=jnp.where(higher, time, state.peak_time),
        crossing=jnp.where(crosses, time, state.crossing),
        forces=flight.forces,
        failed=~(flight.done & jnp.isfinite(time + rotation + velocity)),
    )
