"""Grids, computed part by part: in memory, into a file, or lazily."""

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..host import (
    count_processors,
    defer_interrupts,
    import_optional,
    make_dataset,
    map_in_threads,
    show_progress,
    write_whole,
)
from .axes import Chunks, GridVariable, describe_axis

if TYPE_CHECKING:
    import netCDF4
    import xarray

_Array = TypeVar("_Array")
_Tree = TypeVar("_Tree")


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
        `columns`; axes that are single numbers are left out.
    attributes : mapping
        Attributes of the dataset.
    compute : callable
        Takes the `shared` pytree and the values along each axis in a chunk. Returns an array
        for each variable over the dimensions of that variable. Dask sends it to its workers:
        it is a function at the top of a module, or a `functools.partial` of one.
    largest : int
        The most points that are computed at once, and by default in a chunk of a lazy dataset.
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
    columns: Mapping[str, int] = field(default_factory=dict)
    shared: PyTree = None

    def __post_init__(self) -> None:
        """Leave out the dimensions of axes that are single numbers."""
        numbers = {name for name, values in self.axes.items() if not values.ndim}
        variables = {
            name: variable._replace(dims=tuple(n for n in variable.dims if n not in numbers))
            for name, variable in self.variables.items()
        }
        object.__setattr__(self, "variables", variables)  # since the class is frozen

    def build_dataset(
        self, chunks: Chunks | None = None, store: str | Path | None = None
    ) -> "xarray.Dataset":
        """Compute the dataset, in memory or in a NetCDF file; with chunks, make it lazy."""
        if chunks is not None and store is not None:
            raise ValueError(
                "store and chunks exclude each other: a NetCDF file is not written in chunks;"
                " write_zarr writes a lazy dataset"
            )
        if chunks is not None:
            return self.make_lazy(chunks)
        if store is not None:
            return self.write_netcdf(Path(store))
        return self.compute_all()

    def compute_all(self) -> "xarray.Dataset":
        """Compute all variables in memory."""
        arrays = self.make_arrays(np.empty)
        self.fill(arrays)
        return self.label(arrays)

    def make_arrays(self, make: Callable[..., _Array], **options: object) -> dict[str, _Array]:
        """Make an array for each variable by a function of shape and type, such as `np.empty`."""
        sizes = {name: values.size for name, values in self.axes.items()} | {**self.columns}
        return {
            name: make([sizes[dim] for dim in dims], dtype=dtype, **options)
            for name, (dims, dtype, _) in self.variables.items()
        }

    def fill(self, targets: "Mapping[str, np.ndarray | netCDF4.Variable]") -> None:
        """Compute all variables, part by part, into arrays or variables of a file."""
        sizes = {name: values.size for name, values in self.axes.items() if values.ndim}
        for region in show_progress(divide(sizes, self.largest), self.title.lower()):
            coordinates = [v[region[n]] if n in region else v for n, v in self.axes.items()]
            answers = self.compute(self.shared, *coordinates)
            with defer_interrupts():
                for name, target in targets.items():
                    # A variable without some of the axes is written once for each part along
                    # these, each time with the same numbers.
                    dims = self.variables[name].dims
                    target[tuple(region.get(dim, slice(None)) for dim in dims)] = answers[name]

    def label(self, arrays: Mapping[str, object]) -> "xarray.Dataset":
        """Make the dataset of arrays of some variables, by NumPy or Dask."""
        entries = {
            name: (self.variables[name].dims, array, self.variables[name].attributes)
            for name, array in arrays.items()
        }
        # A coordinate is an array along its dimension, or a number without one.
        coordinates = {
            name: ((name,) * values.ndim, values, describe_axis(name))
            for name, values in self.axes.items()
        }
        return make_dataset(self.title, entries, coordinates, self.attributes)

    def write_netcdf(self, path: Path) -> "xarray.Dataset":
        """Compute into a NetCDF file, from which the dataset reads on demand."""
        import netCDF4
        import xarray

        scalars = " ".join(name for name, values in self.axes.items() if not values.ndim)
        named = {"coordinates": scalars} if scalars else {}
        # xarray writes the head of the file; for the variables it would need all of them in
        # memory, while netCDF4 can fill them part by part. The head has scalar coordinates as
        # plain variables, so that the attribute that makes them coordinates is written here.
        with write_whole("store", path.parent, [path.name], overwrite=True) as scratch:
            with defer_interrupts():
                self.label({}).reset_coords().to_netcdf(scratch / path.name)
                file = netCDF4.Dataset(scratch / path.name, "a")
                for name, (dims, dtype, described) in self.variables.items():
                    missing = math.nan if np.dtype(dtype).kind == "f" else None
                    target = file.createVariable(name, dtype, dims, fill_value=missing)
                    target.setncatts({**described, **named})
            with file:
                self.fill({name: file[name] for name in self.variables})
        with defer_interrupts():
            return xarray.open_dataset(path)

    def make_lazy(self, chunks: Chunks) -> "xarray.Dataset":
        """Make the dataset of Dask arrays, with a task for each chunk; compute nothing."""
        array = import_optional("dask.array", "cluster")
        import xarray

        sizes = {name: values.size for name, values in self.axes.items() if values.ndim}
        lengths: Any = choose_lengths(sizes, self.largest) if chunks == "auto" else chunks
        if isinstance(lengths, str):
            raise ValueError(
                'chunks must be "auto" or lengths by dimension, such as'
                f" {{{next(iter(sizes))!r}: 50}}, got {chunks!r:.60}"
            )
        template = self.label(self.make_arrays(array.empty, chunks=-1)).chunk(lengths)
        # `map_blocks` divides coordinates along with variables: so each axis has a variable. A
        # single point has none, and is computed at once.
        indices = {f"index of {name}": (name, np.arange(size)) for name, size in sizes.items()}
        blocks = template.coords.to_dataset().assign(indices).chunk(lengths)
        # The grid is sent with every task, without values, which come with the chunk. Arrays
        # are sent as NumPy arrays: in a process of single precision, a JAX array would have
        # lost half of its digits before `enable_x64` is called.
        shared = jax.tree.map(
            lambda leaf: np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf, self.shared
        )
        bare = replace(self, axes=dict.fromkeys(self.axes, np.empty(0)), shared=shared)
        options = {"grid": bare, "double": jax.config.jax_enable_x64}
        lazy = xarray.map_blocks(_compute_block, blocks, kwargs=options, template=template)
        # Otherwise scalar coordinates would be lazy, too.
        return lazy.assign_coords(template.coords)


def _compute_block(block: "xarray.Dataset", grid: Grid, double: bool) -> "xarray.Dataset":
    """Compute one chunk, in whatever thread or process this is."""
    with jax.enable_x64(double):
        shared = jax.tree.map(
            lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf,
            grid.shared,
        )
        axes = {name: block[name].values for name in grid.axes}
        return replace(grid, axes=axes, shared=shared).compute_all()


def list_points(*axes: np.ndarray) -> tuple[tuple[int, ...], np.ndarray]:
    """Return the shape of a part of a grid, and each axis' value at each of its points.

    An axis that is a single number adds no dimension to the shape.
    """
    shape = tuple(values.size for values in axes if values.ndim)
    columns = np.meshgrid(*axes, indexing="ij", copy=False)
    return shape, np.stack(columns).reshape(len(axes), -1)


def apply_in_tiles(
    function: Callable[[int, np.ndarray], _Tree],
    tile: int,
    points: np.ndarray,
    workers: int = 0,
) -> _Tree:
    """Apply an elementwise function to points of shape (arguments, n), n > 0, in tiles.

    The function takes the number of the tile and its points. One program serves all grids,
    since the last tile is filled with copies of its last point, which is inside of every
    domain. The function is called by `workers` threads, by default one for each processor. The
    result is the pytree of the function, with NumPy arrays over all points.
    """
    size = points.shape[1]
    numbers = range(-(-size // tile))

    def compute_tile(number: int) -> _Tree:
        part = points[:, number * tile : (number + 1) * tile]
        filled = np.pad(part, ((0, 0), (0, tile - part.shape[1])), mode="edge")
        return jax.device_get(function(number, filled))

    # The first tile goes before the others, so that the program is compiled once and not by
    # all threads at the same time.
    first = compute_tile(0)
    following = map_in_threads(compute_tile, numbers[1:], workers or count_processors())
    return jax.tree.map(lambda *tiles: np.concatenate(tiles)[:size], first, *following)


def apply_padded(function: Callable[[_Tree], object], tree: _Tree) -> np.ndarray:
    """Apply an elementwise function to a pytree of numbers and flat arrays, in NumPy.

    Arrays are padded to the next power of two, from 256 on, so that few shapes are compiled
    whatever the chunks are.
    """
    size = max(np.size(leaf) for leaf in jax.tree.leaves(tree))
    room = max(256, 1 << (size - 1).bit_length())

    # Numbers stay numbers, one value for all points.
    def pad(leaf: jax.typing.ArrayLike) -> jax.typing.ArrayLike:
        return (
            np.pad(np.asarray(leaf), (0, room - size), mode="edge") if np.ndim(leaf) else leaf
        )

    answers = np.asarray(function(jax.tree.map(pad, tree)))
    return answers[:size] if answers.ndim else answers


def choose_lengths(sizes: Mapping[Any, int], largest: int) -> dict[Any, int]:
    """Choose lengths of parts of at most `largest` points, dividing the first axes first."""
    # Parts with whole last axes are contiguous in memory and in the file.
    lengths = dict[Any, int]()
    for name, size in reversed([*sizes.items()]):
        lengths[name] = min(size, max(largest, 1))
        largest //= lengths[name]
    return lengths


def divide(sizes: Mapping[Any, int], largest: int) -> list[dict[Any, slice]]:
    """Divide a grid into parts of at most `largest` points, in the order of its points."""
    lengths = choose_lengths(sizes, largest)
    cuts = [
        [slice(k, min(k + lengths[name], size)) for k in range(0, size, lengths[name])]
        for name, size in sizes.items()
    ]
    return [dict(zip(sizes, slices, strict=True)) for slices in itertools.product(*cuts)]
