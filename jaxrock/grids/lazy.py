"""Grids as lazy Dask arrays: one task for each chunk, whose variables are taken from its answer."""

import enum
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import dask.array as da
import jax
import jax.numpy as jnp
import numpy as np
from dask.delayed import delayed
from dask.tokenize import tokenize
from typing_extensions import TypeAliasType

from ..host import settings_of_jax, under, without_progress

Chunks = TypeAliasType("Chunks", Mapping[str, int | Sequence[int]] | str)
Compute = Callable[..., Mapping[str, np.ndarray]]


def lazy_arrays(
    compute: Compute,
    shared: Any,
    axes: Mapping[str, np.ndarray],
    chunks: Mapping[str, Sequence[int]],
    variables: Mapping[str, tuple[Sequence[str], Any]],
    columns: Mapping[str, int],
    about: Any,
) -> dict[str, da.Array]:
    """Make the variables over a grid lazily; nothing is computed.

    `compute` is a function that can be pickled. It takes what is `shared` and the values along
    each axis in a chunk, and returns an array for each variable, over the dimensions of that.
    These are axes in their order, and after them `columns`, with their sizes. Names of tasks
    follow from the arguments and from `about`, so that equal grids have equal names.
    """
    settings = {name: value for name, value in settings_of_jax().items() if _is_plain(value)}
    values = {name: _packed_each(axis) for name, axis in axes.items()}
    contents = [axis.tolist() if axis.dtype == object else axis for axis in values.values()]
    shape = (tuple(axes), chunks, variables, columns, settings["enable_x64"])
    token = tokenize(compute, _packed(shared), contents, shape, about)
    place = {name: k for k, name in enumerate((*axes, *columns))}
    inputs: list[Any] = []
    for name, each in values.items():
        lengths: Any = (tuple(chunks[name]),)
        array = da.from_array(each, lengths, name=f"jaxrock-{name}-{token}")
        inputs += [array, (place[name],)]
    # As an input of its own: it is sent to each worker once, and not with every task.
    common = delayed(_packed(shared), name=f"jaxrock-shared-{token}", traverse=False)
    grid = da.blockwise(
        _computed,
        tuple(range(len(axes))),
        common,
        None,
        *inputs,
        compute=compute,
        settings=settings,
        name=f"jaxrock-grid-{token}",
        dtype=object,
        meta=np.empty((0,) * len(axes), object),
    )

    def taken(name: str, dims: Sequence[str], dtype: Any) -> da.Array:
        # What has fewer dimensions is the same along the others: of these the first chunk.
        part = grid.blocks[tuple(slice(None) if n in dims else slice(1) for n in axes)]
        new = {place[n]: size for n, size in columns.items() if n in dims}
        return da.blockwise(
            _taken,
            tuple(place[dim] for dim in dims),
            part,
            tuple(range(len(axes))),
            variable=name,
            new_axes=new,
            name=f"jaxrock-{name}-{token}",
            dtype=np.dtype(dtype),
            meta=np.empty((0,) * len(dims), dtype),
        )

    return {name: taken(name, dims, dtype) for name, (dims, dtype) in variables.items()}


def lazily_from(
    function: Compute,
    array: da.Array,
    arguments: Sequence[Any],
    variables: Mapping[str, tuple[Sequence[int], Any]],
) -> dict[str, da.Array]:
    """Apply a function to a whole lazy array and to other arguments, in one task.

    Each variable has some axes of the array, and a type; the first one is cut as in the array.
    """
    whole: Any = -1
    made = da.map_blocks(
        function,
        array.rechunk(whole),
        *arguments,
        name=f"{function.__name__}-{tokenize(array.name, arguments)}",
        dtype=object,
        meta=np.empty((0,) * array.ndim, object),
    )

    def taken(name: str, axes: Sequence[int], dtype: Any) -> da.Array:
        found = da.blockwise(
            _taken,
            tuple(axes),
            made,
            tuple(range(array.ndim)),
            variable=name,
            name=f"{name}-{made.name}",
            dtype=np.dtype(dtype),
            meta=np.empty((0,) * len(axes), dtype),
        )
        return found.rechunk({0: array.chunks[0]}) if 0 in axes else found

    return {name: taken(name, axes, dtype) for name, (axes, dtype) in variables.items()}


def chunks_along(
    chunks: Chunks, sizes: Mapping[str, int], largest: int
) -> dict[str, tuple[int, ...]]:
    """Choose the chunks along each axis; "auto" is at most `largest` points, last axes whole.

    A `ValueError` if they are not those of these sizes.
    """
    if isinstance(chunks, str) and chunks == "auto":
        lengths = dict[str, int]()
        for name, size in reversed([*sizes.items()]):
            lengths[name] = max(1, min(size, largest))
            largest //= lengths[name]
        return {name: _cut(name, lengths[name], size) for name, size in sizes.items()}
    if not isinstance(chunks, Mapping):
        must = 'chunks must be "auto" or lengths by dimension, such as'
        raise ValueError(f"{must} {{{next(iter(sizes))!r}: 50}}, got {chunks!r:.60}")
    for name in chunks:
        if name not in sizes:
            names = ", ".join(sizes)
            raise ValueError(f"chunks must be of the dimensions {names}, got {name!r}")
    return {name: _cut(name, chunks.get(name, -1), size) for name, size in sizes.items()}


def _cut(name: str, length: Any, size: int) -> tuple[int, ...]:
    whole = isinstance(length, int | np.integer) and not isinstance(length, bool)
    if whole and (length > 0 or length == -1):
        length = size if length == -1 else min(int(length), size)
        return (*[length] * (size // length), *[size % length] * (size % length > 0))
    if isinstance(length, Sequence) and not isinstance(length, str):
        lengths = tuple(length)
        if all(isinstance(n, int | np.integer) and n > 0 for n in lengths):
            lengths = tuple(map(int, lengths))
            if sum(lengths) == size:
                return lengths
    must = "must be a length from 1 on, -1 for all, or lengths that add up to"
    raise ValueError(f"chunks of {name} {must} {size}, got {length!r:.60}")


def _computed(
    shared: Any, *parts: np.ndarray, compute: Compute, settings: Mapping[str, Any]
) -> Mapping[str, np.ndarray]:
    """All variables of one chunk, whatever process this is."""
    with under(settings), without_progress():
        values = [part if part.dtype != object else _unpacked_each(part) for part in parts]
        return compute(_unpacked(shared), *values)


def _taken(chunk: Any, variable: str) -> np.ndarray:
    while isinstance(chunk, list):  # of the dimensions that it does not have
        (chunk,) = chunk
    return chunk[variable]


def _is_plain(value: Any) -> bool:
    """Tell whether a setting means the same in another process, unlike a device."""
    return value is None or isinstance(value, bool | int | float | str | enum.Enum)


class _Weak(float):
    """A number that takes the precision of others, as JAX calls it."""


def _packed(tree: Any) -> Any:
    """Pack a pytree for other processes, which have settings of their own when they get it."""

    def one(leaf: Any) -> Any:
        return _Weak(leaf) if leaf.weak_type and not leaf.ndim else np.asarray(leaf)

    return jax.tree.map(lambda leaf: one(leaf) if isinstance(leaf, jax.Array) else leaf, tree)


def _unpacked(tree: Any) -> Any:
    def one(leaf: Any) -> Any:
        return jnp.asarray(float(leaf) if isinstance(leaf, _Weak) else leaf)

    packed = (np.ndarray, _Weak)
    return jax.tree.map(lambda leaf: one(leaf) if isinstance(leaf, packed) else leaf, tree)


def _packed_each(values: np.ndarray) -> np.ndarray:
    return values if values.dtype != object else _each(_packed, values)


def _unpacked_each(values: np.ndarray) -> np.ndarray:
    return _each(_unpacked, values)


def _each(function: Callable[[Any], Any], values: np.ndarray) -> np.ndarray:
    new = np.empty_like(values)
    for k, value in enumerate(values):
        new[k] = function(value)
    return new
