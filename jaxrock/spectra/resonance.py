"""Resonance spectra: functions of one scene, mapped along each axis of a grid."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .. import resonance
from ..accuracy import is_linearized_enough
from ..block import RECTANGLE_INERTIA_RATIO, Block, warn_of_size
from ..grids import Grid, GridVariable, Values, apply_in_tiles, as_axis, list_points
from ..host import count_processors
from ..resonance import Linearized, ModelLike, Nonlinear, RockingModel, Scene
from ..validation import AT_LEAST_ONE, POSITIVE, as_flag, as_real, check
from .restitutions import take_magnitudes

if TYPE_CHECKING:
    import xarray

    from ..grids import Chunks

Devices = Sequence[jax.Device] | None
_Argument = TypeVar("_Argument")

RESONANCE_AXES = ("slenderness", "width", "restitution", "intensity")
# Points that go through a program at once. On one processor a tile is so small that its cache
# holds what passes from one loop of the program to the next. Several processors share each
# loop, so that a tile can be larger. Programs of both sizes round alike, which a test
# compares: the bits of a spectrum must not depend on the number of processors.
_TILES = (2**12, 2**15)
_LARGEST = 2**20  # points of a grid at once, for which there is memory

_VARIABLES = {  # long name and unit
    "rotation_ratio": ("stabilized peak rotation over critical angle", "1"),
    "peak_rotation": ("stabilized peak rotation", "rad"),
    "stabilized_period": ("stabilized period", "s"),
    "amplification": ("stabilized peak rotation over peak after the first pulse", "1"),
    "overturning_margin": (
        "missing energy over the energy barrier, overturns at 0 or less",
        "1",
    ),
    "overturning_half_cycle": ("first half-cycle that overturns, inf if none does", "1"),
    "critical_intensity": ("intensity of unlimited pulses that just overturn", "m s-1"),
}
_MODEL = {  # attributes of the variable that says which model a point is computed with
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
    devices: Sequence[Any] | None = None,
    chunks: "Chunks | None" = None,
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
    devices : sequence of jax.Device, optional
        Devices that divide the work; by default all devices of this process. The values do
        not depend on them.
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
    constants = {"gravity": gravity, "inertia_ratio": inertia_ratio}
    shared = [as_real("gravity", gravity), as_real("inertia_ratio", inertia_ratio, unit="")]
    for name, value, domain in zip(constants, shared, (POSITIVE, AT_LEAST_ONE), strict=True):
        check(name, value, domain)
    is_auto = isinstance(model, str) and model == "auto"
    single = None if is_auto else resonance.as_model(model)
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    if devices and chunks is not None:
        raise ValueError(
            "devices and chunks exclude each other: each worker has devices of its own"
        )
    if as_flag("one_sided", one_sided):
        restitution = take_magnitudes(restitution)
    given = (slenderness, width, restitution, intensity)
    axes = {
        name: as_axis(name, values) for name, values in zip(RESONANCE_AXES, given, strict=True)
    }
    warn_of_size("width", axes["width"])
    variables = {
        name: GridVariable(
            RESONANCE_AXES, jnp.result_type(float), {"long_name": long_name, "units": units}
        )
        for name, (long_name, units) in _VARIABLES.items()
    }
    # The critical intensity is itself a value along the axis of intensities.
    critical = variables["critical_intensity"]
    variables["critical_intensity"] = critical._replace(dims=RESONANCE_AXES[:3])
    numbers = {name: float(value) for name, value in constants.items()}
    attributes = {"model": "auto", **numbers, "gravity_units": "m s-2"}
    if one_sided:
        attributes["one_sided"] = 1
    if single:
        attributes["model"] = single.name
        compute = functools.partial(
            _compute_by_model, one_sided=one_sided, model=single, devices=devices
        )
    else:
        attributes["tolerance"] = tolerance
        variables["model"] = GridVariable(RESONANCE_AXES, np.int8, _MODEL)
        compute = functools.partial(
            _compute_by_cheapest, one_sided=one_sided, tolerance=tolerance, devices=devices
        )
    grid = Grid(
        "Resonance spectra of rigid rocking blocks",
        axes,
        variables,
        attributes,
        functools.partial(_compute_chunk, compute),
        _LARGEST,
        shared=tuple(shared),
    )
    return grid.build_dataset(chunks, store)


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


def _compute_chunk(
    compute: Callable[..., dict[str, np.ndarray]],
    shared: Sequence[Array],
    *parts: np.ndarray,
) -> dict[str, np.ndarray]:
    """Compute all variables over a chunk."""
    shape, points = list_points(*parts)
    answers = {name: v.reshape(shape) for name, v in compute(points, shared).items()}
    # The critical intensity is the same along the axis of intensities: the first point stands
    # for all of them.
    if parts[-1].ndim:
        answers["critical_intensity"] = answers["critical_intensity"][..., 0]
    return answers


def _compute_by_model(
    points: np.ndarray,
    shared: Sequence[Array],
    *,
    one_sided: bool,
    model: RockingModel,
    devices: Devices,
) -> dict[str, np.ndarray]:
    """Compute all variables at points by one model."""
    return _compute_at_points(_compute_scene, points, shared, one_sided, devices, model)


def _compute_by_cheapest(
    points: np.ndarray,
    shared: Sequence[Array],
    *,
    one_sided: bool,
    tolerance: float,
    devices: Devices,
) -> dict[str, np.ndarray]:
    """Compute all variables at points, each by the cheapest model, and say by which."""
    limit = as_real("tolerance", tolerance)
    given = (shared, one_sided, devices)
    linear = _compute_at_points(is_linearized_enough, points, *given, limit)
    answers = {name: np.empty(linear.shape, jnp.result_type(float)) for name in _VARIABLES}
    for model, mask in ((Linearized(), linear), (Nonlinear(), ~linear)):
        if not mask.any():
            continue
        values = _compute_at_points(_compute_scene, points[:, mask], *given, model)
        for name, part in values.items():
            answers[name][mask] = part
    # The critical intensity is one number for all intensities of the axis, even if the
    # other variables come from one model at some of them and from the other at the rest.
    exact = _compute_at_points(_critical_intensity, points, *given, Nonlinear())
    return answers | {"critical_intensity": exact, "model": ~linear}


def _compute_at_points(
    function: Callable[[Scene, _Argument], PyTree],
    points: np.ndarray,
    shared: Sequence[Array],
    one_sided: bool,
    devices: Devices,
    argument: _Argument,
) -> PyTree:
    """Apply a function of a scene and an argument at points of shape (axes, n), in NumPy."""
    gravity, inertia_ratio = shared
    devices = devices or jax.local_devices()
    # On processors threads share the tiles; with accelerators one thread feeds each device.
    on_processor = devices[0].platform == "cpu"
    workers = max(count_processors(), len(devices)) if on_processor else len(devices)
    elsewhere = len(devices) > 1 or devices[0] != jax.local_devices()[0]

    def compute_tile(number: int, tile: np.ndarray) -> PyTree:
        given = (tile, gravity, inertia_ratio)
        if elsewhere:
            # Each tile by the program for one device: partitioned over
            # several it would be another program, which could round differently.
            given = jax.device_put(given, devices[number % len(devices)])
        return _apply_to_scenes(given, argument, function=function, one_sided=one_sided)

    values = np.asarray(points, jnp.result_type(float))
    tile = _TILES[count_processors() > 1] if on_processor else _LARGEST
    return apply_in_tiles(compute_tile, tile, values, workers)


@functools.partial(jax.jit, static_argnames=("function", "one_sided"))
def _apply_to_scenes(
    given: tuple[Array, Array, Array],
    argument: _Argument,
    *,
    function: Callable[[Scene, _Argument], PyTree],
    one_sided: bool,
) -> PyTree:
    """Apply a function of a scene and an argument to many scenes, in one program."""
    points, gravity, inertia_ratio = given

    def apply_to_one(
        slenderness: Array, width: Array, restitution: Array, intensity: Array
    ) -> PyTree:
        block = Block(width / 2, slenderness, gravity, inertia_ratio, one_sided=one_sided)
        return function(Scene(block, restitution, intensity), argument)

    return jax.vmap(apply_to_one)(*points)
