"""Lazy datasets written to Zarr stores, chunk by chunk, by one run or by several."""

# A store is continued by whoever finds it, perhaps after a run was killed in the middle of a
# write. So all that a run knows of earlier ones is in the folder, and each step leaves a state
# from which the next run can go on:
#
# state    | what is in the folder                       | what `write_zarr` does next
# -------- | ------------------------------------------- | ----------------------------------
# none     | the path does not exist                     | `_begin_store`: coordinates and
#          |                                             | metadata appear at once
# begun    | the attributes `identity`, `computed_with`  | compute all chunks
#          | and `unfinished`; no chunk                  |
# partly   | some chunks, each whole; beside them        | compute the others; a chunk counts
# written  | *.partial, where a writer was killed        | only if all its variables have it
# damaged  | a chunk that does not decode to its size:   | compute it again, in its place
#          | cut, or with a wrong checksum               |
# finished | all chunks; no `unfinished`, no *.partial;  | nothing, if all chunks decode;
#          | consolidated metadata                       | else as if damaged
# foreign  | another identity or version; no store;      | refuse with the reason, and touch
#          | coordinates that are not those written      | nothing (`check_continues`)
#
# A chunk goes from missing to whole in one step, since Zarr renames a file *.partial once it
# is written. Two runs must not meet: `_finish_store` removes files *.partial, also those that
# another run is just writing.

import contextlib
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import dask.array as da
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

from ..host import CannotWrite, Printed, sync, write_whole
from .zarr_store_identity import FORMAT, IDENTITY, MADE_BY, check_continues, name_versions

_UNFINISHED = "unfinished"
Index = tuple[int, ...]
Graph = Any  # a HighLevelGraph: checks of types at run time do not get on with its own hints


@dataclass(frozen=True, repr=False)
class Stored(Printed):
    """A store that has been written; see `write_zarr`.

    Attributes
    ----------
    path : Path
        The store.
    chunks : int
        Number of chunks.
    taken_over : int
        Number of chunks that an earlier run had written.
    """

    path: Path
    chunks: int
    taken_over: int

    def __str__(self) -> str:
        return f"{self.path}: {self.chunks} chunks, {self.taken_over} from an earlier run"


def write_zarr(dataset: xarray.Dataset, path: str | Path) -> Stored:
    """Compute a lazy dataset into a Zarr store, or continue where an earlier run stopped.

    Dask's scheduler computes the chunks: threads, or the workers of the current
    ``distributed.Client``. A chunk counts as written once all of its variables are; each
    variable is written whole or not at all. Until all chunks are written the store has the
    attribute ``unfinished``, and missing chunks read as NaN or 0. A damaged chunk, which
    cannot be decoded or has the wrong size, is computed again.

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
    Stored

    Raises
    ------
    ValueError
        If the dataset is not lazy or its chunks have several lengths; if the existing store
        belongs to another grid, to other chunks or to another version, or is damaged outside
        of its chunks (it is left as it is then); if `path` cannot be written to.

    Examples
    --------
    >>> import tempfile
    >>> import jaxrock as jr
    >>> axes = ([3.0, 5.0, 9.0], 0.8, 0.7, 0.15)
    >>> lazy = jr.resonance_spectrum(*axes, chunks={"slenderness": 2})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for _ in range(2):
    ...         print(jr.grids.write_zarr(lazy, f"{folder}/spectrum.zarr").taken_over)
    0
    2
    """
    path = Path(path)
    arrays = _select_lazy_arrays(dataset)
    if set("#?") & set(str(path)):
        raise ValueError(
            f"store: {str(path)!r} has a # or a ?, which Zarr takes for an address"
        )
    # Names of arrays follow from all that they are computed from, precision included.
    identity = tokenize([(name, array.name, array.chunks) for name, array in arrays.items()])
    if os.path.lexists(path):
        check_continues(path, dataset, arrays, identity)
    else:
        _begin_store(path, dataset, identity)
    try:
        return _write_missing_chunks(path, dataset, arrays)
    # Such as a disk that is full. The chunks that are written stay, for the next run.
    except OSError as error:
        raise CannotWrite("store", path, error) from error


def _write_missing_chunks(
    path: Path, dataset: xarray.Dataset, arrays: Mapping[str, da.Array]
) -> Stored:
    """Compute and write the chunks that are missing or damaged."""
    chunks = 0
    taken_over = 0
    # Variables that are made of others, as the curves of a suite are, come after these and
    # read them from the store. Otherwise a curve that is missing would have all responses
    # computed again.
    first = {
        name: array for name, array in arrays.items() if not _depends_on_others(array, arrays)
    }
    later = {name: array for name, array in arrays.items() if name not in first}
    for stage, before in ((first, {}), (later, first)):
        graphs = list[HighLevelGraph]()
        keys = list[tuple[str | int, ...]]()
        # Variables with the same dimensions have the same chunks, which one task computes and
        # writes. So they are one group, and a chunk is there if all of them have it.
        for dims in dict.fromkeys(dataset[name].dims for name in stage):
            group = {name: a for name, a in stage.items() if dataset[name].dims == dims}
            written = _make_writing_tasks(path, group)
            there = set.intersection(*(_list_whole_chunks(path, name) for name in group))
            missing = [key for key in np.ndindex(*written.numblocks) if key not in there]
            graphs.append(_replace_by_reads(written.__dask_graph__(), path, before))
            keys += [(written.name, *key) for key in missing]
            count = math.prod(written.numblocks)
            chunks += count
            taken_over += count - len(missing)
        if keys:
            _run_graph(HighLevelGraph.merge(*graphs), keys)
    _finish_store(path, arrays)
    return Stored(path, chunks, taken_over)


def _select_lazy_arrays(dataset: xarray.Dataset) -> dict[str, da.Array]:
    """Select the variables that are Dask arrays, and check their chunks."""
    arrays = {
        str(n): v.data for n, v in dataset.data_vars.items() if isinstance(v.data, da.Array)
    }
    if not arrays:
        raise ValueError(
            "dataset must be lazy, of Dask arrays; its to_zarr writes one in memory"
        )
    for name, array in arrays.items():
        # Zarr knows one length of chunks along a dimension, after which it names their files.
        for dim, lengths in zip(dataset[name].dims, array.chunks, strict=True):
            if len(set(lengths[:-1])) > 1 or lengths[-1] > lengths[0]:
                raise ValueError(
                    f"chunks along {dim} must have one length, the last may be shorter,"
                    f" got {lengths!r:.60}"
                )
    return arrays


def _depends_on_others(array: da.Array, arrays: Mapping[str, da.Array]) -> bool:
    """Return whether an array is computed from others of these."""
    # Walks through the layers from the array's own down, each once.
    other_names = {other.name for other in arrays.values()} - {array.name}
    dependencies = array.dask.dependencies
    seen = set[str]()
    left = [array.name]
    while left:
        if (layer := left.pop()) not in seen:
            seen.add(layer)
            left += dependencies.get(layer, ())
    return bool(seen & other_names)


def _begin_store(path: Path, dataset: xarray.Dataset, identity: str) -> None:
    """Begin a store: write everything but the lazy arrays, whole or not at all."""
    about = {
        IDENTITY: identity,
        MADE_BY: name_versions(),
        _UNFINISHED: "chunks are missing",
    }
    # It refuses a path that another run has begun since `write_zarr` looked.
    with write_whole("store", path.parent, [path.name], overwrite=False) as scratch:
        target = scratch / path.name
        named = dataset.assign_attrs(about)
        # With a checksum, by which a chunk that is cut or has lost a bit is told.
        codec = {"compressors": [numcodecs.Zstd(level=1, checksum=True)]}
        encoding = {name: codec for name in named.variables}
        named.to_zarr(target, mode="w-", compute=False, zarr_format=FORMAT, encoding=encoding)


def _list_present_chunks(path: Path, name: str) -> set[Index]:
    """List the chunks of a variable by the names of their files, which are their indices."""
    with os.scandir(path / name) as entries:
        words = (entry.name.split(".") for entry in entries)
        return {
            tuple(map(int, word)) for word in words if all(part.isdigit() for part in word)
        }


def _list_whole_chunks(path: Path, name: str) -> set[Index]:
    """List the chunks of a variable that are there and decode to their size."""
    array = _open_array(path, name, "r")
    whole = set()
    for index in _list_present_chunks(path, name):
        place = path / name / ".".join(map(str, index))
        # Something else of this name could not be replaced by a chunk.
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


def _make_writing_tasks(path: Path, group: Mapping[str, da.Array]) -> da.Array:
    """Make a lazy array that writes chunks: its block is 1 once the chunk is on the disk.

    So the answers of tasks weigh a byte, and Dask lets go of a chunk as soon as it is written.
    """
    arrays = list(group.values())
    return da.map_blocks(
        _write_chunk,
        *arrays,
        path=os.path.abspath(path),
        names=tuple(group),
        lengths=tuple(lengths[0] for lengths in arrays[0].chunks),
        name=f"write-{tokenize(os.path.abspath(path), [array.name for array in arrays])}",
        dtype=np.int8,
        chunks=tuple((1,) * count for count in arrays[0].numblocks),
        meta=np.empty((0,) * arrays[0].ndim, np.int8),
    )


def _write_chunk(
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
        target = _open_array(path, name, "r+")
        # Otherwise a chunk that is NaN throughout would be left out, and never seem written.
        target.with_config({"write_empty_chunks": True})[region] = part
        # Zarr renames a file that it has written. Without this a machine that loses its power
        # could keep the name and lose the content.
        sync(Path(path, name, ".".join(map(str, block_id))))
    return np.ones((1,) * len(block_id), np.int8)


def _read_chunk(path: str, name: str, region: tuple[slice, ...]) -> np.ndarray:
    """Read one chunk of a variable from the store."""
    return _open_array(path, name, "r")[region]


def _open_array(path: str | Path, name: str, mode: Literal["r", "r+"]) -> Any:
    """Open a variable of the store."""
    # Zarr says that this may be one of several kinds of arrays, of which some have no blocks.
    return zarr.open_array(f"{path}/{name}", mode=mode, zarr_format=FORMAT)


def _replace_by_reads(graph: Graph, path: Path, stored: Mapping[str, da.Array]) -> Graph:
    """Make a graph in which some arrays are read from the store instead of computed."""
    layers = dict(graph.layers)
    dependencies = dict(graph.dependencies)
    for name, array in stored.items():
        if array.name in layers:
            places = zip(np.ndindex(*array.numblocks), _iterate_regions(array), strict=True)
            tasks = {
                (array.name, *k): (_read_chunk, os.path.abspath(path), name, r)
                for k, r in places
            }
            # Under the same keys: the layers above do not notice, and those below, on which
            # nothing depends any more, are dropped when the graph is optimized.
            layers[array.name] = MaterializedLayer(tasks)
            dependencies[array.name] = set()
    return HighLevelGraph(layers, dependencies)


def _iterate_regions(array: da.Array) -> Iterator[tuple[slice, ...]]:
    """Iterate over the places of the chunks of an array, in the order of `np.ndindex`."""
    return iter(slices_from_chunks(array.chunks))


def _run_graph(graph: Graph, keys: Sequence[tuple[str | int, ...]]) -> None:
    """Compute some keys of a graph, with Dask's own progress on a terminal."""
    # By keys instead of `array.compute()`: the missing chunks are some of an array, and those
    # of several arrays go to the scheduler together, which computes common tasks once.
    get: Any = get_scheduler(cls=da.Array)
    optimized = da.Array.__dask_optimize__(graph, list(keys))
    shows = sys.stderr.isatty()
    # With a current client `get` is its bound method. Its progress is shown by other means.
    client = getattr(get, "__self__", None)
    if not isinstance(client, Client):
        with ProgressBar(out=sys.stderr, minimum=2) if shows else contextlib.nullcontext():
            get(optimized, list(keys))
        return
    futures = client.get(optimized, list(keys), sync=False)
    if shows:
        # Standard output is for results, which others may read from a pipe.
        with contextlib.redirect_stdout(sys.stderr):
            progress(futures, notebook=False)
    client.gather(futures)


def _finish_store(path: Path, arrays: Mapping[str, da.Array]) -> None:
    """Mark the store as whole, and remove the files that killed writers have left."""
    group = zarr.open_group(path, mode="r+", zarr_format=FORMAT)
    if _UNFINISHED not in group.attrs:
        return
    # Tasks have succeeded, but perhaps on machines on which the path is another disk.
    for name, array in arrays.items():
        missing = {*np.ndindex(*array.numblocks)} - _list_present_chunks(path, name)
        if missing:
            raise ValueError(
                f"store: {str(path)!r}: {len(missing)} chunks of {name} are not there;"
                " do all workers write to it?"
            )
    for name in arrays:
        for left in (path / name).glob("*.partial"):
            left.unlink(missing_ok=True)
    # Last, so that a run that is killed before leaves a store that says it is unfinished.
    del group.attrs[_UNFINISHED]
    zarr.consolidate_metadata(group.store, zarr_format=FORMAT)
