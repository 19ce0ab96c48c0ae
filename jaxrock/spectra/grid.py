"""Grids: their named axes, datasets filled over them chunk by chunk, and their tables."""

import collections
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import TypeAliasType

from ..host import heading, labelled, with_progress, write_about, written_whole
from ..validation import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain, Number, as_real, check

if TYPE_CHECKING:
    import xarray

Values = TypeAliasType("Values", Number | Sequence[float | int])
Chunk = tuple[slice, ...]

_AXES: dict[str, tuple[str, str, Domain]] = {  # long name, unit and domain
    "slenderness": ("slenderness, height over width", "1", POSITIVE),
    "width": ("full width 2b of the base", "m", POSITIVE),
    "restitution": ("coefficient of restitution, ratio of velocities", "1", UNIT_INTERVAL),
    "intensity": ("intensity of each pulse", "m s-1", NON_NEGATIVE),
    "period": ("period 2 pi / p of the block", "s", POSITIVE),
    "frequency_ratio": ("frequency of the pulse over p", "1", POSITIVE),
    "amplitude_ratio": (
        "amplitude of the pulse over what just lifts the block",
        "1",
        NON_NEGATIVE,
    ),
}


def axis(name: str, value: Values) -> np.ndarray:
    """The values along an axis: one or more, different, and all in its domain."""
    as_real(name, value)  # in the precision of JAX; the axis keeps its own
    values = np.asarray(value, dtype=float)
    if values.ndim > 1 or values.size == 0:
        raise ValueError(
            f"{name} must be a number or a one-dimensional array of at least one,"
            f" got an array of shape {values.shape}"
        )
    check(name, values, _AXES[name][2])
    values = np.atleast_1d(values)
    distinct, counts = np.unique(values, return_counts=True)
    if distinct.size < values.size:
        raise ValueError(f"{name} must not have a value twice, got {distinct[counts > 1][0]:g}")
    return values


def label(name: str) -> dict[str, str]:
    """The attributes of what is named like an axis."""
    long_name, units, _ = _AXES[name]
    return {"long_name": long_name, "units": units}


def filled(
    title: str,
    axes: Mapping[str, np.ndarray],
    variables: Mapping[str, tuple[Sequence[str], Any, Mapping[str, Any]]],
    attributes: Mapping[str, Any],
    compute: Callable[..., Mapping[str, Any]],
    chunk: int,
    *,
    ahead: int = 0,
    store: str | Path | None = None,
) -> "xarray.Dataset":
    """A dataset over a grid, computed chunk by chunk, in memory or in a NetCDF file.

    `variables` have dimensions, a type and attributes; an axis that is no dimension of theirs
    becomes a scalar coordinate. `compute` takes the values along each axis in a chunk, and
    returns an array over all axes for each variable. While one chunk is stored, the next ones, as
    many as `ahead`, are already being computed.
    """
    used = {dim for dims, _, _ in variables.values() for dim in dims}
    coordinates = {
        name: ((name,), values, label(name)) if name in used else ((), values[0], label(name))
        for name, values in axes.items()
    }

    def fill(targets: Mapping[str, Any]) -> None:
        begun: collections.deque[tuple[Chunk, Mapping[str, Any]]] = collections.deque()
        places = chunks_of([values.size for values in axes.values()], chunk)
        for place in with_progress([*places, None], title.lower()):
            if place:
                parts = (values[part] for values, part in zip(axes.values(), place, strict=True))
                begun.append((place, compute(*parts)))
            while len(begun) > (ahead if place else 0):
                at, answers = begun.popleft()
                for name, target in targets.items():
                    # What has fewer dimensions is the same along the others.
                    first = (..., *[0] * (len(at) - target.ndim))
                    target[at[: target.ndim]] = np.asarray(answers[name])[first]

    if store is None:
        arrays = {
            name: np.empty([axes[dim].size for dim in dims], dtype)
            for name, (dims, dtype, _) in variables.items()
        }
        fill(arrays)
        entries = {name: (v[0], arrays[name], v[2]) for name, v in variables.items()}
        return labelled(title, entries, coordinates, attributes)

    import netCDF4
    import xarray

    path = Path(store)
    scalars = " ".join(name for name in axes if name not in used)
    with written_whole("store", path.parent, [path.name], overwrite=True) as scratch:
        bare = labelled(title, {}, coordinates, attributes)
        bare.reset_coords().to_netcdf(scratch / path.name)
        with netCDF4.Dataset(scratch / path.name, "a") as file:
            for name, (dims, dtype, described) in variables.items():
                missing = math.nan if np.dtype(dtype).kind == "f" else None
                target = file.createVariable(name, dtype, dims, fill_value=missing)
                target.setncatts({**described, **({"coordinates": scalars} if scalars else {})})
            fill({name: file[name] for name in variables})
    return xarray.open_dataset(path)


def chunks_of(sizes: Sequence[int], largest: int) -> list[Chunk]:
    """Divide a grid into chunks of at most `largest` points, the first axes before the last."""
    cuts = []
    for size in reversed(sizes):
        length = min(size, max(largest, 1))
        largest //= length
        cuts.insert(0, [slice(k, min(k + length, size)) for k in range(0, size, length)])
    return list(itertools.product(*cuts))


def write_table(dataset: "xarray.Dataset", path: str | Path) -> None:
    """Write a dataset as CSV: a column each dimension and variable, a row each grid point.

    Lines that begin with # say what it was computed from, the heads name the units. Part by part,
    so that the table need not fit into memory. An existing file is replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `resonance_spectrum` or any other function of this package.
    path : str or path

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
        write_about(file, {n: v for n, v in dataset.attrs.items() if n != "Conventions"})
        for index, part in enumerate(with_progress(parts_of(dataset), "table")):
            frame = dataset.isel(part).to_dataframe().reset_index()
            heads = [heading(str(n), dataset[n].attrs.get("units", "")) for n in frame.columns]
            frame.to_csv(file, header=heads if index == 0 else False, index=False, na_rep="nan")


def overturned_share(dataset: "xarray.Dataset") -> float:
    """The share of the scenes in a spectrum that overturn under unlimited pulses."""
    margin = dataset.overturning_margin
    parts = with_progress(parts_of(dataset), "overturned")
    return sum(int((margin.isel(part) <= 0).sum()) for part in parts) / margin.size


def parts_of(dataset: "xarray.Dataset", largest: int = 2**18) -> list[dict[Any, slice]]:
    """Parts of at most `largest` points, in the order of the rows."""
    names, sizes = tuple(dataset.sizes), tuple(dataset.sizes.values())
    return [dict(zip(names, at, strict=True)) for at in chunks_of(sizes, largest)]
