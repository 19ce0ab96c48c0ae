"""Grids, computed part by part: in memory, into a file, or lazily."""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..host import (
    import_optional,
    labelled,
    mapped,
    processors,
    version,
    with_names,
    with_progress,
    written_whole,
)
from .axes import label

if TYPE_CHECKING:
    import xarray

    from .lazy import Chunks

Chunk = tuple[slice, ...]


@dataclass(frozen=True)
class Grid:
    """A dataset over named axes, before it is computed.

    Attributes
    ----------
    title, attributes
        Of the dataset.
    axes : mapping of str to ndarray
        The values along each; an axis that is no dimension of a variable becomes a scalar
        coordinate.
    variables : mapping
        Dimensions, type and attributes of each. Dimensions are axes in their order, and after
        them `columns`.
    compute : callable
        Takes what is `shared` and the values along each axis in a chunk, and returns an array
        of each variable over the dimensions of that. Is pickled, and what it returns for a
        point is the same bits whatever else is in the chunk.
    largest, usual : int
        Most points that are computed at once, and most in a chunk of a lazy dataset by
        default.
    names : mapping
        Names along axes whose values are none of a coordinate, and what these are names of.
    labels : mapping
        Attributes of axes that are not described here.
    columns : mapping of str to int
        Sizes of dimensions that are no axes.
    shared : pytree
    """

    title: str
    axes: Mapping[str, np.ndarray]
    variables: Mapping[str, tuple[Sequence[str], Any, Mapping[str, Any]]]
    attributes: Mapping[str, Any]
    compute: Callable[..., Mapping[str, Any]]
    largest: int
    usual: int
    names: Mapping[str, tuple[Sequence[str], str]] = field(default_factory=dict)
    labels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    columns: Mapping[str, int] = field(default_factory=dict)
    shared: Any = None

    def dataset(
        self, chunks: "Chunks | None" = None, store: str | Path | None = None
    ) -> "xarray.Dataset":
        """Compute it, in memory or in a NetCDF file; or make it lazy, if there are chunks."""
        if chunks is None:
            return self.stored(store) if store is not None else self.labelled(self.computed())
        if store is not None:
            must = "a NetCDF file is not written in chunks; write_zarr writes a lazy dataset"
            raise ValueError(f"store goes without chunks: {must}")
        lazy = import_optional(f"{__package__}.lazy", "cluster")
        used = {dim for dims, _, _ in self.variables.values() for dim in dims}
        sizes = {name: values.size for name, values in self.axes.items()}
        inner = {name: size for name, size in sizes.items() if name in used}
        along = lazy.chunks_along(chunks, inner, self.usual)
        along |= {name: (size,) for name, size in sizes.items() if name not in used}
        variables = {name: entry[:2] for name, entry in self.variables.items()}
        about = (self.title, dict(self.attributes), dict(self.names), version())
        compute = functools.partial(_all_of, self.without_values())
        return self.labelled(
            lazy.lazy_arrays(
                compute, self.shared, self.axes, along, variables, self.columns, about
            )
        )

    def without_values(self) -> "Grid":
        """Itself, without what the axes and the shared part weigh."""
        return replace(self, axes=dict.fromkeys(self.axes, np.empty(0)), shared=None, names={})

    def computed(self) -> dict[str, np.ndarray]:
        """All variables, in memory."""
        if math.prod(values.size for values in self.axes.values()) <= self.largest:
            answers = self.compute(self.shared, *self.axes.values())
            return {
                n: np.ascontiguousarray(answers[n], v[1]) for n, v in self.variables.items()
            }
        arrays = {
            name: np.empty([self.size(dim) for dim in dims], dtype)
            for name, (dims, dtype, _) in self.variables.items()
        }
        self.fill(arrays)
        return arrays

    def size(self, dim: str) -> int:
        """Along a dimension."""
        return self.columns[dim] if dim in self.columns else self.axes[dim].size

    def fill(self, targets: Mapping[str, Any]) -> None:
        """Compute all variables, part by part, into arrays or variables of a file."""
        places = chunks_of([values.size for values in self.axes.values()], self.largest)
        for place in with_progress(places, self.title.lower()):
            at = dict(zip(self.axes, place, strict=True))
            answers = self.compute(self.shared, *(v[at[n]] for n, v in self.axes.items()))
            for name, target in targets.items():
                dims = self.variables[name][0]
                target[tuple(at.get(dim, slice(None)) for dim in dims)] = answers[name]

    def labelled(self, arrays: Mapping[str, Any]) -> "xarray.Dataset":
        """Make the dataset of arrays of all variables."""
        entries = {name: (v[0], arrays[name], v[2]) for name, v in self.variables.items()}
        dataset = labelled(self.title, entries, self.coordinates(), self.attributes)
        return with_names(dataset, **self.names) if self.names else dataset

    def coordinates(self) -> dict[str, Any]:
        """Of axes that are dimensions their values, of others their only one."""
        used = {dim for dims, _, _ in self.variables.values() for dim in dims}
        return {
            name: (
                *(((name,), values) if name in used else ((), values[0])),
                self.labels.get(name) or label(name),
            )
            for name, values in self.axes.items()
            if name not in self.names
        }

    def stored(self, store: str | Path) -> "xarray.Dataset":
        """Compute into a NetCDF file, from which the dataset reads on demand."""
        import netCDF4
        import xarray

        path = Path(store)
        coordinates = self.coordinates()
        scalars = " ".join(name for name, (dims, *_) in coordinates.items() if not dims)
        with written_whole("store", path.parent, [path.name], overwrite=True) as scratch:
            bare = labelled(self.title, {}, coordinates, self.attributes)
            bare.reset_coords().to_netcdf(scratch / path.name)
            with netCDF4.Dataset(scratch / path.name, "a") as file:
                for name, (dims, dtype, described) in self.variables.items():
                    missing = math.nan if np.dtype(dtype).kind == "f" else None
                    target = file.createVariable(name, dtype, dims, fill_value=missing)
                    target.setncatts(
                        {**described, **({"coordinates": scalars} if scalars else {})}
                    )
                self.fill({name: file[name] for name in self.variables})
        return xarray.open_dataset(path)


def _all_of(grid: Grid, shared: Any, *parts: np.ndarray) -> dict[str, np.ndarray]:
    """All variables of one chunk: as those of a grid of its own."""
    axes = dict(zip(grid.axes, parts, strict=True))
    return replace(grid, axes=axes, shared=shared).computed()


def along(things: Sequence[Any]) -> np.ndarray:
    """Things that are no numbers, as the values along an axis."""
    values = np.empty(len(things), object)
    for k, thing in enumerate(things):
        values[k] = thing
    return values


def flat(*parts: np.ndarray) -> tuple[tuple[int, ...], np.ndarray]:
    """Return the shape of a part of a grid, and each axis' value at each of its points."""
    shape = tuple(part.size for part in parts)
    points = np.empty((len(parts), *shape))
    for place, part in enumerate(parts):
        points[place] = part.reshape([-1 if k == place else 1 for k in range(len(parts))])
    return shape, points.reshape(len(parts), -1)


def in_tiles(
    function: Callable[..., Any], tile: int, points: np.ndarray, workers: int = 0
) -> Any:
    """Apply an elementwise function to points of shape (arguments, n), n > 0, in tiles.

    XLA makes another program for every shape, and not all of these round alike. In tiles each
    point has the same bits whatever the others are, and one program serves all grids. The
    function takes the number of the tile and its points, and is called by as many threads as
    there are `workers`, by default one for each processor. Returns NumPy arrays.
    """
    size = points.shape[1]
    numbers = range(-(-size // tile))

    def of_tile(number: int) -> tuple[slice, Any]:
        part = points[:, number * tile : (number + 1) * tile]
        taken = part.shape[1]
        if taken < tile:
            part = np.pad(part, ((0, 0), (0, tile - taken)), mode="edge")
        answers = function(number, part)
        return slice(number * tile, number * tile + taken), answers

    at, first = of_tile(0)
    if len(numbers) == 1:
        return jax.tree.map(lambda leaf: np.asarray(leaf)[at], first)
    whole = jax.tree.map(lambda leaf: np.empty((size, *leaf.shape[1:]), leaf.dtype), first)

    def store(at: slice, answers: Any) -> None:
        for target, leaf in zip(jax.tree.leaves(whole), jax.tree.leaves(answers), strict=True):
            target[at] = np.asarray(leaf)[: at.stop - at.start]

    store(at, first)
    mapped(lambda number: store(*of_tile(number)), numbers[1:], workers or processors())
    return whole


def of_few_shapes(function: Callable[[Any], Any], tree: Any) -> np.ndarray:
    """Apply an elementwise function to a pytree of numbers and flat arrays, in NumPy.

    Padded, so that few shapes are compiled whatever the chunks are.
    """
    size = max(np.size(leaf) for leaf in jax.tree.leaves(tree))
    room = max(256, 1 << (size - 1).bit_length())

    def padded(leaf: Any) -> Any:
        return (
            np.pad(np.asarray(leaf), (0, room - size), mode="edge") if np.ndim(leaf) else leaf
        )

    answers = np.asarray(function(jax.tree.map(padded, tree)))
    return answers[:size] if answers.ndim else answers


def chunks_of(sizes: Sequence[int], largest: int) -> list[Chunk]:
    """Divide a grid into chunks of at most `largest` points, the first axes before the last."""
    cuts = []
    for size in reversed(sizes):
        length = min(size, max(largest, 1))
        largest //= length
        cuts.insert(0, [slice(k, min(k + length, size)) for k in range(0, size, length)])
    return list(itertools.product(*cuts))
