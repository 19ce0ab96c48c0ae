"""Driven motion from event to event: uplift, impact, peak, and the edges of the input.

Each step of the loop waits for the input to lift a block at rest, or follows a block in motion
through one segment (`fly`). Then it logs the event.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...numerics import smaller, through_jacobian
from ...resonance import RockingModel
from ...validation import Booleans, Reals, guarding, replace_invalid
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION, free_motion_margins, smaller_margin
from ..scene import Driven
from .contact_forces import Forces
from .motion_to_event import (
    FALLING,
    REST,
    RISING,
    TOPPLED,
    Integration,
    State,
    fly,
    forces_until,
)
from .response import Events, Response, Status
from .solver_steps import Stepper, close_to
from .uplift import Uplifts

_MAX_EVENTS = 2**22
_EVENTS_PER_IMPACT = 4  # for which the list of events has room


_Carry = tuple[State, tuple[Reals, Reals]]  # with the lists of events and impacts


class Followed(NamedTuple):
    """A response, its peak rotation, and the time and velocity of the last impact."""

    response: Response
    peak: Reals
    struck: Reals


def run(
    driven: Driven,
    *,
    rtol: Any,
    atol: Any,
    model: RockingModel,
    max_impacts: int = 0,
    once: bool = False,
    forced: bool = True,
    method: str = "Tsit5",
) -> Followed:
    """Follow a block to the end of the duration, or with `once` to its first impact.

    Without `forced`, friction demand and normal force are left out.
    """
    with guarding():
        driven, valid = replace_invalid(driven)
        equation = Equation.of(driven.block, model)
        valid = jnp.all(valid)
    uplifts = Uplifts.of(equation, driven.motion)
    dtype = driven.duration.dtype
    integration = Integration(driven, equation, Stepper(method, rtol, atol), rtol, uplifts)

    def goes_on(carry: _Carry) -> Booleans:
        state, _ = carry
        wanted = (state.impacts == 0) | (not once)
        wanted = wanted & (state.time < driven.duration) & (state.phase != TOPPLED)
        return ((state.events == 0) | wanted) & ~state.failed & (state.events < _MAX_EVENTS)

    def step(carry: _Carry) -> _Carry:
        before, lists = carry
        state = _step(integration, before)
        # Logged outside of the branches of `_step`, which would copy the lists.
        if max_impacts:
            place = jnp.where(state.impacts > before.impacts, before.impacts, max_impacts)
            event = jnp.stack([state.time, state.side, state.rotation, state.velocity])
            update = jax.lax.dynamic_update_slice
            events = update(lists[0], event[None], (before.events, 0))
            lists = events, update(lists[1], state.last_impact[None], (place, 0))
        return state, lists

    zero = jnp.zeros((), dtype)
    none = jnp.zeros((), int)
    fields: dict[str, Any] = dict.fromkeys(State._fields, zero)
    fields |= dict.fromkeys(("phase", "events", "impacts"), none)
    infinite = jnp.full_like(zero, jnp.inf)
    forces = Forces(zero, infinite, infinite) if forced else None
    fields |= {"last_impact": jnp.zeros(2, dtype), "forces": forces, "failed": ~valid}
    fields["balanced"] = jnp.array(False)
    # The last row of each list is for what has no place.
    max_events = _EVENTS_PER_IMPACT * max_impacts
    unknown = jnp.full((max_events + 1, 4), jnp.nan, dtype)
    begin = State(**fields), (unknown, unknown[: max_impacts + 1, :2])
    state, lists = jax.lax.while_loop(goes_on, step, begin)
    full = (state.impacts > max_impacts) | (state.events > max_events)
    response = _response(integration, state, lists, valid, full)
    return Followed(response, response.peak_rotation, state.last_impact)


# Compiled once for all tolerances, with derivatives in both modes.
follow = eqx.filter_jit(through_jacobian(run))


def _response(
    integration: Integration,
    state: State,
    lists: tuple[Reals, Reals],
    valid: Booleans,
    full: Booleans,
) -> Response:
    """Make the response whose last event is given; NaN where it is not known."""
    broken = (state.failed & valid) | (state.events >= _MAX_EVENTS)
    status = jnp.where(state.balanced, Status.BALANCED, Status.COMPLETE)
    status = jnp.where(broken, Status.STOPPED, jnp.where(full, Status.LIST_FULL, status))
    good = valid & ~broken
    events, impacts = (rows[:-1] for rows in lists)
    overturned = good & ((state.phase == TOPPLED) | (state.margin < 0))
    demand, normal, loss = state.forces or (jnp.nan, jnp.nan, jnp.nan)
    known = {
        "final_rotation": state.side * state.rotation + 0.0,  # no negative zero
        "final_velocity": state.side * state.velocity + 0.0,
        "peak_rotation": state.peak,
        "peak_time": state.peak_time,
        "margin": state.margin,
        "friction_demand": demand,
        "normal_force": normal,
        "contact_loss_time": jnp.where(loss < jnp.inf, loss, jnp.nan),
    }
    return Response(
        overturned=overturned,
        overturning_time=jnp.where(overturned, state.crossing, jnp.nan),
        impacts=state.impacts,
        impact_times=impacts[:, 0],
        impact_velocities=impacts[:, 1],
        at_rest=good & (state.phase == REST),
        status=jnp.where(valid, status, Status.INVALID),
        events=Events(*events.T),
        scene=integration.driven,
        model=integration.equation.model,
        **{name: jnp.where(good, value, jnp.nan) for name, value in known.items()},
    )


def _step(integration: Integration, before: State) -> State:
    """From an event to the next."""
    driven = integration.driven
    motion = integration.driven.motion
    begins = before.events == 0
    acts = motion.acts(before.time)
    # The next edge of the input, or the end; of those that coincide, the end.
    stop = driven.duration
    latest = driven.duration - close_to(motion, driven.duration)
    for edge in (motion.end, motion.start):
        stop = jnp.where((edge > before.time) & (edge < latest), edge, stop)
    state = jax.lax.switch(
        jnp.where(begins, 0, jnp.where(before.phase == REST, 1, 2)),
        [
            lambda state: _start(integration, state),
            lambda state: _wait(integration, state, stop),
            lambda state: fly(integration, state, stop),
        ],
        before,
    )
    state = _with_corner(integration, state, acts & ~begins)
    # The overturning criterion is read where the input ends.
    input_end = smaller(motion.end, driven.duration)
    reached = (state.time >= input_end) | (state.phase == TOPPLED)
    reads = begins | ((before.time < input_end) & reached)
    margins = free_motion_margins(
        integration.equation, driven.restitution, state.rotation, state.velocity
    )
    margin = jnp.where(reads, smaller_margin(*margins), state.margin)
    return state._replace(margin=margin, events=before.events + 1)


def _start(integration: Integration, state: State) -> State:
    """Return the initial state, on the side to which the block is rotated or moves."""
    driven = integration.driven
    towards = jnp.where(driven.rotation == 0, driven.velocity, driven.rotation)
    side = jnp.where(towards < 0, -1, 1).astype(towards.dtype)
    rotation = side * driven.rotation
    velocity = side * driven.velocity
    phase = jnp.where(velocity < 0, FALLING, RISING)
    phase = jnp.where((rotation == 0) & (velocity == 0), REST, phase)
    crossed = rotation >= integration.equation.critical_angle
    return state._replace(
        side=side,
        rotation=rotation,
        velocity=velocity,
        phase=jnp.where(rotation >= TOPPLED_ROTATION, TOPPLED, phase),
        peak=rotation,
        crossing=jnp.where(crossed, state.time, jnp.nan),
    )


def _wait(integration: Integration, state: State, stop: Reals) -> State:
    """At rest until the input lifts the block, or until the next edge of the input."""
    lifted, time, side = integration.uplifts.following(state.time, stop)
    acts = integration.driven.motion.acts(state.time)
    lifted = lifted & acts
    until = jnp.where(lifted, time, stop)
    return state._replace(
        forces=forces_until(integration, state, until, acts),
        time=until,
        side=jnp.where(lifted, side, state.side),
        phase=jnp.where(lifted, RISING, REST),
    )


def _with_corner(integration: Integration, state: State, acted: Booleans) -> State:
    """Return the state at the corner of the input with which it coincides, where there is one.

    This changes derivatives only. Up to the corner the block moves for a time that is 0 but
    has a derivative, under the input as it is before the corner.
    """
    motion = integration.driven.motion
    duration = integration.driven.duration
    time = state.time
    near = close_to(motion, time)
    kink = motion.next_kink(time - near)
    corner = jnp.where(kink <= time + near, kink, time)
    corner = jnp.where(~acted & (time == motion.start), motion.start, corner)
    corner = jnp.where(acted & (time == motion.end), motion.end, corner)
    corner = jnp.where(time >= duration, duration, corner)
    move = corner - time
    move = move - jax.lax.stop_gradient(move)
    stays = (state.phase == REST) | (state.phase == TOPPLED)
    segment = integration.segment(time, state.side, acted)
    rate = segment.field(jnp.zeros_like(move), state.y)
    rotation, velocity = state.y + jnp.where(stays, 0, move) * rate
    return state._replace(time=time + move, rotation=rotation, velocity=velocity)
