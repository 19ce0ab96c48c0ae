"""Resonance spectra: functions of one scene, mapped along each axis of a grid."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .. import resonance
from ..accuracy import is_linearized_enough
from ..block import RECTANGLE_INERTIA_RATIO, Block, warn_of_size
from ..grids import Chunks, Grid, GridVariable, Values, apply_in_tiles, list_points
from ..host import count_processors
from ..resonance import Linearized, ModelLike, Nonlinear, RockingModel, Scene
from ..validation import POSITIVE, as_real, check
from .blocks import describe_blocks, make_axes, make_variables, take_magnitudes

if TYPE_CHECKING:
    import xarray

_AXES = ("slenderness", "width", "restitution", "intensity")
# Number of points in a program. On one processor a tile is so small that the cache holds all
# intermediate results. Several processors share each loop, so that a tile can be larger.
# Programs of both sizes round alike, as a test shows: a spectrum must not depend on the number
# of processors.
_TILES = (2**12, 2**15)
_LARGEST = 2**20  # number of points of a grid that fit into memory at once

_VARIABLES = {  # long name and unit
    "rotation_ratio": ("stabilized peak rotation over critical angle", "1"),
    "peak_rotation": ("stabilized peak rotation", "rad"),
    "stabilized_period": ("stabilized period", "s"),
    "amplification": ("stabilized peak rotation over peak after the first pulse", "1"),
    "overturning_margin": ("missing energy over the barrier, overturns at 0 or less", "1"),
    "overturning_half_cycle": ("first half-cycle that overturns, inf if none does", "1"),
    "critical_intensity": ("intensity of unlimited pulses that just overturn", "m s-1"),
}
_MODEL = {  # attributes of the variable with the model of each point
    "long_name": "model used at this point",
    "flag_values": np.array([0, 1], np.int8),
    "flag_meanings": "linearized nonlinear",
}


def resonance_spectrum(  # noqa: PLR0913
    slenderness: Values,
    width: Values,
    restitution: Values,
    intensity: Values,
    *,
    model: ModelLike | Literal["auto"] = Linearized(),
    tolerance: float = 1e-3,
    gravity: float = 9.81,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    store: str | Path | None = None,
    chunks: Chunks | None = None,
) -> "xarray.Dataset":
    """Compute resonance spectra over a full grid of blocks, restitutions and pulse intensities.

    Parameters
    ----------
    slenderness, width, restitution, intensity : array_like
        lambda [-], full width 2b [m], C [-] and I [m/s], numbers or one-dimensional. An array
        makes a dimension of the dataset, a number a scalar coordinate.
    model : Linearized or Nonlinear, their names, or "auto"
        `Linearized` by default, as in the paper; driven motion is `Nonlinear` by default.
        "auto" takes at each point the cheapest model within `tolerance`; the variable model
        names it.
    tolerance : float
        For "auto": relative tolerance of rotation_ratio, peak_rotation, stabilized_period
        and critical_intensity.
    gravity, inertia_ratio, one_sided : float, float, bool
        g [m/s2], kappa [-], and whether all blocks stand against a wall; see `Block`. For
        one-sided blocks the axis ``restitution`` has magnitudes.
    store : path, optional
        A NetCDF file to which the values are written as they are computed, and from which the
        dataset reads them on demand, so that they need not fit into memory. An existing file
        is replaced once the new one is complete.
    chunks : mapping of str to int or "auto", optional
        Lengths of chunks by dimension, as in ``{"slenderness": 50}``; other dimensions are
        not divided. The dataset is then lazy: it has Dask arrays, with one task for each
        chunk, and nothing is computed yet. The values are the same. Needs
        ``jaxrock[cluster]``; see `jaxrock.grids`.

    Returns
    -------
    xarray.Dataset
        Has slenderness, width, restitution and intensity as dimensions or scalar coordinates,
        and the variables rotation_ratio, peak_rotation, stabilized_period, amplification,
        overturning_margin, overturning_half_cycle and critical_intensity, which does not
        depend on the intensity. Quantities that presuppose a standing block are NaN where it
        overturns; overturning_margin shows where.

    Raises
    ------
    ValueError
        If an argument is empty, has several dimensions or a value out of range;
        if `store` cannot be written.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)
    >>> print(spectrum.rotation_ratio.sel(width=0.4).values.round(3))
    [0.077 0.317]
    """
    single = None if isinstance(model, str) and model == "auto" else resonance.as_model(model)
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    name = single.name if single else "auto"
    block, attributes = describe_blocks(name, gravity, inertia_ratio, one_sided)
    if one_sided:
        restitution = take_magnitudes(restitution)
    axes = make_axes(
        slenderness=slenderness, width=width, restitution=restitution, intensity=intensity
    )
    warn_of_size("width", axes["width"])
    dtype = jnp.result_type(float)
    table: Any = {name: (dtype, *described) for name, described in _VARIABLES.items()}
    variables = make_variables(_AXES, table)
    # The critical intensity does not depend on the axis of intensities.
    critical = variables["critical_intensity"]
    variables["critical_intensity"] = critical._replace(dims=_AXES[:3])
    if single is None:
        attributes["tolerance"] = tolerance
        variables["model"] = GridVariable(_AXES, np.int8, _MODEL)
    return Grid(
        "Resonance spectra of rigid rocking blocks",
        axes,
        variables,
        attributes,
        functools.partial(_compute_part, single, tolerance),
        _LARGEST,
        shared=block,
    ).build_dataset(chunks, store)


def _compute_scene(scene: Scene, model: RockingModel) -> dict[str, Array]:
    """Compute all variables for one scene."""
    return {
        "rotation_ratio": resonance.rotation_ratio(scene, model),
        "peak_rotation": resonance.stabilized_rotation(scene, model),
        "stabilized_period": resonance.stabilized_period(scene, model),
        "amplification": resonance.amplification(scene, model),
        "overturning_margin": resonance.overturning_margin(scene, model),
        "overturning_half_cycle": resonance.overturning_half_cycle(scene, model),
        "critical_intensity": _critical_intensity(scene, model),
    }


def _critical_intensity(scene: Scene, model: RockingModel) -> Array:
    """Compute the critical intensity of a scene, whatever its own intensity is."""
    return resonance.critical_intensity(scene.block, scene.restitution, model=model)


def _compute_part(
    model: RockingModel | None, tolerance: float, block: Block, *coordinates: np.ndarray
) -> dict[str, np.ndarray]:
    """Compute all variables over a part of a grid, by a model or the cheapest at each point."""
    shape, points = list_points(*coordinates)
    if model is not None:
        answers = _compute_at_points(_compute_scene, points, block, model)
    else:
        answers = _compute_by_cheapest(points, block, tolerance)
    answers = {name: values.reshape(shape) for name, values in answers.items()}
    # The critical intensity is the same along the axis of intensities: the first point is
    # kept.
    if coordinates[-1].ndim:
        answers["critical_intensity"] = answers["critical_intensity"][..., 0]
    return answers


def _compute_by_cheapest(
    points: np.ndarray, block: Block, tolerance: float
) -> dict[str, np.ndarray]:
    """Compute all variables at points, each by the cheapest model, with that model's number."""
    linear = _compute_at_points(is_linearized_enough, points, block, tolerance)
    answers = {name: np.empty(linear.shape, jnp.result_type(float)) for name in _VARIABLES}
    for model, mask in ((Linearized(), linear), (Nonlinear(), ~linear)):
        if mask.any():
            values = _compute_at_points(_compute_scene, points[:, mask], block, model)
            for name, part in values.items():
                answers[name][mask] = part
    # The critical intensity is one number for all intensities of the axis, even if the other
    # variables come from both models along it.
    exact = _compute_at_points(_critical_intensity, points, block, Nonlinear())
    return answers | {"critical_intensity": exact, "model": ~linear}


def _compute_at_points(
    function: Callable[[Scene, Any], PyTree],
    points: np.ndarray,
    block: Block,
    argument: PyTree,
) -> PyTree:
    """Apply a function of a scene and an argument at points of shape (axes, n), in NumPy."""
    devices = jax.local_devices()
    # On processors threads share the tiles; with accelerators one thread feeds each device.
    is_cpu = devices[0].platform == "cpu"
    workers = max(count_processors() * is_cpu, len(devices))

    def compute_tile(number: int, tile: np.ndarray) -> PyTree:
        given = (tile, block, argument)
        if len(devices) > 1:
            # Each tile runs in the program for one device: a program partitioned over several
            # devices could round differently.
            given = jax.device_put(given, devices[number % len(devices)])
        return _apply_to_scenes(*given, function=function)

    values = np.asarray(points, jnp.result_type(float))
    tile = _TILES[count_processors() > 1] if is_cpu else _LARGEST
    return apply_in_tiles(compute_tile, tile, values, workers)


@functools.partial(jax.jit, static_argnames="function")
def _apply_to_scenes(
    points: Array, block: Block, argument: PyTree, *, function: Callable[[Scene, Any], PyTree]
) -> PyTree:
    """Apply a function of a scene and an argument to many scenes, in one program."""

    def apply_to_one(
        slenderness: Array, width: Array, restitution: Array, intensity: Array
    ) -> PyTree:
        numbers = (width / 2, slenderness, block.gravity, block.inertia_ratio)
        made = Block(*numbers, one_sided=block.one_sided)
        return function(Scene(made, restitution, intensity), argument)

    return jax.vmap(apply_to_one)(*points)
