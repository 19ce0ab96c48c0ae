"""Driven motion from event to event: uplift, impact, peak, and the edges of the input.

Each turn of the loop in `follow_driven` waits for the input to lift a block at rest, or moves
a block through one segment (`move_to_event`). Then it logs the event.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...host import Status
from ...numerics import (
    differentiate_by_jacobian,
    pick_smaller,
    refuse_reverse_mode,
    transpose_by,
)
from ...resonance import RockingModel
from ...validation import Booleans, Reals, guard_once, replace_invalid
from .. import Batch, call_as_one_function, follow_batch
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION, free_motion_margins, pick_smaller_margin
from ..scene import Driven, is_before_wall
from .contact_forces import ForceExtremes
from .motion_to_event import (
    FALLING,
    REST,
    RISING,
    TOPPLED,
    Integration,
    State,
    move_to_event,
)
from .response import Events, Response
from .solver_steps import Stepper
from .uplift import UpliftTable

# Number of events after which the response counts as stopped.
_MAX_EVENTS = 2**22
# Events for which the list has room, for each impact: more than the peak and the impact of a
# bounce, since uplift, the critical angle and edges of the input are events too.
_EVENTS_PER_IMPACT = 4
# What has derivatives in reverse mode with respect to samples. Steps of the batch end at each
# sample anyway: this tolerance adds few.
_SWEPT = "peak_rotation", "final_rotation", "final_velocity", "margin"
_SWEEP_TOLERANCE = 1e-12

_Lists = tuple[Reals, Reals]  # rows of events, and rows of impacts
_Carry = tuple[State, _Lists]


class FollowedMotion(NamedTuple):
    """A response, with the last impact for the half-cycle map."""

    response: Response
    last_impact: Reals  # time of the impact, and signed velocity just before it


def follow_driven(
    driven: Driven,
    *,
    rtol: Reals | float,
    atol: Reals | float,
    model: RockingModel,
    max_impacts: int = 0,
    until_first_impact: bool = False,
    with_forces: bool = True,
    method: str = "Tsit5",
) -> FollowedMotion:
    """Follow a block to the end of the duration, or only to its first impact.

    With `with_forces=False`, friction demand and normal force are left out.
    """
    # State of the loop | What is known                      | What happens next
    # ------------------|------------------------------------|---------------------------------
    # no event yet      | the initial state                  | it is the first event
    # REST              | the block stands on both edges     | `_wait`: until the input lifts
    #                   |                                    |   it (RISING), or to an edge of
    #                   |                                    |   the input (REST again)
    # RISING            | it moves away from the ground, or  | `move_to_event`: to a peak
    #                   |   has just been lifted             |   (FALLING), pi / 2 (TOPPLED),
    #                   |                                    |   the critical angle or an edge
    # FALLING           | it moves back to the ground        | `move_to_event`: to an impact
    #                   |                                    |   (RISING on the other side, on
    #                   |                                    |   the same one if one-sided, or
    #                   |                                    |   REST), a low point (RISING)
    #                   |                                    |   or an edge of the input
    # TOPPLED           | it lies on its side, for good      | the loop ends
    #
    # The loop also ends with the duration, after a failure and, with `until_first_impact`,
    # after an impact.
    with guard_once():
        driven, valid = replace_invalid(driven)
        equation = Equation.of(driven.block, model)
        valid = jnp.all(valid)
        if driven.block.one_sided:
            valid = valid & is_before_wall(driven.rotation, driven.velocity)
    uplifts = UpliftTable.of(equation, driven.motion)
    dtype = driven.duration.dtype
    integration = Integration(driven, equation, Stepper(method, rtol, atol), uplifts)

    def goes_on(carry: _Carry) -> Booleans:
        state, _ = carry
        wanted = (state.impacts == 0) | (not until_first_impact)
        wanted = wanted & (state.time < driven.duration) & (state.phase != TOPPLED)
        return ((state.events == 0) | wanted) & ~state.failed & (state.events < _MAX_EVENTS)

    def take_turn(carry: _Carry) -> _Carry:
        before, lists = carry
        state = _step_to_event(integration, before)
        # Events are logged outside of the branches of `_step_to_event`, which would copy the
        # lists.
        if max_impacts:
            lists = _log_event(before, state, lists, max_impacts)
        return state, lists

    first = _make_first_state(driven, equation, valid, with_forces)
    # The last row of each list takes entries beyond its end.
    max_events = _EVENTS_PER_IMPACT * max_impacts
    unknown = jnp.full((max_events + 1, 4), jnp.nan, dtype)
    begin = first, (unknown, unknown[: max_impacts + 1, :2])
    state, lists = jax.lax.while_loop(goes_on, take_turn, begin)
    full = (state.impacts > max_impacts) | (state.events > max_events)
    response = _make_response(integration, state, lists, valid, full)
    return FollowedMotion(response, state.last_impact)


def _follow_by_samples(driven: Driven, **options: Any) -> FollowedMotion:
    """Follow a block, with derivatives for arrays, which are the samples of a record.

    Forward mode is that of the loop. Reverse mode uses the sweep of the batch, which solves the
    same equation. The sweep goes back from the peak and from the final state: for other answers
    reverse mode is refused.
    """
    followed = _follow_jitted(driven, **options)
    response = followed.response

    def get_swept(response: Any) -> list:
        return [getattr(response, name) for name in _SWEPT]

    def sweep(driven: Driven) -> list[Reals]:
        batch = Batch.of(**vars(driven), rtol=_SWEEP_TOLERANCE)
        return get_swept(follow_batch(batch, response.model))

    def pull(driven: Driven, cotangents: list[Reals]) -> Driven:
        return eqx.filter_vjp(sweep, driven)[1](cotangents)[0]

    swept = transpose_by(driven, get_swept(response), pull=pull)
    name = f"with respect to samples, an answer that is not {', '.join(_SWEPT)}"
    response = eqx.tree_at(get_swept, refuse_reverse_mode(name, response), swept)
    return followed._replace(response=response)


_follow_jitted = eqx.filter_jit(follow_driven)
# Compiled once for all tolerances, with derivatives in both modes.
follow_driven_jitted = eqx.filter_jit(
    differentiate_by_jacobian(follow_driven, for_arrays=_follow_by_samples)
)


@eqx.filter_jit
def follow_concrete(driven: Driven, **options: Any) -> FollowedMotion:
    """Follow a block of concrete numbers on a processor, as `follow_driven` does.

    By default XLA makes a function of each small computation before and after the loop, which
    takes a third of the time of the first call.
    """
    return call_as_one_function(eqx.Partial(follow_driven, **options), driven)


def _make_first_state(
    driven: Driven, equation: Equation, valid: Booleans, with_forces: bool
) -> State:
    """Put the block into its initial state, on the side to which it is rotated or moves."""
    towards = jnp.where(driven.rotation == 0, driven.velocity, driven.rotation)
    side = jnp.where(towards < 0, -1, 1).astype(towards.dtype)
    rotation = side * driven.rotation
    velocity = side * driven.velocity
    phase = jnp.where(velocity < 0, FALLING, RISING)
    phase = jnp.where((rotation == 0) & (velocity == 0), REST, phase)
    zero = jnp.zeros_like(rotation)
    none = jnp.zeros((), int)
    infinite = jnp.full_like(zero, jnp.inf)
    return State(
        time=zero,
        side=side,
        rotation=rotation,
        velocity=velocity,
        phase=jnp.where(rotation >= TOPPLED_ROTATION, TOPPLED, phase),
        events=none,
        impacts=none,
        forces=ForceExtremes(zero, infinite, infinite) if with_forces else None,
        last_impact=jnp.stack([zero, zero]),
        peak=rotation,
        peak_time=zero,
        crossing=jnp.where(rotation >= equation.critical_angle, zero, jnp.nan),
        margin=zero,
        # Where an argument is not allowed, the first event is also the last one.
        failed=~valid,
        balanced=jnp.array(False),
    )


def _log_event(before: State, state: State, lists: _Lists, max_impacts: int) -> _Lists:
    """Write an event to the list of events and, if it is an impact, to the list of impacts."""
    place = jnp.where(state.impacts > before.impacts, before.impacts, max_impacts)
    event = jnp.stack([state.time, state.side, state.rotation, state.velocity])
    # An index beyond the end of a list is moved to the last row, which is cut off later.
    update = jax.lax.dynamic_update_slice
    events = update(lists[0], event[None], (before.events, 0))
    return events, update(lists[1], state.last_impact[None], (place, 0))


def _make_response(
    integration: Integration, state: State, lists: _Lists, valid: Booleans, full: Booleans
) -> Response:
    """Make the response that ends in a state; NaN where it failed."""
    broken = (state.failed & valid) | (state.events >= _MAX_EVENTS)
    status = jnp.where(state.balanced, Status.BALANCED, Status.COMPLETE)
    status = jnp.where(broken, Status.STOPPED, jnp.where(full, Status.LIST_FULL, status))
    good = valid & ~broken
    # The rows for entries beyond the end are left out.
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


def _step_to_event(integration: Integration, before: State) -> State:
    """Take the block from an event to the next one, and read the overturning criterion."""
    driven = integration.driven
    motion = integration.driven.motion
    begins = before.events == 0
    acts = motion.acts(before.time)
    # A segment ends at the next edge of the input, where the input jumps, or with the
    # duration. An edge that coincides with the end of the duration, up to rounding, is left
    # out.
    stop = driven.duration
    latest = driven.duration - motion.time_rounding(driven.duration)
    for edge in (motion.end, motion.start):
        stop = jnp.where((edge > before.time) & (edge < latest), edge, stop)
    state = jax.lax.switch(
        jnp.where(begins, 0, jnp.where(before.phase == REST, 1, 2)),
        [
            lambda state: state,
            lambda state: _wait(integration, state, stop),
            lambda state: move_to_event(integration, state, stop),
        ],
        before,
    )
    state = _add_saltation(integration, state, acts & ~begins)
    # The overturning criterion is read in the initial state, and again where the input ends:
    # from then on energy says whether the block overturns. If a block topples before that, its
    # margin is read when it topples.
    input_end = pick_smaller(motion.end, driven.duration)
    reached = (state.time >= input_end) | (state.phase == TOPPLED)
    reads = begins | ((before.time < input_end) & reached)
    margins = free_motion_margins(
        integration.equation, driven.restitution, state.rotation, state.velocity
    )
    margin = jnp.where(reads, pick_smaller_margin(*margins), state.margin)
    return state._replace(margin=margin, events=before.events + 1)


def _wait(integration: Integration, state: State, stop: Reals) -> State:
    """Let a block at rest wait until the input lifts it, or until `stop`."""
    lifted, time, side = integration.uplifts.find_next(state.time, stop)
    acts = integration.driven.motion.acts(state.time)
    lifted = lifted & acts
    until = jnp.where(lifted, time, stop)
    # A block that is not lifted at once stays at rest whatever its initial state: the
    # derivatives of the state become 0, and no value changes. Otherwise they are taken on the
    # lifted side.
    turns = jnp.where(until > state.time, 0, side * state.side)
    forces = state.forces
    if forces is not None:
        demand, normal = integration.uplifts.find_force_extremes(state.time, until, acts)
        # Where the normal force vanishes, the input also lifts the block, which ends the wait.
        loss_time = jax.lax.stop_gradient(jnp.where(normal > 0, jnp.inf, until))
        # A block that the input lifts at once does not wait: no forces at rest are added.
        waits = until > state.time
        added = forces.combine(demand, normal, loss_time)
        forces = jax.tree.map(lambda new, old: jnp.where(waits, new, old), added, forces)
    return state._replace(
        time=until,
        rotation=turns * state.rotation,
        velocity=turns * state.velocity,
        side=jnp.where(lifted, side, state.side),
        phase=jnp.where(lifted, RISING, REST),
        forces=forces,
    )


def _add_saltation(integration: Integration, state: State, acted: Booleans) -> State:
    """Add the saltation term to an event that coincides with a corner of the input.

    Only derivatives change, no value. A corner of the input is its start, its end, a kink, or
    the end of the duration; there the input switches at a time that depends on parameters.
    Take an impact that falls on the end of a pulse. Its time has the
    derivative of an impact, yet the next segment, without the pulse, begins when the pulse
    ends. Between the two the block moves for a time that is 0 but has a derivative, at the
    rate dy/dt that it has under the input before the corner:

        y <- y + dy/dt (t_corner - t_event)

    The next segment adds the rate after the corner with its own time. The difference of both
    rates, times the derivative of the time of the switch, is the jump of the derivative known
    as saltation (Leine & Nijmeijer 2004, doi:10.1007/978-3-540-44398-8).

    Parameters
    ----------
    integration : Integration
    state : State
        At the event.
    acted : Array of bool
        Whether the input acted in the segment before the event.
    """
    motion = integration.driven.motion
    duration = integration.driven.duration
    time = state.time
    near = motion.time_rounding(time)
    # `next_kink` skips kinks within rounding of its argument.
    kink = motion.next_kink(time - 2 * near)
    corner = jnp.where(kink <= time + near, kink, time)
    corner = jnp.where(~acted & (time == motion.start), motion.start, corner)
    corner = jnp.where(acted & (time == motion.end), motion.end, corner)
    # Each line overrides the ones above: where corners coincide, the end of the duration
    # counts.
    corner = jnp.where(time >= duration, duration, corner)
    move = corner - time
    # The value of `time` stays to the last bit, and so does the value of the state.
    move = move - jax.lax.stop_gradient(move)
    stays = (state.phase == REST) | (state.phase == TOPPLED)
    segment = integration.begin_segment(time, state.side, acted)
    rate = segment.field(jnp.zeros_like(move), state.y)
    rotation, velocity = state.y + jnp.where(stays, 0, move) * rate
    return state._replace(time=time + move, rotation=rotation, velocity=velocity)
