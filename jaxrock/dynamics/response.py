"""How a block responds to a ground motion: the answer, and the question."""

import contextlib
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..block import Block
from ..ground_motion import Motion, Record
from ..host import listed
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Number, Numbers, Reals, as_array, as_real, of_one_precision
from .event_loop import Carry, Cuts, Driven, Followed, Status, follow, resumed
from .segment import DEFAULT, Method

SOLVERS = ("Tsit5", "Dopri5", "Dopri8", "Bosh3", "Heun")
_TIMES = 512  # of a history at once
_LISTED = 2048  # impacts at once
_KEPT = 64  # of them under a transformation


class Response(eqx.Module):
    """What a block did under a ground motion; see `respond`.

    Attributes
    ----------
    final_rotation, final_velocity : Array
        alpha [rad] and its rate [rad/s] at the end of the duration.
    peak_rotation, peak_time : Array
        Largest abs(alpha) [rad], at most pi / 2, and when [s].
    overturned : Array of bool
        Whether it falls: by reaching pi / 2, or by energy once the input has ended (or the
        duration, if that is shorter, as if the input ended there).
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
        Whether it rests on the ground at the end of the duration.
    friction_demand, normal_force : Array
        Largest ratio of horizontal to normal force at the base, and smallest normal force
        over weight [-], over all of the motion, from the accelerations of the centre of mass:
        at rest, in motion, just before and after every impact, and of a block that overturns
        up to the moment in which abs(alpha) reaches pi / 2. The impulses of impacts do not
        count. A normal force of 0 or less means that the block would have left the ground: the
        friction demand is inf then, and from there on the model is broken. 0 and inf for a
        block that lies on its side from the beginning.
    status : Array of int
        A `Status`; other than 0 or 1, the answers are NaN.
    cuts, scene, model
        What `history` integrates from.
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
    cuts: "Cuts"
    scene: "Driven"
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
            If nothing is listed to go on from.
        """
        times, cuts = as_real("time", time), self.cuts
        if cuts.time.size == 0:
            raise ValueError("max_impacts must be at least 1 in `respond` for a history, got 0")
        dtype, shape = cuts.time.dtype, times.shape
        leaves = jax.tree.leaves((self, times))
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            found = _history(self.scene, cuts, self.model, times.astype(dtype).reshape(-1))
            rotation, velocity = (part.reshape(shape) for part in found)
            return rotation, velocity
        # Few different shapes, so that little is compiled.
        size = max(1, -(-times.size // _TIMES)) * _TIMES
        pieces = _padded(np.asarray(times, dtype).reshape(-1), size, 0.0).reshape(-1, _TIMES)
        room = max(4 * _LISTED, 1 << (cuts.time.size - 1).bit_length())
        cuts = jax.tree.map(lambda part: as_array(_padded(part, room, np.nan)), cuts)
        scene = _roomy(self.scene)
        parts = [_history(scene, cuts, self.model, as_array(piece)) for piece in pieces]
        found = np.concatenate(parts, axis=-1)[:, : times.size]
        rotation, velocity = (as_array(part.reshape(shape)) for part in found)
        return rotation, velocity

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
        still = "lies on its side" if fallen else "at rest" if self.at_rest else "in motion"
        lines = [
            f"{'overturns' if self.overturned else 'stands'}, margin {self.margin:.4g}",
            f"peak rotation {self.peak_rotation:.6g} rad = {self.peak_rotation / angle:.4g}"
            f" alpha_c at {self.peak_time:.4g} s",
            f"{self.impacts} impacts, {still} at the end",
            f"friction demand {self.friction_demand:.4g}, smallest normal force"
            f" {self.normal_force:.4g} of the weight",
        ]
        if self.overturned and jnp.isfinite(self.overturning_time):
            lines[0] += f", beyond return from {self.overturning_time:.4g} s"
        return "\n".join(lines)


def _padded(values: Any, size: int, fill: float) -> np.ndarray:
    return np.pad(np.asarray(values), (0, size - values.size), constant_values=fill)


@eqx.filter_jit
def _history(scene: Driven, cuts: Cuts, model: RockingModel, times: Reals) -> tuple[Reals, Reals]:
    eps = float(jnp.finfo(times.dtype).eps)
    return resumed(scene, cuts, times, model, max(1e-9, 100 * eps))


@eqx.filter_jit
def _followed(
    driven: Driven,
    rtol: Any,
    atol: Any,
    model: RockingModel,
    max_impacts: int,
    method: Method,
    begin: Carry | None = None,
) -> Followed:
    """`follow`, compiled once for all tolerances."""
    return follow(
        driven,
        rtol=rtol,
        atol=atol,
        model=model,
        max_impacts=max_impacts,
        method=method,
        begin=begin,
    )


def compiled(
    driven: Driven,
    rtol: Any,
    atol: Any,
    model: RockingModel,
    max_impacts: int,
    method: Method = DEFAULT,
) -> Response:
    """The response to the end, with so many impacts in its list."""
    return _response(_followed(driven, rtol, atol, model, max_impacts, method), model)


def _response(f: Followed, model: RockingModel) -> Response:
    return Response(
        final_rotation=f.rotation,
        final_velocity=f.velocity,
        peak_rotation=f.peak,
        peak_time=f.peak_time,
        overturned=f.overturned,
        overturning_time=f.crossing,
        margin=f.margin,
        impacts=f.impacts,
        impact_times=f.impact_times,
        impact_velocities=f.impact_velocities,
        at_rest=f.at_rest,
        friction_demand=f.demand,
        normal_force=f.normal,
        status=f.status,
        cuts=f.cuts,
        scene=f.driven,
        model=model,
    )


def _whole(driven: Driven, rtol: Any, atol: Any, model: RockingModel, method: Method) -> Response:
    """The response to the end with all of its impacts, list after list; of concrete numbers."""
    begin, struck, cuts, roomy = Carry.beginning(driven.duration.dtype), [], [], _roomy(driven)
    while True:
        found = _followed(roomy, rtol, atol, model, _LISTED, method, begin)
        # In NumPy: nothing is compiled for as many as there are.
        impacts = int(found.impacts) - int(begin.impacts)
        rows = int(found.last.count) - int(begin.count)
        lists = found.impact_times, found.impact_velocities
        struck.append([np.asarray(part)[:impacts] for part in lists])
        cuts.append([np.asarray(part)[:rows] for part in jax.tree.leaves(found.cuts)])
        if int(found.status) != Status.LIST_FULL:
            break
        begin = found.last
    times, velocities = map(np.concatenate, zip(*struck, strict=True))
    whole = found.cuts
    if len(cuts) > 1:
        whole = Cuts(*(as_array(np.concatenate(part)) for part in zip(*cuts, strict=True)))
    return eqx.tree_at(
        lambda r: (r.impact_times, r.impact_velocities, r.cuts, r.scene),
        _response(found, model),
        (as_array(times), as_array(velocities), whole, driven),
    )


def _roomy(driven: Driven) -> Driven:
    """The same, under a record that is one of few lengths to a compiler."""
    return eqx.tree_at(lambda d: d.motion, driven, driven.motion.bucketed())


@contextlib.contextmanager
def _unchecked() -> Iterator[None]:
    """Without JAX's checks of a NaN, which here stands for none, and of equinox's caches."""
    with contextlib.ExitStack() as stack:
        # Only where they are on: a setting of its own compiles anew.
        if jax.config.jax_debug_nans:
            stack.enter_context(jax.debug_nans(False))
        if jax.config.jax_check_tracer_leaks:
            stack.enter_context(jax.check_tracer_leaks(False))
        yield


def respond(
    block: Block,
    restitution: Number,
    motion: Motion,
    duration: Number | None = None,
    *,
    rotation: Number = 0.0,
    velocity: Number = 0.0,
    rtol: float | None = None,
    atol: float | None = None,
    solver: str = "Tsit5",
    model: ModelLike = Nonlinear(),
    max_impacts: int = _KEPT,
) -> Response:
    """Response of one block to a ground motion, through every impact.

    Parameters
    ----------
    block : Block
        One block; `respond_batch` and `jax.vmap` take many.
    restitution : float
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.
    duration : float, optional
        Time to follow the block for [s], greater than 0. To the end of the motion unless
        given.
    rotation, velocity : float, optional
        Initial rotation [rad] and angular velocity [rad/s]; at rest by default.
    rtol, atol : float, optional
        Tolerances of each integration step, relative, and absolute in rad and rad/s. By
        default 1e-8 (1e-5 in float32), and 1e-9 of the relative one: small bounces are
        followed as exactly as large ones.
    solver : str
        Name of diffrax's solver: "Tsit5", "Dopri5", "Dopri8", "Bosh3" or "Heun". On records,
        where steps end at every sample, "Dopri8" with a loose `rtol` is more exact.
    model : Nonlinear or Linearized, or their names
        Equation of motion. Linearized it is that of the literature, whose limit for short
        pulses differs from Eq. 2 by cos(alpha_c); see `jaxrock.dynamics.equation`.
    max_impacts : int
        Most impacts whose time and velocity are kept under `jit`, `vmap` and derivatives, where
        `history` needs them: 0 for none of it, more for more. Outside of them all are.

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        If a concrete argument is outside of what is allowed or not scalar, or if the
        precision cannot deliver the tolerance. Traced values outside give NaN and
        `Status.INVALID`.

    Notes
    -----
    Eq. 1, by diffrax; each impact is reached by a step of its own, which ends there.
    Derivatives, in both modes, cost one forward derivative a perturbed number. Where two of
    the end of the input, its start, a sample, an impact and the duration coincide, answers
    may have another slope on either side. Given is that for a duration not longer, and an end
    of the input not earlier, than the other; for a start not earlier than 0; for a sample the
    same on both sides; and for an impact at the start, at the end or at the duration that of
    either order of the two, for all numbers the same one.
    Extremes have the derivative of the moment in which they are taken, the first of equal ones.

    NaN stands for none, and diffrax keeps what it traced: a call outside of transformations
    switches off `jax.debug_nans` and `jax.checking_leaks` for its time. Inside of `jit` they
    report both, and have to be off.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> pulse = jr.Sine(amplitude=2.5, duration=0.8)
    >>> response = jr.respond(block, 0.9, pulse, duration=5.0, rtol=1e-5)
    >>> print(bool(response.overturned), int(response.status))
    False 0
    """
    for name, value, kind in (("block", block, Block), ("motion", motion, Motion)):
        if not isinstance(value, kind):
            raise ValueError(f"{name} must be a {kind.__name__}, got {value!r:.60}")
    given = {
        "restitution": restitution,
        "duration": motion.end if duration is None else duration,
        "rotation": rotation,
        "velocity": velocity,
    }
    numbers = {name: as_real(name, value) for name, value in given.items()}
    driven = of_one_precision(Driven(block=block, motion=motion, **numbers))
    dtype = driven.restitution.dtype
    samples = (motion.acceleration, motion.vertical) if isinstance(motion, Record) else ()
    for name, tree in {"block": block, "motion": motion, **numbers}.items():
        for leaf in jax.tree.leaves(tree):
            if jnp.ndim(leaf) != any(leaf is rows for rows in samples):
                raise ValueError(f"{name} must be scalar here; respond_batch takes arrays")
    eps = float(jnp.finfo(dtype).eps)
    rtol = (1e-8 if dtype == np.float64 else 1e-5) if rtol is None else float(rtol)
    atol = 1e-9 * rtol if atol is None else float(atol)
    if not 20 * eps <= rtol < 1:
        raise ValueError(
            f"rtol must be less than 1 and at least {20 * eps:.1g}, which is what {dtype}"
            f" can deliver, got {rtol:g}"
        )
    if not 0 <= atol < 1:
        raise ValueError(f"atol must be at least 0 and less than 1, got {atol:g}")
    if solver not in SOLVERS:
        raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {solver!r}")
    if max_impacts < 0:
        raise ValueError(f"max_impacts must be at least 0, got {max_impacts}")
    relative, absolute = (np.asarray(number, dtype) for number in (rtol, atol))
    method, model = Method(solver), as_model(model)
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(driven))
    with _unchecked():
        if traced:
            return compiled(driven, relative, absolute, model, max_impacts, method)
        return _whole(driven, relative, absolute, model, method)
