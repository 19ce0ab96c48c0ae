"""Grids, computed part by part: in memory, into a file, or lazily."""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import jax
import numpy as np
from jaxtyping import PyTree

from ..host import (
    count_processors,
    defer_interrupts,
    import_optional,
    make_dataset,
    map_in_threads,
    read_version,
    show_progress,
    write_whole,
)
from .axes import GridVariable, describe_axis

if TYPE_CHECKING:
    import netCDF4
    import xarray

    from .lazy import Chunks

Chunk = tuple[slice, ...]
_Tree = TypeVar("_Tree")


# A grid is computed in three ways that must agree: at once in memory, chunk by chunk into a
# file, and lazily, where Dask sends each chunk to a thread, a process or another machine. All
# three call `compute`, which must therefore meet two demands:
#
# - It can be pickled: a function at the top of a module, or a `functools.partial` of one,
#   never a local function. Dask sends it to its workers, and makes the names of tasks from
#   its pickle: equal grids have equal names, by which a store is continued.
# - Its answer for a point has the same bits whatever else is in the chunk. Otherwise numbers
#   would depend on the chunks that somebody chose, and a store that two runs have written
#   would be the answer of neither. That does not come by itself: XLA makes another program for
#   every shape, and not all of these round alike. So points go through programs of few sizes
#   (`apply_in_tiles`: a test shows that these round alike; `apply_padded`: powers of two), and
#   blocks one after the other through the queue of the batch.
@dataclass(frozen=True)
class Grid:
    """A dataset over named axes, before it is computed.

    Attributes
    ----------
    title : str
        Title of the dataset.
    axes : mapping of str to ndarray
        The numbers along each axis: values, or the numbers of things such as records, which
        are in `shared`. An axis that is a single number is no dimension, and becomes a scalar
        coordinate.
    variables : mapping of str to GridVariable
        The variables. Their dimensions are axes in the order of `axes`, and after them
        `columns`; those of axes that are single numbers are left out.
    attributes : mapping
        Attributes of the dataset.
    compute : callable
        Takes the `shared` pytree and the values along each axis in a chunk. Returns an array
        for each variable over the dimensions of that variable. It can be pickled, and returns
        the same bits for a point whatever else is in the chunk.
    largest, usual : int
        The most points that are computed at once, and the most in a chunk of a lazy dataset by
        default.
    labels : mapping
        Attributes of axes that `describe_axis` does not know.
    columns : mapping of str to int
        Sizes of dimensions that are not axes.
    shared : pytree
        Arguments that all points have in common.
    """

    title: str
    axes: Mapping[str, np.ndarray]
    variables: Mapping[str, GridVariable]
    attributes: Mapping[str, object]
    compute: Callable[..., Mapping[str, np.ndarray]]
    largest: int
    usual: int
    labels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    columns: Mapping[str, int] = field(default_factory=dict)
    shared: PyTree = None

    def __post_init__(self) -> None:
        """Leave out the dimensions of axes that are single numbers."""
        numbers = {name for name, values in self.axes.items() if not values.ndim}
        variables = {
            name: variable._replace(dims=tuple(n for n in variable.dims if n not in numbers))
            for name, variable in self.variables.items()
        }
        object.__setattr__(self, "variables", variables)  # of a frozen class

    def build_dataset(
        self, chunks: "Chunks | None" = None, store: str | Path | None = None
    ) -> "xarray.Dataset":
        """Compute the dataset, in memory or in a NetCDF file; with chunks, make it lazy."""
        if chunks is None:
            if store is None:
                return self.label(self.compute_all())
            return self.write_netcdf(store)
        if store is not None:
            raise ValueError(
                "store and chunks exclude each other: a NetCDF file is not written in chunks;"
                " write_zarr writes a lazy dataset"
            )
        lazy = import_optional(f"{__package__}.lazy", "cluster")

        sizes = {name: values.size for name, values in self.axes.items() if values.ndim}
        lengths = lazy.choose_chunks(chunks, sizes, self.usual)

        # What distinguishes a grid beside its numbers: names of tasks follow from it.
        identity = (self.title, dict(self.attributes), read_version())
        compute = functools.partial(_compute_part, self.drop_values())
        arrays = lazy.make_lazy_arrays(
            compute, self.shared, self.axes, lengths, self.variables, self.columns, identity
        )
        return self.label(arrays)

    def drop_values(self) -> "Grid":
        """Return the grid without the values of its axes and its shared part.

        This travels with every task; the values of a chunk come to the task by themselves.
        """
        return replace(self, axes=dict.fromkeys(self.axes, np.empty(0)), shared=None)

    def compute_all(self) -> dict[str, np.ndarray]:
        """Compute all variables in memory."""
        sizes = {name: values.size for name, values in self.axes.items()} | {**self.columns}
        arrays = {
            name: np.empty([sizes[dim] for dim in variable.dims], variable.dtype)
            for name, variable in self.variables.items()
        }
        self.fill(arrays)
        return arrays

    def fill(self, targets: "Mapping[str, np.ndarray | netCDF4.Variable]") -> None:
        """Compute all variables, part by part, into arrays or variables of a file."""
        sizes = {name: values.size for name, values in self.axes.items() if values.ndim}
        places = divide_into_chunks([*sizes.values()], self.largest)
        for place in show_progress(places, self.title.lower()):
            at = dict(zip(sizes, place, strict=True))
            parts = [v[at[n]] if n in at else v for n, v in self.axes.items()]
            answers = self.compute(self.shared, *parts)
            with defer_interrupts():
                for name, target in targets.items():
                    # A variable without some of the axes is written once for each chunk along
                    # these, each time with the same numbers.
                    dims = self.variables[name].dims
                    target[tuple(at.get(dim, slice(None)) for dim in dims)] = answers[name]

    def label(self, arrays: Mapping[str, object]) -> "xarray.Dataset":
        """Make the dataset of arrays of all variables, be they of NumPy or of Dask."""
        entries = {
            name: (variable.dims, arrays[name], variable.attributes)
            for name, variable in self.variables.items()
        }
        return make_dataset(self.title, entries, self.describe_coordinates(), self.attributes)

    def describe_coordinates(
        self,
    ) -> dict[str, tuple[Sequence[str], np.ndarray, Mapping[str, str]]]:
        """Return the coordinates: an array along its dimension, a number without one."""
        return {
            name: ((name,) * values.ndim, values, self.labels.get(name) or describe_axis(name))
            for name, values in self.axes.items()
        }

    def write_netcdf(self, store: str | Path) -> "xarray.Dataset":
        """Compute into a NetCDF file, from which the dataset reads on demand."""
        import netCDF4
        import xarray

        path = Path(store)
        coordinates = self.describe_coordinates()
        scalars = " ".join(name for name, (dims, *_) in coordinates.items() if not dims)
        named = {"coordinates": scalars} if scalars else {}
        # xarray writes the head of the file, and would then want all variables in memory.
        # netCDF4 can fill them part by part. To xarray scalar coordinates are variables like
        # others here, so that what makes them coordinates is written by hand.
        with write_whole("store", path.parent, [path.name], overwrite=True) as scratch:
            bare = make_dataset(self.title, {}, coordinates, self.attributes)
            with defer_interrupts():
                bare.reset_coords().to_netcdf(scratch / path.name)
                file = netCDF4.Dataset(scratch / path.name, "a")
                for name, (dims, dtype, described) in self.variables.items():
                    missing = math.nan if np.dtype(dtype).kind == "f" else None
                    target = file.createVariable(name, dtype, dims, fill_value=missing)
                    target.setncatts({**described, **named})
            with file:
                self.fill({name: file[name] for name in self.variables})
        with defer_interrupts():
            return xarray.open_dataset(path)


def _compute_part(grid: Grid, shared: PyTree, *parts: np.ndarray) -> dict[str, np.ndarray]:
    """Compute all variables of one chunk, which is a grid of its own."""
    axes = dict(zip(grid.axes, parts, strict=True))
    return replace(grid, axes=axes, shared=shared).compute_all()


def list_points(*parts: np.ndarray) -> tuple[tuple[int, ...], np.ndarray]:
    """Return the shape of a part of a grid, and each axis' value at each of its points.

    An axis that is a single number adds no dimension to the shape.
    """
    shape = tuple(part.size for part in parts if part.ndim)
    columns = np.meshgrid(*parts, indexing="ij", copy=False)
    return shape, np.stack(columns).reshape(len(parts), -1)


def apply_in_tiles(
    function: Callable[[int, np.ndarray], _Tree],
    tile: int,
    points: np.ndarray,
    workers: int = 0,
) -> _Tree:
    """Apply an elementwise function to points of shape (arguments, n), n > 0, in tiles.

    XLA makes another program for every shape, and not all of these round alike. In tiles each
    point has the same bits whatever the others are, and one program serves all grids.

    The function takes the number of the tile and its points, and is called by as many threads
    as there are `workers`, by default one for each processor. Returns the pytree that the
    function returns, with NumPy arrays over all points.
    """
    size = points.shape[1]
    numbers = range(-(-size // tile))

    def compute_tile(number: int) -> tuple[slice, _Tree]:
        part = points[:, number * tile : (number + 1) * tile]
        taken = part.shape[1]
        # The last tile is filled with copies of its last point, which is inside of every
        # domain because a point of the grid is.
        if taken < tile:
            part = np.pad(part, ((0, 0), (0, tile - taken)), mode="edge")
        answers = function(number, part)
        return slice(number * tile, number * tile + taken), answers

    # The first tile is computed before the others: only its answer says what arrays there have
    # to be, and the program is compiled once instead of by all threads at the same time.
    at, first = compute_tile(0)
    if len(numbers) == 1:
        return jax.tree.map(lambda leaf: np.asarray(leaf)[at], first)
    whole = jax.tree.map(lambda leaf: np.empty((size, *leaf.shape[1:]), leaf.dtype), first)

    def store(at: slice, answers: _Tree) -> None:
        for target, leaf in zip(jax.tree.leaves(whole), jax.tree.leaves(answers), strict=True):
            target[at] = np.asarray(leaf)[: at.stop - at.start]

    store(at, first)
    # Threads write to parts of the arrays that do not overlap, so that none waits for another.
    map_in_threads(
        lambda number: store(*compute_tile(number)), numbers[1:], workers or count_processors()
    )
    return whole


def apply_padded(function: Callable[[_Tree], object], tree: _Tree) -> np.ndarray:
    """Apply an elementwise function to a pytree of numbers and flat arrays, in NumPy.

    Arrays are padded to the next power of two, from 256 on, so that few shapes are compiled
    whatever the chunks are.
    """
    size = max(np.size(leaf) for leaf in jax.tree.leaves(tree))
    room = max(256, 1 << (size - 1).bit_length())

    # Numbers stay numbers: one value for all points, however many these are.
    def pad(leaf: jax.typing.ArrayLike) -> jax.typing.ArrayLike:
        return (
            np.pad(np.asarray(leaf), (0, room - size), mode="edge") if np.ndim(leaf) else leaf
        )

    answers = np.asarray(function(jax.tree.map(pad, tree)))
    return answers[:size] if answers.ndim else answers


def divide_into_chunks(sizes: Sequence[int], largest: int) -> list[Chunk]:
    """Divide a grid into chunks of at most `largest` points, first along the first axes."""
    # From the last axis on: as long as whole axes fit, a chunk lies in one piece in memory and
    # in the file, whose last axis runs fastest.
    cuts: list[list[slice]] = []
    for size in reversed(sizes):
        length = min(size, max(largest, 1))
        largest //= length
        cuts.insert(0, [slice(k, min(k + length, size)) for k in range(0, size, length)])
    return list(itertools.product(*cuts))
