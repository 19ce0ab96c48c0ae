"""What one block did under a ground motion."""

import enum

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..host import listed
from ..resonance import RockingModel
from ..validation import Booleans, Numbers, Reals, as_real
from .driven_scene import Driven
from .history import Events, history_of


class Status(enum.IntEnum):
    """How a computation ended."""

    COMPLETE = 0  # nothing ran out
    LIST_FULL = 1  # all is right, but not all impacts are listed
    STOPPED = 2  # the integrator ran out of steps, or could not go on
    INVALID = 3  # an argument was outside of what is allowed


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
        return history_of(self.scene, self.events, self.model, times)

    def __str__(self) -> str:
        if jnp.ndim(self.status) or isinstance(self.status, jax.core.Tracer):
            return listed(
                self,
                status="",
                overturned="",
                margin="",
                peak_rotation="rad",
                peak_time="s",
                impacts="",
                friction_demand="",
                normal_force="of the weight",
            )
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
