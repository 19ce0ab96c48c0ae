"""Rotation and velocity over time, integrated from the last event before each time on."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..resonance import RockingModel
from ..validation import Booleans, Reals, as_array
from .driven_scene import Driven
from .equation import Equation
from .segment import Segment, Stepper, first_step, limited

_TIMES = 512  # at once
_EVENTS = 8192  # at least


class Events(eqx.Module):
    """The state after every event, in the order of time; NaN where there is none."""

    time: Reals
    side: Reals
    rotation: Reals
    velocity: Reals


def history_of(
    driven: Driven, events: Events, model: RockingModel, times: Reals
) -> tuple[Reals, Reals]:
    """Rotation alpha and its rate at some times; NaN before time 0 and after the duration."""
    dtype, shape = events.time.dtype, times.shape
    leaves = jax.tree.leaves((driven, events, times))
    if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        parts = _history(driven, events, model, times.astype(dtype).reshape(-1))
        rotation, velocity = (part.reshape(shape) for part in parts)
        return rotation, velocity
    # Few different shapes, so that few programs are compiled.
    size = max(1, -(-times.size // _TIMES)) * _TIMES
    pieces = _padded(np.asarray(times, dtype).reshape(-1), size, 0.0).reshape(-1, _TIMES)
    room = max(_EVENTS, 1 << (events.time.size - 1).bit_length())
    events = jax.tree.map(lambda part: as_array(_padded(part, room, np.nan)), events)
    driven = driven.bucketed()
    parts = [_history(driven, events, model, as_array(piece)) for piece in pieces]
    joined = np.concatenate(parts, axis=-1)[:, : times.size]
    rotation, velocity = (as_array(part.reshape(shape)) for part in joined)
    return rotation, velocity


def _padded(values: Any, size: int, fill: float) -> np.ndarray:
    return np.pad(np.asarray(values), (0, size - values.size), constant_values=fill)


@eqx.filter_jit
def _history(
    driven: Driven, events: Events, model: RockingModel, times: Reals
) -> tuple[Reals, Reals]:
    equation = Equation.of(driven.block, model)
    rtol = max(1e-9, 100 * float(jnp.finfo(times.dtype).eps))
    stepper = Stepper("Tsit5", rtol, 0.0)
    event_times = jnp.where(jnp.isnan(events.time), jnp.inf, events.time)

    def at(time: Reals) -> tuple[Reals, Reals]:
        inside = (time >= 0) & (time <= driven.duration)
        time = jnp.where(inside, time, 0)
        index = jnp.maximum(jnp.searchsorted(event_times, time, side="right") - 1, 0)
        event = jax.tree.map(lambda part: part[index], events)
        moves = (event.rotation != 0) | (event.velocity != 0)
        # A block that has just been lifted is still on the ground: it moves if the next event
        # finds it above.
        following = events.rotation[jnp.minimum(index + 1, event_times.size - 1)]
        moves = (moves | (following > 0)) & (event.rotation < 0.5 * jnp.pi) & (time > event.time)
        acts = driven.motion.acts(event.time)
        segment = Segment(equation, driven.motion, event.time, event.side, acts)
        length = jnp.where(moves, time - event.time, 0)
        y, arrived = _integrated(stepper, segment, length, event)
        known = inside & arrived
        rotation, velocity = (jnp.where(known, event.side * part + 0.0, jnp.nan) for part in y)
        return rotation, velocity

    return jax.vmap(at)(times)


def _integrated(
    stepper: Stepper, segment: Segment, length: Reals, event: Events
) -> tuple[Reals, Booleans]:
    """The state so long after an event, and whether the integration got there."""
    zero, y = jnp.zeros_like(length), jnp.stack([event.rotation, event.velocity])

    def step(state: tuple) -> tuple:
        elapsed, until, y, wanted, solver_state = state
        step = stepper.step(segment, elapsed, until, y, solver_state)

        def accepted(new: Reals, old: Reals) -> Reals:
            return jnp.where(step.accepted, new, old)

        elapsed, y = accepted(until, elapsed), accepted(step.y, y)
        wanted = accepted(jnp.maximum(step.next_length, wanted), step.next_length)
        acceleration = segment.field(elapsed, y)[1]
        solver_state = jax.tree.map(accepted, step.solver_state, solver_state)
        until = limited(segment, length, elapsed, elapsed + wanted, y, acceleration)
        return elapsed, until, y, accepted(wanted, zero), solver_state

    lifted = (event.rotation == 0) & (event.velocity == 0)
    until = first_step(segment, length, y, lifted)
    elapsed, _, y, *_ = jax.lax.while_loop(
        lambda state: (state[0] < length) & (state[1] > state[0]),
        step,
        (zero, until, y, zero, stepper.begin(segment, y)),
    )
    return y, elapsed >= length
