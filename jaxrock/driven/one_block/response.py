"""The response of one block to a ground motion, and its history.

A response keeps the state after every event. The history at a time is integrated from the last
event before it, without a search for events.
"""

from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...host import Shown, Status, format_fields, make_dataset
from ...resonance import RockingModel
from ...validation import Booleans, Integers, Numbers, Reals, as_array, as_real, is_traced
from ..equation import Equation
from ..overturning_criterion import TOPPLED_ROTATION
from ..scene import Driven
from .segment_integration import integrate_segment
from .solver_steps import Segment, Stepper, choose_first_step

if TYPE_CHECKING:
    import xarray

# Times of a history in one call of the compiled program.
_TIMES = 512
# Room for events in that program, at least, so that most responses share one.
_EVENTS = 8192
# Impacts slower than this fraction of the fastest one are tiny bounces.
_TINY = 0.01


class Events(eqx.Module):
    """The state after every event, in the order of time; NaN where there is none."""

    time: Reals
    side: Reals  # +1 or -1
    rotation: Reals  # from that side, 0 on the ground
    velocity: Reals  # positive away from the ground


class Response(Shown, eqx.Module):
    """The response of one block to a ground motion; see `respond`.

    Attributes
    ----------
    final_rotation, final_velocity : Array
        alpha [rad] and its rate [rad/s] at the end of the duration.
    peak_rotation, peak_time : Array
        Largest abs(alpha) [rad], at most pi / 2, and the time of it [s].
    overturned : Array of bool
        Whether the block overturns: it reaches pi / 2, or has enough energy to do so once the
        input has ended. A duration that is shorter than the input ends the input.
    overturning_time, margin : Array
        Last time at which the block passed the critical angle outward [s], NaN if it stands
        or never passed that angle; and `free_motion_margin` at the end of the input [-].
    impacts : Array of int
        Number of impacts.
    impact_times, impact_velocities : Array, shape (impacts,)
        Times of the impacts [s], and angular velocities just before them [rad/s], with the
        sign convention of alpha. Under a transformation the shape is (`max_impacts`,), padded
        with NaN.
    at_rest : Array of bool
        Whether the block rests on the ground at the end of the duration.
    friction_demand, normal_force : Array
        Largest ratio of horizontal to normal force at the base, and smallest normal force
        over weight [-]. They follow from the accelerations of the centre of mass; for a block
        that overturns, until it reaches pi / 2. Impulses at impacts do not count. If the
        normal force falls to 0 or less, the block leaves the ground: the friction demand is
        inf, and the model no longer applies. For a block that lies on its side from the
        beginning they are 0 and inf.
    contact_loss_time : Array
        Time at which the block leaves the ground [s], accurate to 1e-4 of an integration step
        and without derivative; NaN if the block stays on the ground.
    status : Array of int
        A `jaxrock.Status`; where it is STOPPED or INVALID, the results are NaN.
    events, scene, model
        The state after every event, and the arguments, from which `history` computes the
        motion.
    """

    final_rotation: Reals
    final_velocity: Reals
    peak_rotation: Reals
    peak_time: Reals
    overturned: Booleans
    overturning_time: Reals
    margin: Reals
    impacts: Integers
    impact_times: Reals
    impact_velocities: Reals
    at_rest: Booleans
    friction_demand: Reals
    normal_force: Reals
    contact_loss_time: Reals
    status: Integers
    events: Events
    scene: Driven
    model: RockingModel

    picture: ClassVar[str] = "plot_response"

    def history(self, time: Numbers) -> tuple[Reals, Reals]:
        """Compute rotation and angular velocity over time, to the accuracy of the integration.

        Parameters
        ----------
        time : array_like
            [s]

        Returns
        -------
        rotation, velocity : Array, shape (...)
            alpha [rad] and its rate [rad/s]; NaN before 0 and after the duration. A block that
            has overturned stays where it lies.

        Raises
        ------
        ValueError
            If the response was computed without events, with ``max_impacts=0``.
        """
        times = as_real("time", time, unit="s")
        driven = self.scene
        events = self.events
        shape = times.shape
        if events.time.size == 0:
            raise ValueError(
                "max_impacts must be at least 1 in `respond` for a history, got 0"
            )
        if is_traced((driven, events, times)):
            flat = times.astype(events.time.dtype).reshape(-1)
            history = _compute_history(driven, events, self.model, flat)
            return history[0].reshape(shape), history[1].reshape(shape)

        # Concrete times come in pieces of one length, and concrete events in lists of few
        # lengths, so that few programs are compiled; in NumPy, which compiles nothing.
        pieces = max(1, -(-times.size // _TIMES))
        flat = np.resize(np.asarray(times, events.time.dtype), (pieces, _TIMES))
        room = max(_EVENTS, 1 << (events.time.size - 1).bit_length()) - events.time.size
        rows = (
            np.pad(part, (0, room), constant_values=np.nan) for part in jax.tree.leaves(events)
        )
        events = Events(*map(as_array, rows))
        driven = driven.bucketed()
        histories = [
            _compute_history(driven, events, self.model, as_array(piece)) for piece in flat
        ]
        joined = np.concatenate(histories, axis=-1)[:, : times.size]
        return as_array(joined[0].reshape(shape)), as_array(joined[1].reshape(shape))

    def table(self, time: Numbers) -> "xarray.Dataset":
        """Tabulate the motion.

        Parameters
        ----------
        time : array_like, shape (n,)
            [s]

        Returns
        -------
        xarray.Dataset
            ``rotation`` [rad], ``velocity`` [rad/s] and ``rotation_ratio`` [-] over time.
        """
        rotation, velocity = self.history(time)
        ratio = rotation / self.scene.block.critical_angle
        variables = {
            "rotation": ("time", rotation, {"long_name": "rotation", "units": "rad"}),
            "velocity": ("time", velocity, {"long_name": "angular velocity", "units": "rad s-1"}),
            "rotation_ratio": (
                "time", ratio, {"long_name": "rotation over critical angle", "units": "1"}
            ),
        }  # fmt: skip
        axis = {"time": ("time", np.asarray(time), {"long_name": "time", "units": "s"})}
        return make_dataset("Response of a rocking block", variables, axis, {})

    def __str__(self) -> str:
        if jnp.ndim(self.status) or is_traced(self.status):
            units = {"peak_rotation": "rad", "peak_time": "s", "impacts": ""}
            units |= {"friction_demand": "", "normal_force": "of the weight"}
            return format_fields(self, overturned="", margin="", **units)
        status = Status(int(self.status))
        if status in (Status.STOPPED, Status.INVALID):
            return f"no response: {status.description}"
        angle = self.scene.block.critical_angle
        # Energy rounds: the margin of a block at rest may be 1 plus an ulp.
        state = "at rest" if round(float(self.margin), 6) == 1 else f"margin {self.margin:.4g}"
        end = "in motion"
        if status == Status.BALANCED and self.final_velocity == 0:
            end = "in balance"
        if self.at_rest:
            end = "at rest"
        if abs(self.final_rotation) >= TOPPLED_ROTATION:
            end = "lies on its side"
        # Most impacts are bounces that die out: many in number, small in effect.
        speeds = np.asarray(self.impact_velocities)
        speeds = abs(speeds[np.isfinite(speeds)])
        tiny = int((speeds < _TINY * speeds.max(initial=0.0)).sum())
        count = int(self.impacts) - tiny
        bounces = f" (and {tiny:,} tiny bounces)" if tiny else ""
        lines = [
            f"{'overturns' if self.overturned else 'stands'}; {state} when the shaking ends",
            f"peak rotation {self.peak_rotation:.3g} rad, {self.peak_rotation / angle:.3g} of the"
            f" critical angle, at {self.peak_time:.4g} s",
            f"{count:,} impact{'' if count == 1 else 's'}{bounces}, {end} at the end",
            f"the block leaves the ground at {self.contact_loss_time:.4g} s; the model ends there"
            if self.normal_force <= 0
            else f"does not slide if friction exceeds {self.friction_demand:.4g}; normal force at"
            f" least {self.normal_force:.4g} of the weight",
        ]
        if self.peak_rotation == 0:
            lines[1] = "the ground does not lift the block"
        if status == Status.BALANCED:
            lines.append(
                "for a time it was in unstable balance, which the slightest push ends"
            )
        if self.overturned and jnp.isfinite(self.overturning_time):
            lines[0] += f", beyond the critical angle from {self.overturning_time:.4g} s on"
        return "\n".join(lines)


@eqx.filter_jit
def _compute_history(
    driven: Driven, events: Events, model: RockingModel, times: Reals
) -> tuple[Reals, Reals]:
    """Compute the rotation alpha and its rate at some times, each from the event before it.

    Both are NaN before time 0 and after the duration.
    """
    equation = Equation.of(driven.block, model)
    # A response does not keep its tolerance. The tolerance here is tighter than the default in
    # float64; in float32 it is 100 eps, about the default.
    stepper = Stepper("Tsit5", max(1e-9, 100 * float(jnp.finfo(times.dtype).eps)), 0.0)
    event_times = jnp.where(jnp.isnan(events.time), jnp.inf, events.time)

    def integrate_to(time: Reals) -> tuple[Reals, Reals]:
        inside = (time >= 0) & (time <= driven.duration)
        time = jnp.where(inside, time, 0)
        index = jnp.maximum(jnp.searchsorted(event_times, time, side="right") - 1, 0)
        event = jax.tree.map(lambda part: part[index], events)
        lifted = (event.rotation == 0) & (event.velocity == 0)
        # A block that has just been lifted is still on the ground: it moves if it is above the
        # ground at the next event.
        following = events.rotation[jnp.minimum(index + 1, event_times.size - 1)]
        moves = ~lifted | (following > 0)
        # A block in balance is still in balance at the next event.
        moves = moves & ((event.velocity != 0) | (following != event.rotation))
        moves = moves & (event.rotation < TOPPLED_ROTATION) & (time > event.time)
        acts = driven.motion.acts(event.time)
        segment = Segment(equation, driven.motion, event.time, event.side, acts)
        length = jnp.where(moves, time - event.time, 0)
        y = jnp.stack([event.rotation, event.velocity])
        beginning = choose_first_step(segment, length, y, lifted)
        end = integrate_segment(stepper, segment, length, y, beginning, moves=moves)
        known = inside & (end.elapsed >= length)
        rotation, velocity = (
            jnp.where(known, event.side * part + 0.0, jnp.nan) for part in end.y
        )
        return rotation, velocity

    return jax.vmap(integrate_to)(times)
