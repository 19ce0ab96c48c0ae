"""The identity of a Zarr store: whether it belongs to a dataset, and why not."""

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import dask.array as da
import jax
import numpy as np
import xarray

IDENTITY = "identity"
MADE_BY = "computed_with"
# Format 2 of Zarr: consolidated metadata, from which a dataset opens by one read, belong to
# its conventions, and every reader knows them.
FORMAT = 2


def check_continues(
    path: Path, dataset: xarray.Dataset, arrays: Mapping[str, da.Array], identity: str
) -> None:
    """Raise a `ValueError` that says why, unless the path is a begun store of the dataset."""
    try:
        with xarray.open_zarr(path, zarr_format=FORMAT) as there:
            attributes = there.attrs
            whole = all((path / name).is_dir() for name in arrays)
            if (
                attributes.get(IDENTITY) == identity
                and attributes.get(MADE_BY) == name_versions()
                and whole
            ):
                # The identity says what was written; coordinates and constants may have been
                # lost or overwritten since.
                damaged = [str(n) for n in dataset.variables if str(n) not in arrays]
                damaged = [n for n in damaged if not _is_equal(there, dataset, n)]
                if not damaged:
                    return
                reason = f"is damaged: {', '.join(damaged)} is not what was written"
            else:
                reason = _describe_difference(there, dataset, arrays)
    # What Zarr and xarray raise about a folder, or a file, that holds something else.
    except (OSError, ValueError, KeyError, TypeError):
        reason = "is no Zarr store that write_zarr has begun"
    raise ValueError(f"store: {str(path)!r} {reason}; it is left as it is")


def _is_equal(there: xarray.Dataset, dataset: xarray.Dataset, name: str) -> bool:
    """Return whether a variable of the store equals the one of the dataset in memory."""
    if name not in there.variables:
        return False
    ours = dataset[name].values
    theirs = there[name].values
    return ours.shape == theirs.shape and bool(np.array_equal(ours, theirs))


def _describe_difference(  # noqa: C901
    there: xarray.Dataset, dataset: xarray.Dataset, arrays: Mapping[str, da.Array]
) -> str:
    """Describe the first difference of a store from a dataset, what explains most first."""
    if IDENTITY not in there.attrs:
        return "is no Zarr store that write_zarr has begun"
    for name, made_by in (
        ("source", dataset.attrs.get("source")),
        (MADE_BY, name_versions()),
    ):
        if there.attrs.get(name) != made_by:
            return f"was begun by {there.attrs.get(name)}, and this is {made_by}"
    for name in dataset.coords:
        ours = dataset[name].values
        theirs = there[name].values if name in there else np.empty(0)
        if ours.shape != theirs.shape or not (ours == theirs).all():
            return f"belongs to another grid: its {name} differs"
    for name, array in arrays.items():
        if name not in there or there[name].dtype != array.dtype:
            return f"belongs to another grid: {name} is not the same"
    # The variable with most dimensions has the chunks along all of them.
    most = max(arrays, key=lambda name: arrays[name].ndim)
    if there[most].chunks != arrays[most].chunks:
        begun = _format_lengths(there[most])
        return f"was begun in chunks of {begun}, not {_format_lengths(dataset[most])}"
    for name, value in dataset.attrs.items():
        if isinstance(value, str | int | float) and there.attrs.get(name) != value:
            return (
                f"belongs to another grid: its {name} is {there.attrs.get(name)}, not {value}"
            )
    return "belongs to another grid: its inputs differ"


def _format_lengths(variable: xarray.DataArray) -> str:
    """Write the length of chunks along each dimension."""
    pairs = zip(variable.dims, variable.chunks or (), strict=False)
    return ", ".join(f"{name} {lengths[0]}" for name, lengths in pairs)


def name_versions() -> str:
    """Name the versions that decide about last bits, or about the names of tasks."""
    return f"JAX {jax.__version__}, Dask {version('dask')}, Python {platform.python_version()}"
