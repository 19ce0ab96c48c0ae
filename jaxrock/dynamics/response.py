"""What one block did under a ground motion, and its history."""

import enum
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..host import listed
from ..resonance import RockingModel
from ..validation import Booleans, Numbers, Reals, as_array, as_real
from .driven_scene import Driven
from .equation import Equation
from .solver_steps import Segment, Stepper, first_step, limited

_TIMES = 512  # of a history at once
_EVENTS = 8192  # at least, for a history


class Status(enum.IntEnum):
    """How a computation ended."""

    COMPLETE = 0  # nothing ran out
    LIST_FULL = 1  # all is right, but not all impacts are listed
    STOPPED = 2  # the integrator ran out of steps, or could not go on
    INVALID = 3  # an argument was outside of what is allowed


class Events(eqx.Module):
    """The state after every event, in the order of time; NaN where there is none."""

    time: Reals
    side: Reals
    rotation: Reals
    velocity: Reals


class Response(eqx.Module):
    """What a block did under a ground motion; see `respond`.

    Attributes
    ----------
    final_rotation, final_velocity : Array
        alpha [rad] and its rate [rad/s] at the end of the duration.
    peak_rotation, peak_time : Array
        Largest abs(alpha) [rad], at most pi / 2, and when [s].
    overturned : Array of bool
        Whether the block falls: by reaching pi / 2, or by energy once the input has ended (or
        the duration, if that is shorter, as if the input ended there).
    overturning_time : Array
        When it passed the critical angle for the last time [s]; NaN if it stands, or if that
        comes after the duration.
    margin : Array
        `free_motion_margin` at the end of the input [-]: negative where the block falls.
    impacts : Array of int
        Number of impacts.
    impact_times, impact_velocities : Array, shape (impacts,)
        When [s], and the angular velocity just before [rad/s], signed as alpha is. Under a
        transformation the shape is (`max_impacts`,), filled up with NaN.
    at_rest : Array of bool
        Whether the block rests on the ground at the end of the duration.
    friction_demand, normal_force : Array
        Largest ratio of horizontal to normal force at the base, and smallest normal force over
        weight [-], from the accelerations of the centre of mass: at rest, in motion, just before
        and after every impact, and until a block that overturns reaches pi / 2. The impulses of
        impacts do not count. Where the normal force is 0 or less, the block would leave the
        ground: the friction demand is inf, and the model no longer applies. 0 and inf for a
        block that lies on its side from the beginning.
    status : Array of int
        A `Status`; other than 0 or 1, the results are NaN.
    events, scene, model
        From which `history` integrates.
    """

    final_rotation: Reals
    final_velocity: Reals
    peak_rotation: Reals
    peak_time: Reals
    overturned: Booleans
    overturning_time: Reals
    margin: Reals
    impacts: Int[Array, "..."]
    impact_times: Reals
    impact_velocities: Reals
    at_rest: Booleans
    friction_demand: Reals
    normal_force: Reals
    status: Int[Array, "..."]
    events: Events
    scene: Driven
    model: RockingModel

    def history(self, time: Numbers) -> tuple[Reals, Reals]:
        """Rotation and angular velocity over time, to the accuracy of the integration.

        Parameters
        ----------
        time : array_like
            Times [s], from 0 to the duration.

        Returns
        -------
        rotation, velocity : Array, shape (...)
            alpha [rad] and its rate [rad/s]; NaN outside. A block that has overturned stays
            where it lies.

        Raises
        ------
        ValueError
            If the response was computed without events, with ``max_impacts=0``.
        """
        times = as_real("time", time)
        if self.events.time.size == 0:
            raise ValueError("max_impacts must be at least 1 in `respond` for a history, got 0")
        return _history_of(self.scene, self.events, self.model, times)

    def __str__(self) -> str:
        if jnp.ndim(self.status) or isinstance(self.status, jax.core.Tracer):
            units = {"peak_rotation": "rad", "peak_time": "s", "impacts": ""}
            units |= {"friction_demand": "", "normal_force": "of the weight"}
            return listed(self, status="", overturned="", margin="", **units)
        status = Status(int(self.status))
        if status not in (Status.COMPLETE, Status.LIST_FULL):
            return f"no response: {status.name.lower()}"
        angle = self.scene.block.critical_angle
        fallen = abs(self.final_rotation) >= 0.5 * jnp.pi
        end = "lies on its side" if fallen else "at rest" if self.at_rest else "in motion"
        lines = [
            f"{'overturns' if self.overturned else 'stands'}, margin {self.margin:.4g}",
            f"peak rotation {self.peak_rotation:.6g} rad = {self.peak_rotation / angle:.4g}"
            f" alpha_c at {self.peak_time:.4g} s",
            f"{self.impacts} impacts, {end} at the end",
            f"friction demand {self.friction_demand:.4g}, smallest normal force"
            f" {self.normal_force:.4g} of the weight",
        ]
        if self.overturned and jnp.isfinite(self.overturning_time):
            lines[0] += f", beyond return from {self.overturning_time:.4g} s"
        return "\n".join(lines)


def _history_of(
    driven: Driven, events: Events, model: RockingModel, times: Reals
) -> tuple[Reals, Reals]:
    """Rotation alpha and its rate at some times; NaN before time 0 and after the duration."""
    dtype, shape = events.time.dtype, times.shape
    leaves = jax.tree.leaves((driven, events, times))
    if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        parts = _history_program(driven, events, model, times.astype(dtype).reshape(-1))
        rotation, velocity = (part.reshape(shape) for part in parts)
        return rotation, velocity
    # Few different shapes, so that few programs are compiled.
    size = max(1, -(-times.size // _TIMES)) * _TIMES
    pieces = _padded(np.asarray(times, dtype).reshape(-1), size, 0.0).reshape(-1, _TIMES)
    room = max(_EVENTS, 1 << (events.time.size - 1).bit_length())
    events = jax.tree.map(lambda part: as_array(_padded(part, room, np.nan)), events)
    driven = driven.bucketed()
    parts = [_history_program(driven, events, model, as_array(piece)) for piece in pieces]
    joined = np.concatenate(parts, axis=-1)[:, : times.size]
    rotation, velocity = (as_array(part.reshape(shape)) for part in joined)
    return rotation, velocity


def _padded(values: Any, size: int, fill: float) -> np.ndarray:
    return np.pad(np.asarray(values), (0, size - values.size), constant_values=fill)


@eqx.filter_jit
def _history_program(
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

        def accepted(new: Any, old: Any) -> Any:
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
