"""Restitution, and if need be shape and inertia, of a block from a test on a shaking table."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..dynamics import respond
from ..ground_motion import Motion
from ..host import Printed
from ..impact import housner_restitution
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    FINITE,
    POSITIVE,
    UNIT_INTERVAL,
    Booleans,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    check_kind,
    of_one_precision,
)
from .shaking_measurement import (
    RESTITUTIONS,
    ShakingTest,
    Stage,
    fitted_in_parts,
    rough_noise,
    sides_of,
)

_PARAMETERS = "restitution", "slenderness", "half_width", "inertia_ratio"
_LEAST_ROOM = 512  # for impacts in a list, or twice as much as any motion tried needs


class DrivenFit(Printed, eqx.Module):
    """What a test on a shaking table says about a block; see `fit_driven_rocking`.

    Attributes
    ----------
    parameters : tuple of str
        The names of the numbers fitted.
    values, standard_errors : dict of Array
        Of these, by name.
    covariance : Array, shape (parameters, parameters)
        In their order.
    restitution, block : Array, Block
        With the numbers fitted in place, ready for everything else.
    rotation, residuals : Array, shape (n,)
        The rotation computed [rad], and how much that is more than the measured one [rad].
    rotation_noise : Array
        Standard deviation of a measured rotation [rad], given or estimated.
    used_until, last_time : Array
        Time up to which the measurements count [s]. Beyond it the computed motion goes another
        way: impacts come in another order, or so much follows from a small change that
        derivatives mean nothing.
    same_order : Array of bool
        Whether the block computed is never seen on the other side than the measured one, up to
        the end.
    converged : Array of bool
        Whether the search has, for the part that counts.
    """

    parameters: tuple[str, ...] = eqx.field(static=True)
    values: dict[str, Reals]
    standard_errors: dict[str, Reals]
    covariance: Reals
    restitution: Reals
    block: Block
    rotation: Reals
    residuals: Reals
    rotation_noise: Reals
    used_until: Reals
    last_time: Reals
    same_order: Booleans
    converged: Booleans

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before the numbers are used, in sentences."""
        said = []
        if not bool(self.converged):
            said.append("the search has not converged")
        if not bool(self.same_order):
            said.append("impacts come in another order than measured before the end")
        if float(self.used_until) < float(self.last_time):
            said.append(
                f"beyond {float(self.used_until):.4g} s the computed motion goes another way or"
                " hangs on too little: only what is before counts"
            )
        return tuple(said)

    def __str__(self) -> str:
        lines = [
            f"{name.replace('_', ' '):20}{float(self.values[name]):.6g}"
            f" +- {float(self.standard_errors[name]):.2g}"
            for name in self.parameters
        ]
        lines.append(f"{'rotation noise':20}{float(self.rotation_noise):.3g} rad")
        return "\n".join([*lines, *self.remarks])


def fit_driven_rocking(
    time: Numbers,
    rotation: Numbers,
    block: Block,
    motion: Motion,
    restitution: Number | None = None,
    *,
    parameters: Sequence[str] = ("restitution",),
    initial_rotation: Number = 0.0,
    initial_velocity: Number = 0.0,
    model: ModelLike = Nonlinear(),
    rotation_noise: Number | None = None,
) -> DrivenFit:
    """Restitution of a block from its rotation measured on a shaking table.

    By least squares through `respond` and its derivatives, over one more part of the motion
    after another: an impact in another order would put the block on another side, from where no
    derivative leads back.

    Parameters
    ----------
    time, rotation : array_like, shape (n,)
        Increasing times [s] and the rotations alpha measured there [rad], positive to the side
        to which a positive acceleration pushes; NaN where unknown.
    block, motion : Block, Motion
        The block, and what the table did.
    restitution : float, optional
        C to begin with, or C where it is not fitted; by default the best of several, from 0.5
        to 0.98, in the first part of the motion.
    parameters : sequence of str
        What is fitted: "restitution", "slenderness", "half_width", "inertia_ratio".
    initial_rotation, initial_velocity : float
        At time 0 [rad], [rad/s]; at rest by default.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rotation_noise : float, optional
        Standard deviation of the measured rotations [rad], taken as independent; by default
        estimated from the residuals.

    Returns
    -------
    DrivenFit

    Raises
    ------
    ValueError
        If an argument is out of range, traced, or not of the shape it has to be; if the measured
        block hardly moves, or the one computed overturns or does not move for all C tried.

    Notes
    -----
    Standard errors are those about the motion found. The longer a test, the smaller they are and
    the more motions there are beside it: a C that is off by many of the last standard errors, but
    not of those that the first impacts give, may explain the test as well.

    Examples
    --------
    >>> import jaxrock as jr, numpy as np
    >>> block, pulse = jr.Block(0.2, 5.0), jr.Sine(amplitude=2.5, duration=0.8)
    >>> time = np.linspace(0, 4, 201)
    >>> rotation, _ = jr.respond(block, 0.85, pulse, 4.0).history(time)
    >>> fit = jr.fit_driven_rocking(time, rotation, block, pulse)
    >>> print(f"{fit.restitution:.4f}", bool(fit.same_order))
    0.8500 True
    """
    test = _checked(
        time, rotation, block, motion, restitution, parameters, rotation_noise,
        (initial_rotation, initial_velocity), as_model(model),
    )  # fmt: skip
    return _result(test, fitted_in_parts(test, restitution, rotation_noise))


def _checked(
    time: Any,
    rotation: Any,
    block: Any,
    motion: Any,
    restitution: Any,
    parameters: Sequence[str],
    noise: Any,
    initial: tuple[Any, Any],
    model: RockingModel,
) -> ShakingTest:
    """The test, all of it concrete and allowed."""
    check_kind("block", block, Block)
    check_kind("motion", motion, Motion)
    if isinstance(parameters, str) or not parameters:
        raise ValueError(f"parameters must be one or more names, got {parameters!r}")
    for name in parameters:
        if name not in _PARAMETERS or list(parameters).count(name) > 1:
            allowed = ", ".join(_PARAMETERS)
            raise ValueError(f"parameters must be different ones of {allowed}, got {name!r}")
    times, angles = as_real("time", time), as_real("rotation", rotation)
    given = housner_restitution(block) if restitution is None else restitution
    start = as_real("restitution", given)
    initial = as_real("initial_rotation", initial[0]), as_real("initial_velocity", initial[1])
    size = as_real("rotation_noise", 1.0 if noise is None else noise)
    tree = (times, angles, start, initial, size, block, motion)
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree)):
        raise ValueError("arguments must be concrete here: a fit is made outside of jit and vmap")
    if times.ndim != 1 or times.size < 2 or angles.shape != times.shape:
        raise ValueError(
            "time and rotation must be one-dimensional, of one length of at least 2,"
            f" got shapes {times.shape} and {angles.shape}"
        )
    check("time", times, FINITE)
    if (np.diff(np.asarray(times)) <= 0).any() or float(times[0]) < 0:
        raise ValueError("time must increase from each to the next, from 0 on")
    known = ~np.isnan(np.asarray(angles))
    check("rotation", np.asarray(angles)[known], FINITE)
    if known.sum() <= len(parameters):
        least = len(parameters) + 1
        raise ValueError(f"rotation must be known at {least} times at least, got {known.sum()}")
    if restitution is not None:
        check("restitution", start, UNIT_INTERVAL)
    check("initial_rotation", initial[0], FINITE)
    check("initial_velocity", initial[1], FINITE)
    check("rotation_noise", size, POSITIVE)
    numbers = of_one_precision(tree)
    times, angles, start, initial, size, block, motion = numbers
    measured = jnp.where(known, angles, 0)
    if noise is None:
        size = jnp.asarray(rough_noise(np.asarray(angles)[known]), times.dtype)
        if float(size) == 0:
            raise ValueError("rotation must be of a block that rocks, got 0 everywhere")
    counts = jnp.asarray(known)
    begin = {"rotation": initial[0], "velocity": initial[1], "model": model}
    trials = (*RESTITUTIONS[::8], float(start)) if "restitution" in parameters else (float(start),)
    impacts = max(int(respond(block, c, motion, times[-1], **begin).impacts) for c in trials)
    room = _LEAST_ROOM
    while room < 2 * impacts:
        room *= 4  # so that few are compiled
    scene = size, block, start, motion.bucketed(), initial
    return ShakingTest(times, measured, counts, *scene, tuple(parameters), model, room)


def _result(test: ShakingTest, stage: Stage) -> DrivenFit:
    if not np.isfinite(stage.rotation).all():
        raise ValueError("the motion of the block could not be followed; see the status of respond")
    measured, errors = np.asarray(test.measured), np.sqrt(np.diagonal(stage.covariance))
    against = sides_of(test, measured) * sides_of(test, stage.rotation) < 0
    residuals = np.where(np.asarray(test.counts), stage.rotation - measured, np.nan)
    block, restitution = test.scene(jnp.asarray(stage.numbers))
    names = test.parameters
    return DrivenFit(
        parameters=names,
        values=dict(zip(names, map(jnp.asarray, stage.values), strict=True)),
        standard_errors=dict(zip(names, map(jnp.asarray, errors), strict=True)),
        covariance=jnp.asarray(stage.covariance),
        restitution=restitution if "restitution" in names else test.restitution,
        block=block,
        rotation=jnp.asarray(stage.rotation),
        residuals=jnp.asarray(residuals),
        rotation_noise=jnp.asarray(stage.noise),
        used_until=jnp.asarray(stage.end),
        last_time=test.time[-1],
        same_order=jnp.asarray(not against.any()),
        converged=jnp.asarray(stage.converged),
    )
