"""Lazy datasets written to Zarr stores, chunk by chunk; what is written is not computed again."""

import contextlib
import math
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import dask.array as da
import jax
import numcodecs
import numpy as np
import xarray
import zarr
from dask.array.core import slices_from_chunks
from dask.base import get_scheduler
from dask.diagnostics.progress import ProgressBar
from dask.highlevelgraph import HighLevelGraph, MaterializedLayer
from dask.tokenize import tokenize
from distributed import Client, progress

from ..host import CannotWrite, Printed, sync, written_whole

_IDENTITY = "identity"
_UNFINISHED = "unfinished"
_MADE_BY = "computed_with"
_FORMAT = 2  # of Zarr: the one whose metadata of a whole dataset every reader knows
Index = tuple[int, ...]


@dataclass(frozen=True, repr=False)
class Stored(Printed):
    """What was written; see `write_zarr`.

    Attributes
    ----------
    path : Path
        The store.
    chunks : int
        How many there are.
    taken_over : int
        How many of them an earlier run had written.
    """

    path: Path
    chunks: int
    taken_over: int

    def __str__(self) -> str:
        return f"{self.path}: {self.chunks} chunks, {self.taken_over} of them taken over"


def write_zarr(dataset: xarray.Dataset, path: str | Path) -> Stored:
    """Compute a lazy dataset into a Zarr store, or go on where an earlier run stopped.

    By the scheduler that Dask would take: threads, or the workers of the current
    ``distributed.Client``. A chunk counts as written once all of its variables are, each of
    which appears whole or not at all. Until all are there the store has the attribute
    ``unfinished``, and what is missing reads as NaN or 0. A chunk that is there but cannot be
    decoded, or not to its size, is computed again.

    Parameters
    ----------
    dataset : xarray.Dataset
        From a function of jaxrock with ``chunks``; along each dimension these have one length,
        and the last may be shorter.
    path : str or path
        A folder, which all workers reach by this path. One that exists is continued, by one
        run at a time.

    Returns
    -------
    Stored

    Raises
    ------
    ValueError
        If the dataset is not lazy or its chunks have several lengths; if what exists belongs
        to another grid, to other chunks or to another version, or is damaged beside its
        chunks, in which case it stays untouched; if nothing can be written there.

    Examples
    --------
    >>> import tempfile
    >>> import jaxrock as jr
    >>> lazy = jr.resonance_spectrum([3.0, 5.0, 9.0], 0.8, 0.7, 0.15, chunks={"slenderness": 2})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for _ in range(2):
    ...         print(jr.grids.write_zarr(lazy, f"{folder}/spectrum.zarr").taken_over)
    0
    2
    """
    path = Path(path)
    arrays = _lazy_arrays(dataset)
    if set("#?") & set(str(path)):
        raise ValueError(
            f"store: {str(path)!r} has a # or a ?, which Zarr takes for an address"
        )
    identity = tokenize([(name, array.name, array.chunks) for name, array in arrays.items()])
    if os.path.lexists(path):
        _check_same(path, dataset, arrays, identity)
    else:
        _begin(path, dataset, identity)
    try:
        return _filled(path, dataset, arrays)
    except OSError as error:  # such as a disk that is full; what is written stays
        raise CannotWrite("store", path, error) from error


def _filled(path: Path, dataset: xarray.Dataset, arrays: Mapping[str, da.Array]) -> Stored:
    """Compute and write the chunks that are not there."""
    chunks = taken_over = 0
    # What is made of other variables comes after them, from what is stored.
    first = {name: array for name, array in arrays.items() if not _depends(array, arrays)}
    later = {name: array for name, array in arrays.items() if name not in first}
    for stage, before in ((first, {}), (later, first)):
        graphs = list[Any]()
        keys = list[Any]()
        for dims in dict.fromkeys(dataset[name].dims for name in stage):
            group = {name: a for name, a in stage.items() if dataset[name].dims == dims}
            written = _written(path, group)
            there = set.intersection(*(_whole_chunks(path, name) for name in group))
            missing = [key for key in np.ndindex(*written.numblocks) if key not in there]
            graphs.append(_with_stored(written.__dask_graph__(), path, before))
            keys += [(written.name, *key) for key in missing]
            count = math.prod(written.numblocks)
            chunks += count
            taken_over += count - len(missing)
        if keys:
            _run(HighLevelGraph.merge(*graphs), keys)
    _finish(path, arrays)
    return Stored(path, chunks, taken_over)


def _lazy_arrays(dataset: xarray.Dataset) -> dict[str, da.Array]:
    """Return the variables that are Dask arrays, and check their chunks."""
    arrays = {
        str(n): v.data for n, v in dataset.data_vars.items() if isinstance(v.data, da.Array)
    }
    if not arrays:
        raise ValueError(
            "dataset must be lazy, of Dask arrays; its to_zarr writes one in memory"
        )
    for name, array in arrays.items():
        for dim, lengths in zip(dataset[name].dims, array.chunks, strict=True):
            if len(set(lengths[:-1])) > 1 or lengths[-1] > lengths[0]:
                must = "must have one length, the last may be shorter"
                raise ValueError(f"chunks along {dim} {must}, got {lengths!r:.60}")
    return arrays


def _depends(array: da.Array, arrays: Mapping[str, da.Array]) -> bool:
    """Tell whether an array is made of others of these."""
    others = {other.name for other in arrays.values()} - {array.name}
    dependencies = array.dask.dependencies
    seen = set[str]()
    left = [array.name]
    while left:
        if (layer := left.pop()) not in seen:
            seen.add(layer)
            left += dependencies.get(layer, ())
    return bool(seen & others)


def _begin(path: Path, dataset: xarray.Dataset, identity: str) -> None:
    """Begin a store with everything but the lazy arrays."""
    about = {_IDENTITY: identity, _MADE_BY: _versions(), _UNFINISHED: "chunks are missing"}
    try:
        with written_whole("store", path.parent, [path.name], overwrite=False) as scratch:
            target = scratch / path.name
            named = dataset.assign_attrs(about)
            # With a checksum, by which a chunk that is cut or has lost a bit is told.
            codec = {"compressors": [numcodecs.Zstd(level=1, checksum=True)]}
            encoding = {name: codec for name in named.variables}
            named.to_zarr(
                target, mode="w-", compute=False, zarr_format=_FORMAT, encoding=encoding
            )
    except ValueError as error:
        if not path.is_dir():
            raise
        raise ValueError(f"store: {str(path)!r} has just been begun by another run") from error


def _versions() -> str:
    return f"JAX {jax.__version__}, Dask {version('dask')}, Python {platform.python_version()}"


def _check_same(
    path: Path, dataset: xarray.Dataset, arrays: Mapping[str, da.Array], identity: str
) -> None:
    """Raise `ValueError`, which says why, if what is there is not the begun store of a dataset."""
    try:
        with xarray.open_zarr(path, zarr_format=_FORMAT) as there:
            found = there.attrs
            whole = all((path / name).is_dir() for name in arrays)
            if (
                found.get(_IDENTITY) == identity
                and found.get(_MADE_BY) == _versions()
                and whole
            ):
                damaged = [str(n) for n in dataset.variables if str(n) not in arrays]
                damaged = [n for n in damaged if not _equal(there, dataset, n)]
                if not damaged:
                    return
                reason = f"is damaged: {', '.join(damaged)} is not what was written"
            else:
                reason = _difference(there, dataset, arrays)
    except (OSError, ValueError, KeyError, TypeError):
        reason = "is no Zarr store that write_zarr has begun"
    raise ValueError(f"store: {str(path)!r} {reason}; it is left as it is")


def _equal(there: xarray.Dataset, dataset: xarray.Dataset, name: str) -> bool:
    """Compare a variable of the store with that of the dataset, which is in memory."""
    if name not in there.variables:
        return False
    ours = dataset[name].values
    theirs = there[name].values
    return ours.shape == theirs.shape and bool(np.array_equal(ours, theirs))


def _difference(
    there: xarray.Dataset, dataset: xarray.Dataset, arrays: Mapping[str, da.Array]
) -> str:
    """Say in what a store differs from a dataset."""
    if _IDENTITY not in there.attrs:
        return "is no Zarr store that write_zarr has begun"
    for name, made_by in (("source", dataset.attrs.get("source")), (_MADE_BY, _versions())):
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
    most = max(arrays, key=lambda name: arrays[name].ndim)
    if there[most].chunks != arrays[most].chunks:
        return f"was begun in chunks of {_lengths(there[most])}, not {_lengths(dataset[most])}"
    for name, value in dataset.attrs.items():
        if isinstance(value, str | int | float) and there.attrs.get(name) != value:
            return (
                f"belongs to another grid: its {name} is {there.attrs.get(name)}, not {value}"
            )
    return "belongs to another grid: what it was computed from differs"


def _lengths(variable: xarray.DataArray) -> str:
    pairs = zip(variable.dims, variable.chunks or (), strict=False)
    return ", ".join(f"{name} {lengths[0]}" for name, lengths in pairs)


def _present(path: Path, name: str) -> set[Index]:
    """List the chunks of a variable that are there."""
    with os.scandir(path / name) as entries:
        words = (entry.name.split(".") for entry in entries)
        return {
            tuple(map(int, word)) for word in words if all(part.isdigit() for part in word)
        }


def _whole_chunks(path: Path, name: str) -> set[Index]:
    """List the chunks of a variable that are there, and that decode to their size."""
    array: Any = zarr.open_array(f"{path}/{name}", mode="r", zarr_format=_FORMAT)
    whole = set()
    for index in _present(path, name):
        place = path / name / ".".join(map(str, index))
        if not place.is_file():
            raise ValueError(
                f"store: {str(place)!r} is in the place of a chunk, and is no file"
            )
        try:
            array.blocks[index]
        except (RuntimeError, ValueError, TypeError, OSError):  # of the codec
            continue
        whole.add(index)
    return whole


def _written(path: Path, group: Mapping[str, da.Array]) -> da.Array:
    """Make a lazy array of ones, one for each chunk, which is written before."""
    arrays = list(group.values())
    return da.map_blocks(
        _write,
        *arrays,
        path=os.path.abspath(path),
        names=tuple(group),
        lengths=tuple(lengths[0] for lengths in arrays[0].chunks),
        name=f"write-{tokenize(os.path.abspath(path), [array.name for array in arrays])}",
        dtype=np.int8,
        chunks=tuple((1,) * count for count in arrays[0].numblocks),
        meta=np.empty((0,) * arrays[0].ndim, np.int8),
    )


def _write(
    *parts: np.ndarray,
    path: str,
    names: Sequence[str],
    lengths: Sequence[int],
    block_id: Index,
) -> np.ndarray:
    """Write one chunk of some variables, each whole or not at all."""
    starts = [number * length for number, length in zip(block_id, lengths, strict=True)]
    region = tuple(slice(s, s + n) for s, n in zip(starts, parts[0].shape, strict=True))
    for name, part in zip(names, parts, strict=True):
        target: Any = zarr.open_array(f"{path}/{name}", mode="r+", zarr_format=_FORMAT)
        # Otherwise a chunk that is NaN throughout would be left out, and never seem written.
        target.with_config({"write_empty_chunks": True})[region] = part
        sync(Path(path, name, ".".join(map(str, block_id))))
    return np.ones((1,) * len(block_id), np.int8)


def _read(path: str, name: str, region: tuple[slice, ...]) -> np.ndarray:
    target: Any = zarr.open_array(f"{path}/{name}", mode="r", zarr_format=_FORMAT)
    return target[region]


def _with_stored(graph: Any, path: Path, stored: Mapping[str, da.Array]) -> Any:
    """Make a graph in which some arrays are read from the store, instead of computed."""
    layers = dict(graph.layers)
    dependencies = dict(graph.dependencies)
    for name, array in stored.items():
        if array.name in layers:
            places = zip(np.ndindex(*array.numblocks), _regions(array), strict=True)
            tasks = {
                (array.name, *k): (_read, os.path.abspath(path), name, r) for k, r in places
            }
            layers[array.name] = MaterializedLayer(tasks)
            dependencies[array.name] = set()
    return HighLevelGraph(layers, dependencies)


def _regions(array: da.Array) -> Iterator[tuple[slice, ...]]:
    return iter(slices_from_chunks(array.chunks))


def _run(graph: Any, keys: Sequence[Any]) -> None:
    """Compute some keys of a graph, with Dask's own progress on a terminal."""
    get = get_scheduler(cls=da.Array)
    optimized = da.Array.__dask_optimize__(graph, list(keys))
    shows = sys.stderr.isatty()
    client = getattr(get, "__self__", None)
    if not isinstance(client, Client):
        with ProgressBar(out=sys.stderr, minimum=2) if shows else contextlib.nullcontext():
            get(optimized, list(keys))
        return
    futures = client.get(optimized, list(keys), sync=False)
    if shows:
        with contextlib.redirect_stdout(sys.stderr):  # not among what is printed as a result
            progress(futures, notebook=False)
    client.gather(futures)


def _finish(path: Path, arrays: Mapping[str, da.Array]) -> None:
    """Say that the store is whole, and remove what killed writers have left."""
    group = zarr.open_group(path, mode="r+", zarr_format=_FORMAT)
    if _UNFINISHED not in group.attrs:
        return
    for name, array in arrays.items():
        missing = {*np.ndindex(*array.numblocks)} - _present(path, name)
        if missing:
            said = (
                f"{len(missing)} chunks of {name} are not there; do all workers write to it?"
            )
            raise ValueError(f"store: {str(path)!r}: {said}")
    for name in arrays:
        for left in (path / name).glob("*.partial"):
            left.unlink(missing_ok=True)
    del group.attrs[_UNFINISHED]
    zarr.consolidate_metadata(group.store, zarr_format=_FORMAT)
