"""A block in motion from one event to the next, and what the event does to it.

Between two events lies a *segment*: the block stays on one side, and its rotation only grows
or only shrinks. `move_to_event` decides in which direction it goes, lets
`segment_integration` find the event in four stages (step, bracket, refine, differentiate), and
applies the event: a peak, an impact, the critical angle, a fall onto the side, or the end of
the time.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ...impact import side_after_impact, velocity_after_impact
from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from ..scene import Driven
from .contact_forces import ForceExtremes
from .segment_integration import (
    CONTACT,
    CRITICAL,
    PEAK,
    STOP,
    EventFunctions,
    SegmentState,
    integrate_segment,
)
from .solver_steps import Segment, Stepper, choose_first_step
from .uplift import UpliftTable

# Phases of the motion. The table in `follow_driven` has the step that follows each of them.
REST, RISING, FALLING, TOPPLED = range(4)

# A block may rest only if all further bounces end within this fraction of `rtol` / p; see
# `_apply_event`.
_REST_SHARE = 1e-3
# Shortest time that the clock resolves, in units of its rounding.
_RESOLVED = 8


class State(NamedTuple):
    """The motion up to an event, seen from the side on which the block stands."""

    time: Reals
    side: Reals  # +1 or -1
    rotation: Reals  # from the side on which it stands, 0 on the ground
    velocity: Reals  # positive away from the ground
    phase: Integers  # REST, RISING, FALLING or TOPPLED
    events: Integers  # number of events so far; the first one is the initial state
    impacts: Integers  # their number so far
    last_impact: Reals  # its time, and the signed velocity just before it
    peak: Reals  # largest rotation so far, to either side
    peak_time: Reals
    crossing: Reals  # time at which the block last passed the critical angle
    margin: Reals  # to overturning, of the last event at which it was read
    forces: ForceExtremes | None  # None where forces are not asked for
    balanced: Booleans  # whether it has stood in balance for a time
    failed: Booleans

    @property
    def y(self) -> Reals:
        """Rotation and velocity."""
        return jnp.stack([self.rotation, self.velocity])


@dataclass(frozen=True)
class Integration:
    """The scene and the method, which do not change from event to event."""

    driven: Driven
    equation: Equation
    stepper: Stepper
    uplifts: UpliftTable

    def begin_segment(self, time: Reals, side: Reals, acts: Booleans) -> Segment:
        """Begin a segment at a time, on a side, while the input `acts` or not."""
        return Segment(self.equation, self.driven.motion, time, side, acts)


def move_to_event(integration: Integration, state: State, stop: Reals) -> State:
    """Move a block through a segment, and apply the event at its end.

    A block that turns out to be at rest stays as it is, with the phase `REST`.
    """
    motion = integration.driven.motion
    segment = integration.begin_segment(state.time, state.side, motion.acts(state.time))
    lifted = (state.rotation == 0) & (state.velocity == 0)
    beginning = choose_first_step(segment, stop - state.time, state.y, lifted)
    acceleration = beginning[0][1]

    # The input may have jumped at this event. A block without velocity moves in the direction
    # of its acceleration now, whatever its phase before.
    still = state.velocity == 0
    # `FALLING` on the ground: its peak was at rotation 0, and it rests.
    grounded = jnp.where(state.phase == FALLING, REST, state.phase)
    down = jnp.where(state.rotation > 0, FALLING, grounded)
    phase = jnp.where(still & (acceleration < 0), down, state.phase)
    phase = jnp.where(still & (acceleration > 0), RISING, phase)
    # In balance the acceleration is exactly 0. Between two knots the input is monotone. So it
    # is constant if it is the same at the next knot, as on ground at rest: the block waits
    # until then. Otherwise the block begins to fall now, in the direction in which the input
    # at the next knot pushes it.
    balanced = still & (state.rotation > 0) & (acceleration == 0)
    knot = integration.uplifts.next_knot(state.time, stop)
    later = jax.lax.stop_gradient(segment.accelerate(knot - state.time, state.rotation))
    waits = balanced & ((later == 0) | ~segment.acts)
    stop = jnp.where(waits & segment.acts, knot, stop)
    phase = jnp.where(balanced, jnp.where(later < 0, FALLING, RISING), phase)
    state = state._replace(phase=phase, balanced=state.balanced | waits)

    # A block that has just been lifted has an acceleration of 0, up to rounding, and rounding
    # must not put it down again at once. A block that leaves its balance begins as slowly. The
    # rounding of the clock is added, since no motion is shorter.
    grace = integration.uplifts.grace_time + _RESOLVED * motion.time_rounding(state.time)
    earliest = jnp.where(lifted | balanced, grace, 0)
    end = integrate_segment(
        integration.stepper,
        segment,
        stop - state.time,
        state.y,
        beginning,
        moves=phase != REST,
        event_functions=EventFunctions(
            equation=integration.equation,
            rising=phase == RISING,
            crossed=state.rotation >= integration.equation.critical_angle,
            # In balance the block does not move at all.
            earliest=jnp.where(waits, jnp.inf, earliest),
        ),
        forces=state.forces,
    )
    return jax.lax.cond(
        phase == REST, lambda: state, lambda: _apply_event(integration, stop, state, end)
    )


def _apply_event(
    integration: Integration, stop: Reals, before: State, end: SegmentState
) -> State:
    """Apply the event at the end of a segment to the state before it.

    =========  ==========  ===================================  ==========================
    event      phase       state                                next phase
    =========  ==========  ===================================  ==========================
    PEAK       RISING      velocity 0                           FALLING
    PEAK       FALLING     velocity 0: it turns upward again    RISING
    CONTACT    FALLING     impact: C times as fast, on the      RISING, or REST if all
                           other side unless one-sided          further bounces are small
    CONTACT    RISING      rotation pi / 2                      TOPPLED
    CRITICAL   RISING      rotation alpha_c                     RISING
    STOP       either      as integrated                        as before
    =========  ==========  ===================================  ==========================

    At an event one number is known exactly. It replaces the integrated one, which differs by
    rounding.
    """
    equation = integration.equation
    restitution = integration.driven.restitution
    rising = before.phase == RISING
    time = jnp.where(end.event == STOP, stop, before.time + end.elapsed)
    rotation, velocity = end.y
    turns = end.event == PEAK
    crosses = rising & (end.event == CRITICAL)
    topples = rising & (end.event == CONTACT)
    lands = ~rising & (end.event == CONTACT)
    velocity = jnp.where(turns, 0, velocity)
    rotation = jnp.where(turns, jnp.maximum(rotation, 0), rotation)
    rotation = jnp.where(crosses, equation.critical_angle, rotation)
    rotation = jnp.where(topples, TOPPLED_ROTATION, rotation)
    higher = rotation > before.peak
    phase = jnp.where(turns, jnp.where(rising, FALLING, RISING), before.phase)
    phase = jnp.where(topples, TOPPLED, phase)

    # Impact: the block goes on, to the other side unless it is one-sided, with what
    # restitution leaves. How the input decelerates it there decides whether it bounces on.
    arriving = -velocity
    leaving = jnp.where(lands, velocity_after_impact(restitution, arriving), 0)
    zero = jnp.zeros_like(time)
    next_side = side_after_impact(equation.one_sided, before.side)
    motion = integration.driven.motion

    # First on the other side, then on the side that the block came from.
    sides = jnp.stack([next_side, before.side])
    segment = integration.begin_segment(time, sides, motion.acts(time))
    onward, back = jax.lax.stop_gradient(segment.accelerate(zero, zero))
    deceleration = -onward
    # From the velocity v, bounces under a constant deceleration d take 2 v / d, 2 C v / d, ...
    # and end after 2 v / ((1 - C) d), although they are infinitely many (Zeno). The block is
    # at rest if that time is
    #   short: within a small share of the tolerance, in units of 1 / p;
    # and if either
    #   slow: v is within the tolerance of sqrt(2 d peak), with which the block would rise to
    #     the largest rotation that it has had, or
    #   unresolved: the time is so short that the clock does not see it.
    # Only this velocity is dropped then, even where the input lifts the block again meanwhile.
    # Both sides of the conditions are multiplied by (1 - C) d, which may be 0.
    rtol, _ = integration.stepper.tolerances
    pressed = deceleration > 0
    lost = (1 - restitution) * jnp.where(pressed, deceleration, 1)
    short = 2 * leaving * jnp.sqrt(equation.p_squared) <= _REST_SHARE * rtol * lost
    slow = leaving**2 <= 2 * rtol**2 * deceleration * before.peak
    unresolved = 2 * leaving <= _RESOLVED * motion.time_rounding(time) * lost
    rests = lands & pressed & short & (slow | unresolved)
    # Where the input is beyond uplift on the side that the block came from, it lifts the block
    # when the next bounce ends: no value shows that, but the derivative with respect to C.
    returns = rests & (back > 0)
    bounce = 2 * (leaving - jax.lax.stop_gradient(leaving)) / jnp.where(returns, lost, 1)
    return before._replace(
        time=time + jnp.where(returns, bounce, 0),
        side=jnp.where(lands, next_side, before.side),
        rotation=jnp.where(lands, 0, rotation),
        velocity=jnp.where(rests, 0, jnp.where(lands, leaving, velocity)),
        phase=jnp.where(lands, jnp.where(rests, REST, RISING), phase),
        impacts=jnp.where(lands, before.impacts + 1, before.impacts),
        last_impact=jnp.where(
            lands, jnp.stack([time, -before.side * arriving]), before.last_impact
        ),
        peak=jnp.where(higher, rotation, before.peak),
        peak_time=jnp.where(higher, time, before.peak_time),
        crossing=jnp.where(crosses, time, before.crossing),
        forces=end.forces,
        failed=~(end.done & jnp.isfinite(time + rotation + velocity)),
    )
