"""Lazy datasets written to Zarr stores, region by region, by one run or by several."""

import contextlib
import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..host import import_optional, write_whole
from ..validation import check_kind

if TYPE_CHECKING:
    import xarray

_TOKEN = "token"  # attribute of a store that identifies the computation
_WRITTEN = "written"  # variable of a store: 1 for each region that is there
# Every reader knows format 2, and its conventions include consolidated metadata.
_FORMAT = 2


def write_zarr(dataset: "xarray.Dataset", path: str | Path) -> "xarray.Dataset":
    """Compute a lazy dataset into a Zarr store, or continue where an earlier run stopped.

    Dask's scheduler computes the chunks: threads, or the workers of the current
    ``distributed.Client``. The store has one more variable, ``written``, which is 1 for each
    chunk that is there, in their order; others read as NaN or 0.

    Parameters
    ----------
    dataset : xarray.Dataset
        From a function of jaxrock with ``chunks``. Along each dimension all chunks have one
        length, except the last one, which may be shorter.
    path : str or path
        A folder that all workers reach by this path. An existing store is continued; only one
        run at a time may write to it.

    Returns
    -------
    xarray.Dataset
        The dataset as it reads from the store, lazily.

    Raises
    ------
    ValueError
        If the dataset is not lazy or its chunks have several lengths; if `path` cannot be
        written to or has something else, such as a store of another grid, of other chunks or
        of another version (it is left as it is then).

    Examples
    --------
    >>> import tempfile
    >>> import jaxrock as jr
    >>> axes = ([3.0, 5.0, 9.0], 0.8, 0.7, 0.15)
    >>> lazy = jr.resonance_spectrum(*axes, chunks={"slenderness": 2})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     stored = jr.grids.write_zarr(lazy, f"{folder}/spectrum.zarr")
    ...     print(stored.stabilized_period.values.round(2))
    [0.63 1.1  2.19]
    """
    import xarray

    dask = import_optional("dask", "cluster")
    check_kind("dataset", dataset, xarray.Dataset, hint="; functions with chunks give one")
    if not dataset.chunks:
        raise ValueError("dataset must be lazy; its to_zarr writes one in memory")
    path = Path(path).absolute()
    # Dask's name for all numbers, which follows from parameters, axes, chunks, precision and
    # the version of jaxrock.
    token = dask.base.tokenize(dataset)
    cuts = []
    for lengths in dataset.chunks.values():
        edges = np.cumsum([0, *lengths]).tolist()
        cuts.append(list(map(slice, edges[:-1], edges[1:])))
    regions = [
        dict(zip(dataset.chunks, slices, strict=True)) for slices in itertools.product(*cuts)
    ]
    if not path.exists():
        _begin_store(dataset, path, token, len(regions))
    written = None
    # Errors of Zarr and xarray for a folder or file that is no store.
    failures = (OSError, ValueError, KeyError, TypeError)
    with contextlib.suppress(*failures), xarray.open_zarr(path) as store:
        if store.attrs[_TOKEN] == token:
            written = store[_WRITTEN].values
    if written is None:
        raise ValueError(
            f"store: {str(path)!r} is not of this grid, these chunks and this version of"
            " jaxrock; it is left as it is"
        )
    write = dask.delayed(_write_region)
    tasks = [
        write(dataset.isel(region), path, region, number)
        for number, region in enumerate(regions)
        if not written[number]
    ]
    dask.compute(*tasks)
    return xarray.open_zarr(path).drop_vars(_WRITTEN)


def _begin_store(dataset: "xarray.Dataset", path: Path, token: str, number: int) -> None:
    """Begin a store of a number of regions: everything but the values, whole or not at all."""
    import dask.array

    flags = dask.array.zeros(number, dtype=np.int8, chunks=1)
    described = {"long_name": "1 if this chunk has been written", "units": "1"}
    # A variable without dimensions has no regions: it is computed here.
    begun = dataset.map(lambda v: v if v.dims else v.compute(), keep_attrs=True)
    begun = begun.assign({_WRITTEN: ("chunk", flags, described)}).assign_attrs({_TOKEN: token})
    with write_whole("store", path.parent, [path.name], overwrite=False) as scratch:
        begun.to_zarr(scratch / path.name, compute=False, zarr_format=_FORMAT)


def _write_region(
    part: "xarray.Dataset", path: Path, region: dict[str, slice], number: int
) -> None:
    """Write one region, then its flag.

    A run that is killed in between leaves a region without a flag, perhaps half written: the
    next run computes it again.
    """
    import xarray

    names = [name for name, variable in part.data_vars.items() if variable.dims]
    part[names].drop_vars(part.coords).to_zarr(path, region=region, zarr_format=_FORMAT)
    flag = xarray.Dataset({_WRITTEN: ("chunk", np.ones(1, np.int8))})
    flag.to_zarr(path, region={"chunk": slice(number, number + 1)}, zarr_format=_FORMAT)
