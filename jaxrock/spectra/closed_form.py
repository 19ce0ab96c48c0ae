"""Sweeps over grids of scenes, to labelled datasets and files."""

import collections
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..accuracy import linearized_is_enough
from ..block import Block
from ..host import labelled, with_progress, written_whole
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
from ..validation import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain, Number, as_real, check

if TYPE_CHECKING:
    import xarray

Values = Number | Sequence[float | int]


class _Axis(NamedTuple):
    long_name: str
    units: str
    domain: Domain


class _Variable(NamedTuple):
    long_name: str
    units: str
    function: Callable[[Scene, RockingModel], Array]


_PIECE = 2**16  # of points of one model

RESONANCE_AXES = {
    "slenderness": _Axis("slenderness, height over width", "1", POSITIVE),
    "width": _Axis("full width 2b of the base", "m", POSITIVE),
    "restitution": _Axis("coefficient of restitution, ratio of velocities", "1", UNIT_INTERVAL),
    "intensity": _Axis("intensity of each pulse", "m s-1", NON_NEGATIVE),
}

_VARIABLES = {
    "rotation_ratio": _Variable(
        "stabilized peak rotation over critical angle", "1", rotation_ratio
    ),
    "peak_rotation": _Variable("stabilized peak rotation", "rad", stabilized_rotation),
    "period": _Variable("stabilized period", "s", stabilized_period),
    "amplification": _Variable(
        "stabilized peak rotation over peak after the first pulse", "1", amplification
    ),
    "overturning_margin": _Variable(
        "energy left to the barrier over the barrier, overturns from 0 down",
        "1",
        overturning_margin,
    ),
    "overturning_half_cycle": _Variable(
        "first half-cycle that overturns, inf if none does", "1", overturning_half_cycle
    ),
    "critical_intensity": _Variable(
        "intensity of unlimited pulses on the verge of overturning",
        "m s-1",
        lambda scene, model: critical_intensity(scene.block, scene.restitution, model=model),
    ),
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
        Rung of the ladder of models. "auto": at each grid point the cheapest that keeps the
        `tolerance`, named in the variable model.
    tolerance : float
        For "auto", on rotation_ratio, peak_rotation, period and critical_intensity, relative.
    gravity : float
        g [m/s2].
    chunk : int
        Most grid points that are computed at once. A grid of several chunks shows its
        progress if it takes long and standard error is a terminal.
    store : path, optional
        A NetCDF file to put the values into as they are computed. The dataset returned then
        reads from it when asked, so that neither has to fit into memory. An existing file
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
    axes = {
        name: axis(name, value, RESONANCE_AXES[name].domain)
        for name, value in zip(RESONANCE_AXES, given, strict=True)
    }
    template = _template(axes, np.ndim(np.asarray(intensity)) > 0, model, tolerance, gravity)

    def fill(targets: Mapping[str, Any]) -> None:
        _fill(targets, axes, model, tolerance, gravity, chunk, devices or jax.local_devices())

    if store is None:
        values = {
            str(name): np.empty(variable.shape, variable.dtype)
            for name, variable in template.items()
        }
        fill(values)
        return template.assign(
            {name: (template[name].dims, values[name], template[name].attrs) for name in values}
        )
    path = Path(store)
    with written_whole("store", path.parent, [path.name], overwrite=True) as scratch:
        _store(scratch / path.name, template, fill)
    import xarray

    return xarray.open_dataset(path)


def write_table(dataset: "xarray.Dataset", path: str | Path) -> None:
    """Write a spectrum as CSV: a column each dimension and variable, a row each grid point.

    Part by part, so that the table need not fit into memory. An existing file is replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `resonance_spectrum`.
    path : str or path
        The file to write.

    Raises
    ------
    ValueError
        If `path` cannot be written.
    """
    path = Path(path)
    with (
        written_whole("path", path.parent, [path.name], overwrite=True) as scratch,
        open(scratch / path.name, "w", newline="", encoding="utf-8") as file,
    ):
        for index, part in enumerate(with_progress(_parts(dataset), "table")):
            dataset.isel(part).to_dataframe().to_csv(file, header=index == 0)


def overturned_share(dataset: "xarray.Dataset") -> float:
    """The share of the scenes in a spectrum that overturn under unlimited pulses."""
    margin = dataset.overturning_margin
    overturned = sum(
        int((margin.isel(part) <= 0).sum()) for part in with_progress(_parts(dataset), "overturned")
    )
    return overturned / margin.size


def _parts(dataset: "xarray.Dataset", most: int = 2**18) -> list[dict[str, slice]]:
    """Cut a dataset into parts of at most `most` points, in the order of its rows."""
    dims = dataset.overturning_margin.dims
    parts = chunks_of([dataset.sizes[dim] for dim in dims], most)
    return [dict(zip(map(str, dims), part, strict=True)) for part in parts]


def axis(name: str, value: Values, domain: Domain) -> np.ndarray:
    """The values along a dimension: one or more, different, and all in `domain`."""
    try:
        values = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number or numbers, got {value!r}") from None
    if values.ndim > 1 or values.size == 0:
        raise ValueError(
            f"{name} must be a number or a one-dimensional array of at least one,"
            f" got an array of shape {values.shape}"
        )
    check(name, values, domain)
    values = np.atleast_1d(values)
    distinct, counts = np.unique(values, return_counts=True)
    if distinct.size < values.size:
        raise ValueError(f"{name} must not have a value twice, got {distinct[counts > 1][0]:g}")
    return values


def _template(
    axes: Mapping[str, np.ndarray],
    with_intensity: bool,
    model: RockingModel | str,
    tolerance: float,
    gravity: float,
) -> "xarray.Dataset":
    """The dataset without values: coordinates, attributes, and variables that take no memory."""
    dims = tuple(axes) if with_intensity else tuple(axes)[:3]
    dtype = jnp.result_type(float)
    variables = {}
    for name, variable in _VARIABLES.items():
        own = dims[:3] if name == "critical_intensity" else dims
        empty = np.broadcast_to(np.zeros((), dtype), [axes[dim].size for dim in own])
        variables[name] = (own, empty, {"long_name": variable.long_name, "units": variable.units})
    if model == "auto":
        shape = [axes[dim].size for dim in dims]
        meanings = {
            "long_name": "model that this point is computed with",
            "flag_values": np.array([0, 1], np.int8),
            "flag_meanings": "linearized nonlinear",
        }
        variables["model"] = (dims, np.broadcast_to(np.zeros((), np.int8), shape), meanings)
    coordinates = {
        name: (
            (name,) if name in dims else (),
            values if name in dims else values[0],
            {"long_name": RESONANCE_AXES[name].long_name, "units": RESONANCE_AXES[name].units},
        )
        for name, values in axes.items()
    }
    attributes = {
        "model": model if isinstance(model, str) else model.name,
        "gravity": gravity,
        "gravity_units": "m s-2",
    }
    if model == "auto":
        attributes["tolerance"] = tolerance
    return labelled("Resonance spectra of rigid rocking blocks", variables, coordinates, attributes)


@eqx.filter_jit
def _evaluate(scene: Scene, model: RockingModel) -> dict[str, Array]:
    return {name: variable.function(scene, model) for name, variable in _VARIABLES.items()}


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
    under_way: collections.deque[tuple[tuple[slice, ...], Mapping[str, Any]]] = collections.deque()

    def put_away() -> None:
        block, answers = under_way.popleft()
        for name, values in answers.items():
            target = targets[name]
            part = block[: target.ndim]
            target[part] = np.asarray(values).reshape([p.stop - p.start for p in part])

    blocks = list(chunks_of([values.size for values in axes.values()], chunk))
    for number, block in enumerate(with_progress(blocks, "spectrum")):
        grid = (
            np.expand_dims(values[part], tuple(other for other in range(4) if other != position))
            for position, (values, part) in enumerate(zip(axes.values(), block, strict=True))
        )
        slenderness, width, restitution, intensity = grid
        scene = Scene(Block(width / 2, slenderness, gravity), restitution, intensity)
        device = devices[number % len(devices)]
        if isinstance(model, str):
            answers = _by_model(scene, tolerance, device)
        else:
            answers = _evaluate(jax.device_put(scene, device), model)
        under_way.append((block, answers))
        if len(under_way) > len(devices):
            put_away()
    while under_way:
        put_away()


def _by_model(scene: Scene, tolerance: float, device: Any) -> dict[str, np.ndarray]:
    """As `_evaluate`, the linearized points apart from the nonlinear ones; and which is which."""
    linear = np.asarray(linearized_is_enough(scene, tolerance))
    shape, linear = linear.shape, linear.reshape(-1)
    columns = jax.tree.map(lambda leaf: np.broadcast_to(leaf, shape).reshape(-1), scene)
    found = {name: np.empty(linear.shape, jnp.result_type(float)) for name in _VARIABLES}
    for model, where in ((Linearized(), linear), (Nonlinear(), ~linear)):
        (places,) = np.nonzero(where)
        for start in range(0, places.size, _PIECE):
            part = places[start : start + _PIECE]
            # Few different sizes, so that little is compiled.
            room = min(_PIECE, max(1 << (part.size - 1).bit_length(), 1024))
            wanted = np.pad(part, (0, room - part.size), mode="edge")
            scenes = jax.tree.map(lambda leaf, wanted=wanted: leaf[wanted], columns)
            for name, values in _evaluate(jax.device_put(scenes, device), model).items():
                found[name][part] = np.asarray(values)[: part.size]
    shaped = {name: values.reshape(shape) for name, values in found.items()}
    # It has no intensity, and all intensities have to agree about it.
    exact = critical_intensity(scene.block, scene.restitution, model=Nonlinear())
    chosen = np.where(linear, 0, 1).reshape(shape)
    return shaped | {"critical_intensity": np.asarray(exact), "model": chosen}


def chunks_of(sizes: list[int], most: int) -> Iterator[tuple[slice, ...]]:
    """Cut a grid into blocks of at most `most` points, the last axes kept whole first."""
    lengths, left = [], most
    for size in reversed(sizes):
        lengths.insert(0, min(size, max(left, 1)))
        left //= max(lengths[0], 1)
    starts = (range(0, size, length) for size, length in zip(sizes, lengths, strict=True))
    for corner in itertools.product(*starts):
        yield tuple(
            slice(start, min(start + length, size))
            for start, length, size in zip(corner, lengths, sizes, strict=True)
        )


def _store(
    path: Path, template: "xarray.Dataset", fill: Callable[[Mapping[str, Any]], None]
) -> None:
    """Make a NetCDF file like `template` and let `fill` put the values into its variables."""
    import netCDF4

    template.drop_vars(list(template)).reset_coords().to_netcdf(path)
    with netCDF4.Dataset(path, "a") as file:
        for name, variable in template.items():
            dims = [str(dim) for dim in variable.dims]
            missing = math.nan if variable.dtype.kind == "f" else None
            target = file.createVariable(str(name), variable.dtype, dims, fill_value=missing)
            target.setncatts(variable.attrs)
            scalars = [str(other) for other in variable.coords if other not in variable.dims]
            if scalars:
                target.coordinates = " ".join(scalars)
        fill(file.variables)
