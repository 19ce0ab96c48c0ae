"""Resonance spectra: functions of one scene, mapped along each axis of a grid."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .. import resonance
from ..accuracy import linearized_is_enough
from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..resonance import Linearized, ModelLike, Nonlinear, RockingModel, Scene
from ..validation import AT_LEAST_ONE, POSITIVE, as_real, check
from .grid import Values, axis, filled

if TYPE_CHECKING:
    import xarray

RESONANCE_AXES = ("slenderness", "width", "restitution", "intensity")


_VARIABLES = {  # long name and unit
    "rotation_ratio": ("stabilized peak rotation over critical angle", "1"),
    "peak_rotation": ("stabilized peak rotation", "rad"),
    "period": ("stabilized period", "s"),
    "amplification": ("stabilized peak rotation over peak after the first pulse", "1"),
    "overturning_margin": (
        "energy left to the barrier over the barrier, overturns from 0 down",
        "1",
    ),
    "overturning_half_cycle": ("first half-cycle that overturns, inf if none does", "1"),
    "critical_intensity": ("intensity of unlimited pulses that just overturn", "m s-1"),
}
_MODEL = {  # attributes of the variable that says which model a point is computed with
    "long_name": "model that this point is computed with",
    "flag_values": np.array([0, 1], np.int8),
    "flag_meanings": "linearized nonlinear",
}


def resonance_spectrum(
    slenderness: Values,
    width: Values,
    restitution: Values,
    intensity: Values,
    *,
    model: ModelLike | Literal["auto"] = Linearized(),
    tolerance: float = 1e-3,
    gravity: float = 9.81,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    chunk: int = 2**16,
    store: str | Path | None = None,
    devices: Sequence[Any] | None = None,
) -> "xarray.Dataset":
    """Resonance spectra over a full grid of blocks, restitutions and pulse intensities.

    Parameters
    ----------
    slenderness, width, restitution, intensity : array_like
        lambda [-], full width 2b [m], C [-] and I [m/s], numbers or one-dimensional; only an
        array of intensities adds a dimension.
    model : Linearized or Nonlinear, their names, or "auto"
        "auto": at each point the cheapest that keeps the `tolerance`, as the variable model says.
    tolerance : float
        For "auto", on rotation_ratio, peak_rotation, period and critical_intensity, relative.
    gravity, inertia_ratio : float
        g [m/s2] and kappa [-] of all blocks; see `Block`.
    chunk : int
        Most grid points that are computed at once; several chunks show their progress.
    store : path, optional
        A NetCDF file that the values go to as they are computed, and that the dataset reads on
        demand: neither has to fit into memory. One that exists is replaced by the whole new one.
    devices : sequence of jax.Device, optional
        That share the chunks; all of this process unless given. The numbers are the same.

    Returns
    -------
    xarray.Dataset
        With dimensions slenderness, width, restitution (and intensity) the variables
        rotation_ratio, peak_rotation, period, amplification, overturning_margin,
        overturning_half_cycle and critical_intensity. NaN where the block overturns and
        the quantity presupposes that it does not; overturning_margin says where.

    Raises
    ------
    ValueError
        If an argument is empty, has several dimensions or a value outside of what is allowed; if
        `store` cannot be written.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)
    >>> print(spectrum.rotation_ratio.sel(width=0.4, restitution=0.6).values.round(3))
    [0.077 0.317]
    """
    constants = {"gravity": gravity, "inertia_ratio": inertia_ratio}
    shared = [as_real(name, value) for name, value in constants.items()]
    for name, value, domain in zip(constants, shared, (POSITIVE, AT_LEAST_ONE), strict=True):
        check(name, value, domain)
    single = None if model == "auto" else resonance.as_model(model)
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    if chunk < 1:
        raise ValueError(f"chunk must be at least 1, got {chunk}")
    given = (slenderness, width, restitution, intensity)
    axes = {name: axis(name, values) for name, values in zip(RESONANCE_AXES, given, strict=True)}
    dims = RESONANCE_AXES if np.ndim(np.asarray(intensity)) else RESONANCE_AXES[:3]
    variables: dict[str, Any] = {
        name: (dims, jnp.result_type(float), {"long_name": long_name, "units": units})
        for name, (long_name, units) in _VARIABLES.items()
    }
    variables["critical_intensity"] = (dims[:3], *variables["critical_intensity"][1:])
    attributes = {"model": "auto", **constants, "gravity_units": "m s-2"}
    if single:
        attributes["model"] = single.name
    else:
        attributes["tolerance"] = tolerance
        variables["model"] = (dims, np.int8, _MODEL)
    devices = devices or jax.local_devices()
    turns = itertools.cycle(devices)

    def compute(*parts: np.ndarray) -> dict[str, Any]:
        # Each chunk by the program for one device: of what is partitioned XLA makes another
        # one, whose last digits differ.
        grid = jax.device_put((*parts, *shared), next(turns))
        return _evaluate(*grid, single) if single else _auto(grid, tolerance)

    title, ahead = "Resonance spectra of rigid rocking blocks", len(devices)
    return filled(title, axes, variables, attributes, compute, chunk, ahead=ahead, store=store)


def _of_one_scene(scene: Scene, model: RockingModel) -> dict[str, Array]:
    return {
        "rotation_ratio": resonance.rotation_ratio(scene, model),
        "peak_rotation": resonance.stabilized_rotation(scene, model),
        "period": resonance.stabilized_period(scene, model),
        "amplification": resonance.amplification(scene, model),
        "overturning_margin": resonance.overturning_margin(scene, model),
        "overturning_half_cycle": resonance.overturning_half_cycle(scene, model),
        "critical_intensity": _critical_intensity(scene, model),
    }


def _critical_intensity(scene: Scene, model: RockingModel) -> Array:
    return resonance.critical_intensity(scene.block, scene.restitution, model=model)


def _over_grid(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of one scene (and more), mapped along each axis of a grid."""

    def mapped(*grid: Any) -> Any:
        def of_one(slenderness: Array, width: Array, restitution: Array, intensity: Array) -> Any:
            block = Block(width / 2, slenderness, *grid[4:6])
            return function(Scene(block, restitution, intensity), *grid[6:])

        # What does not depend on an axis is computed once for it: nothing is broadcast before.
        for place in (3, 2, 1, 0):
            of_one = jax.vmap(of_one, tuple(0 if place == k else None for k in range(4)))
        return of_one(*grid[:4])

    return eqx.filter_jit(mapped)


_evaluate = _over_grid(_of_one_scene)
_evaluate_points = eqx.filter_jit(jax.vmap(_of_one_scene, (0, None)))
_linearized_is_enough = _over_grid(linearized_is_enough)
_critical_intensities = _over_grid(_critical_intensity)


def _auto(grid: tuple[Array, ...], tolerance: float) -> dict[str, np.ndarray]:
    """As `_evaluate`, the linearized points apart from the nonlinear ones; and which is which."""
    linear = np.asarray(_linearized_is_enough(*grid, as_real("tolerance", tolerance)))
    answers = {name: np.empty(linear.shape, jnp.result_type(float)) for name in _VARIABLES}
    *axes, gravity, inertia_ratio = map(np.asarray, grid)
    for model, mask in ((Linearized(), linear), (Nonlinear(), ~linear)):
        places = np.flatnonzero(mask)
        if not places.size:
            continue
        # Few different sizes, so that little is compiled.
        room = max(1 << (places.size - 1).bit_length(), 1024)
        padded = np.pad(places, (0, room - places.size), mode="edge")
        at = np.unravel_index(padded, linear.shape)
        slenderness, width, restitution, intensity = (v[k] for v, k in zip(axes, at, strict=True))
        shared = (np.full(room, value) for value in (gravity, inertia_ratio))
        block = Block(width / 2, slenderness, *shared)
        scenes = jax.device_put(Scene(block, restitution, intensity), grid[0].device)
        for name, values in _evaluate_points(scenes, model).items():
            answers[name].reshape(-1)[places] = np.asarray(values)[: places.size]
    # It has no intensity, and all intensities have to agree about it.
    exact = np.asarray(_critical_intensities(*grid, Nonlinear()))
    return answers | {"critical_intensity": exact, "model": ~linear}
