"""Resonance spectra: functions of one scene, mapped along each axis of a grid."""

import collections
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..accuracy import linearized_is_enough
from ..block import Block
from ..host import with_progress
from ..resonance import (
    Linearized,
    ModelLike,
    Nonlinear,
    RockingModel,
    Scene,
    amplification,
    as_model,
    critical_intensity,
    overturning_half_cycle,
    overturning_margin,
    rotation_ratio,
    stabilized_period,
    stabilized_rotation,
)
from ..validation import POSITIVE, as_real, check
from .grid import Chunk, Values, axis, chunks_of, labelled_grid, parts_of
from .storage import stored

if TYPE_CHECKING:
    import xarray

RESONANCE_AXES = ("slenderness", "width", "restitution", "intensity")

# By name: a function of one scene and a model, the long name and the unit.
_VARIABLES: dict[str, tuple[Callable[[Scene, RockingModel], Array], str, str]] = {
    "rotation_ratio": (rotation_ratio, "stabilized peak rotation over critical angle", "1"),
    "peak_rotation": (stabilized_rotation, "stabilized peak rotation", "rad"),
    "period": (stabilized_period, "stabilized period", "s"),
    "amplification": (
        amplification,
        "stabilized peak rotation over peak after the first pulse",
        "1",
    ),
    "overturning_margin": (
        overturning_margin,
        "energy left to the barrier over the barrier, overturns from 0 down",
        "1",
    ),
    "overturning_half_cycle": (
        overturning_half_cycle,
        "first half-cycle that overturns, inf if none does",
        "1",
    ),
    "critical_intensity": (
        lambda scene, model: critical_intensity(scene.block, scene.restitution, model=model),
        "intensity of unlimited pulses that just overturn",
        "m s-1",
    ),
}

_POINTS = 2**16  # of one model, computed at once


def resonance_spectrum(
    slenderness: Values,
    width: Values,
    restitution: Values,
    intensity: Values,
    *,
    model: ModelLike | Literal["auto"] = Linearized(),
    tolerance: float = 1e-3,
    gravity: float = 9.81,
    chunk: int = 2**16,
    store: str | Path | None = None,
    devices: Sequence[Any] | None = None,
) -> "xarray.Dataset":
    """Resonance spectra over a full grid of blocks, restitutions and pulse intensities.

    Parameters
    ----------
    slenderness, width, restitution : array_like
        Values of lambda [-], full width 2b [m] and C [-], each a number or one-dimensional.
    intensity : array_like
        I [m/s]; a one-dimensional array adds the dimension intensity.
    model : Linearized or Nonlinear, or "auto"
        "auto": at each grid point the cheapest that keeps the `tolerance`, named in the
        variable model.
    tolerance : float
        For "auto", on rotation_ratio, peak_rotation, period and critical_intensity, relative.
    gravity : float
        g [m/s2].
    chunk : int
        Most grid points that are computed at once. A grid of several chunks shows its
        progress if it takes long and standard error is a terminal.
    store : path, optional
        A NetCDF file to put the values into as they are computed. The dataset returned then
        reads from it on demand, so that neither has to fit into memory. An existing file
        is replaced, once all is computed.
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
        If an argument is empty, has several dimensions, or has a value outside of what is
        allowed; if `store` cannot be written.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)
    >>> print(spectrum.rotation_ratio.sel(width=0.4, restitution=0.6).values.round(3))
    [0.077 0.317]
    """
    check("gravity", as_real("gravity", gravity), POSITIVE)
    model = model if model == "auto" else as_model(model)
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    if chunk < 1:
        raise ValueError(f"chunk must be at least 1, got {chunk}")
    given = (slenderness, width, restitution, intensity)
    axes = {name: axis(name, values) for name, values in zip(RESONANCE_AXES, given, strict=True)}
    dims = RESONANCE_AXES if np.ndim(np.asarray(intensity)) else RESONANCE_AXES[:3]
    attributes = {
        "model": model if isinstance(model, str) else model.name,
        "gravity": gravity,
        "gravity_units": "m s-2",
    }
    if model == "auto":
        attributes["tolerance"] = tolerance
    # In a file the values need no memory: the dataset only gives their shapes.
    array = np.empty if store is None else _without_memory
    variables = _variables(axes, dims, model, array)

    def fill(targets: Mapping[str, Any]) -> None:
        _fill(targets, axes, model, tolerance, gravity, chunk, devices or jax.local_devices())

    if store is None:
        fill({name: values for name, (_, values, _) in variables.items()})
    title = "Resonance spectra of rigid rocking blocks"
    dataset = labelled_grid(title, axes, dims, variables, attributes)
    return dataset if store is None else stored(Path(store), dataset, fill)


def _without_memory(shape: Sequence[int], dtype: Any) -> np.ndarray:
    return np.broadcast_to(np.zeros((), dtype), shape)


def _variables(
    axes: Mapping[str, np.ndarray],
    dims: tuple[str, ...],
    model: RockingModel | str,
    array: Callable[..., np.ndarray],
) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, Any]]]:
    """Dimensions, arrays and attributes of the variables."""
    shape, variables = [axes[dim].size for dim in dims], {}
    for name, (_, long_name, units) in _VARIABLES.items():
        rank = 3 if name == "critical_intensity" else len(dims)
        values = array(shape[:rank], jnp.result_type(float))
        variables[name] = (dims[:rank], values, {"long_name": long_name, "units": units})
    if model == "auto":
        flags = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "linearized nonlinear"}
        attributes = {"long_name": "model that this point is computed with", **flags}
        variables["model"] = (dims, array(shape, np.int8), attributes)
    return variables


def _of_one_scene(scene: Scene, model: RockingModel) -> dict[str, Array]:
    return {name: function(scene, model) for name, (function, _, _) in _VARIABLES.items()}


def _along_axes(function: Callable[..., Any], of_intensity: Any = 0) -> Callable[..., Any]:
    """A function of one scene, under `jax.vmap` along each axis of a grid.

    `of_intensity` is None for results that do not depend on the intensity.
    """

    def over_grid(
        slenderness: Array, width: Array, restitution: Array, intensity: Array, g: Array, *rest: Any
    ) -> Any:
        def of_one(slenderness: Array, width: Array, restitution: Array, intensity: Array) -> Any:
            block = Block(width / 2, slenderness, g)
            return function(Scene(block, restitution, intensity), *rest)

        # What does not depend on an axis is computed once for it: nothing is broadcast before.
        along_intensity = jax.vmap(of_one, (None, None, None, 0), of_intensity)
        along_restitution = jax.vmap(along_intensity, (None, None, 0, None))
        along_width = jax.vmap(along_restitution, (None, 0, None, None))
        along_slenderness = jax.vmap(along_width, (0, None, None, None))
        return along_slenderness(slenderness, width, restitution, intensity)

    return eqx.filter_jit(over_grid)


_evaluate = _along_axes(
    _of_one_scene, {name: None if name == "critical_intensity" else 0 for name in _VARIABLES}
)
_evaluate_points = eqx.filter_jit(jax.vmap(_of_one_scene, (0, None)))
_linearized_is_enough = _along_axes(linearized_is_enough)
_critical_intensity = _along_axes(_VARIABLES["critical_intensity"][0], None)


def _fill(
    targets: Mapping[str, Any],
    axes: Mapping[str, np.ndarray],
    model: RockingModel | str,
    tolerance: float,
    gravity: float,
    chunk: int,
    devices: Sequence[Any],
) -> None:
    """Compute the grid chunk by chunk into `targets`, anything that takes slices.

    The devices take turns, and each has the next chunk to work on while one is put away. All
    run the same program for one device: XLA makes another one, whose last digits differ, of
    what is partitioned.
    """
    under_way: collections.deque[tuple[Chunk, Mapping[str, Any]]] = collections.deque()

    def put_away() -> None:
        place, answers = under_way.popleft()
        for name, values in answers.items():
            target = targets[name]
            part = place[: target.ndim]
            target[part] = np.asarray(values).reshape([p.stop - p.start for p in part])

    places = list(chunks_of([values.size for values in axes.values()], chunk))
    for number, place in enumerate(with_progress(places, "spectrum")):
        grid = (*parts_of(axes, place), as_real("gravity", gravity))
        grid = jax.device_put(grid, devices[number % len(devices)])
        answers = _auto(grid, tolerance) if isinstance(model, str) else _evaluate(*grid, model)
        under_way.append((place, answers))
        if len(under_way) > len(devices):
            put_away()
    while under_way:
        put_away()


def _auto(grid: tuple[Array, ...], tolerance: float) -> dict[str, np.ndarray]:
    """As `_evaluate`, the linearized points apart from the nonlinear ones; and which is which."""
    linear = np.asarray(_linearized_is_enough(*grid, as_real("tolerance", tolerance)))
    answers = {name: np.empty(linear.shape, jnp.result_type(float)) for name in _VARIABLES}
    slenderness, width, restitution, intensity, gravity = map(np.asarray, grid)
    for model, mask in ((Linearized(), linear), (Nonlinear(), ~linear)):
        places = np.flatnonzero(mask)
        for start in range(0, places.size, _POINTS):
            part = places[start : start + _POINTS]
            # Few different sizes, so that little is compiled.
            room = min(_POINTS, max(1 << (part.size - 1).bit_length(), 1024))
            padded = np.pad(part, (0, room - part.size), mode="edge")
            a, b, c, i = np.unravel_index(padded, linear.shape)
            block = Block(width[b] / 2, slenderness[a], np.full(room, gravity))
            scenes = jax.device_put(Scene(block, restitution[c], intensity[i]), grid[0].device)
            for name, values in _evaluate_points(scenes, model).items():
                answers[name].reshape(-1)[part] = np.asarray(values)[: part.size]
    # It has no intensity, and all intensities have to agree about it.
    exact = np.asarray(_critical_intensity(*grid, Nonlinear()))
    return answers | {"critical_intensity": exact, "model": np.where(linear, 0, 1)}
