"""Grids as lazy Dask arrays: one task for each chunk, and one to take out each variable."""

import enum
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import dask.array as da
import jax
import jax.numpy as jnp
import numpy as np
from dask.delayed import delayed
from dask.tokenize import tokenize
from jaxtyping import Array, PyTree
from typing_extensions import TypeAliasType

from ..host import apply_settings, hide_progress, read_jax_settings
from .axes import DataType, GridVariable

Chunks = TypeAliasType("Chunks", Mapping[str, int | Sequence[int]] | str)
Compute = Callable[..., Mapping[str, np.ndarray]]


def make_lazy_arrays(
    compute: Compute,
    shared: PyTree,
    axes: Mapping[str, np.ndarray],
    chunks: Mapping[str, Sequence[int]],
    variables: Mapping[str, GridVariable],
    columns: Mapping[str, int],
    identity: object,
) -> dict[str, da.Array]:
    """Make the variables over a grid lazily; compute nothing.

    `compute` is a function as `Grid` asks for. It takes the `shared` pytree and the values
    along each axis in a chunk, and returns an array for each variable, over its dimensions.
    These are axes in their order, and after them `columns`, with their sizes. Names of tasks
    follow from the arguments and from the `identity`, so that equal grids have equal names.
    """
    # Tasks run in threads and processes whose settings of JAX may be others, above all the
    # precision: they take those of here along. In the names only the precision counts. The
    # others, such as a folder for compiled programs, change no number.
    settings = {name: value for name, value in read_jax_settings().items() if _is_plain(value)}
    kinds = {name: (variable.dims, variable.dtype) for name, variable in variables.items()}
    shape = (tuple(axes), chunks, kinds, columns, settings["enable_x64"])
    token = tokenize(compute, _pack(shared), list(axes.values()), shape, identity)

    # An axis that is a single number has no dimension, and no chunks.
    place = {name: k for k, name in enumerate((*chunks, *columns))}
    inputs: list[object] = []
    for name, values in axes.items():
        dims = (name,) * values.ndim
        lengths: Any = tuple(tuple(chunks[dim]) for dim in dims)  # more than Dask's `str`
        array = da.from_array(values, lengths, name=f"jaxrock-{name}-{token}")
        inputs += [array, tuple(place[dim] for dim in dims)]

    # As an input of its own: it is sent to each worker once, and not with every task.
    common = delayed(_pack(shared), name=f"jaxrock-shared-{token}", traverse=False)

    # An array over the axes whose element for a chunk stands for a dictionary of all
    # variables: so they are computed together, once, whichever of them are asked for.
    grid = da.blockwise(
        _run_task,
        tuple(range(len(chunks))),
        common,
        None,
        *inputs,
        compute=compute,
        settings=settings,
        name=f"jaxrock-grid-{token}",
        dtype=object,
        meta=np.empty((0,) * len(chunks), object),
    )

    def take(name: str, dims: Sequence[str], dtype: DataType) -> da.Array:
        # A variable is the same along axes that it does not have: their first chunk does.
        # Without any axis there is one chunk, of which Dask would list no blocks.
        first = tuple(slice(None) if n in dims else slice(1) for n in chunks)
        part = grid.blocks[first] if first else grid
        new = {place[n]: size for n, size in columns.items() if n in dims}
        return da.blockwise(
            _take_variable,
            tuple(place[dim] for dim in dims),
            part,
            tuple(range(len(chunks))),
            variable=name,
            new_axes=new,
            name=f"jaxrock-{name}-{token}",
            dtype=np.dtype(dtype),
            meta=np.empty((0,) * len(dims), dtype),
        )

    return {name: take(name, dims, dtype) for name, (dims, dtype) in kinds.items()}


def choose_chunks(
    chunks: Chunks, sizes: Mapping[str, int], largest: int
) -> dict[str, tuple[int, ...]]:
    """Choose the lengths of chunks along each axis; a `ValueError` if they do not fit.

    With "auto" a chunk has at most `largest` points, and the last axes stay whole.
    """
    if isinstance(chunks, str) and chunks == "auto":
        lengths = dict[str, int]()
        for name, size in reversed([*sizes.items()]):
            lengths[name] = max(1, min(size, largest))
            largest //= lengths[name]
        return {name: _cut_axis(name, lengths[name], size) for name, size in sizes.items()}
    if not isinstance(chunks, Mapping):
        raise ValueError(
            'chunks must be "auto" or lengths by dimension, such as'
            f" {{{next(iter(sizes))!r}: 50}}, got {chunks!r:.60}"
        )
    for name in chunks:
        if name not in sizes:
            names = ", ".join(sizes)
            raise ValueError(f"chunks must have keys among {names}, got {name!r}")
    return {name: _cut_axis(name, chunks.get(name, -1), size) for name, size in sizes.items()}


def _cut_axis(name: str, length: int | Sequence[int], size: int) -> tuple[int, ...]:
    """Cut an axis into chunks of one length or of several; a `ValueError` if not possible."""
    # True is an integer in Python, and would be a length of 1.
    if isinstance(length, int | np.integer) and not isinstance(length, bool):
        if length > 0 or length == -1:
            whole = size if length == -1 else min(int(length), size)
            return (*[whole] * (size // whole), *[size % whole] * (size % whole > 0))
    elif isinstance(length, Sequence) and not isinstance(length, str):
        lengths = tuple(length)
        if all(isinstance(n, int | np.integer) and n > 0 for n in lengths):
            lengths = tuple(map(int, lengths))
            if sum(lengths) == size:
                return lengths
    raise ValueError(
        f"chunks of {name} must be a length from 1 on, -1 for all, or lengths that add up to"
        f" {size}, got {length!r:.60}"
    )


def _run_task(
    shared: PyTree, *parts: np.ndarray, compute: Compute, settings: Mapping[str, object]
) -> Mapping[str, np.ndarray]:
    """Compute all variables of one chunk, in whatever thread or process this is."""
    # Without progress bars: those of many tasks would write over each other, and Dask has one.
    with apply_settings(settings), hide_progress():
        return compute(_unpack(shared), *parts)


def _take_variable(chunk: list | Mapping[str, np.ndarray], variable: str) -> np.ndarray:
    """Take one variable out of the answer for a chunk."""
    # Along dimensions that the variable does not have, `blockwise` hands over a list of
    # chunks, which here has one element.
    while isinstance(chunk, list):
        (chunk,) = chunk
    return chunk[variable]


def _is_plain(value: object) -> bool:
    """Return whether a setting means the same in another process, unlike a device."""
    return value is None or isinstance(value, bool | int | float | str | enum.Enum)


# JAX arrays travel as NumPy arrays: unpickled before `apply_settings`, one of 64 bits would
# lose half of them in a worker whose precision is single. NumPy knows no weak types, so
# numbers that have one travel as a class of their own. Else they would widen what they meet on
# arrival, and the bits would be others than in memory.
class _WeakNumber(float):
    """A number of weak type, as JAX calls it: it takes the precision of others."""


def _pack(tree: PyTree) -> PyTree:
    """Pack a pytree for other processes, which have settings of their own when they get it."""

    def pack_leaf(leaf: Array) -> np.ndarray | _WeakNumber:
        return _WeakNumber(leaf) if leaf.weak_type and not leaf.ndim else np.asarray(leaf)

    return jax.tree.map(
        lambda leaf: pack_leaf(leaf) if isinstance(leaf, jax.Array) else leaf, tree
    )


def _unpack(tree: PyTree) -> PyTree:
    """Unpack a pytree that was packed for this process, under its final settings."""

    def unpack_leaf(leaf: np.ndarray | _WeakNumber) -> Array:
        return jnp.asarray(float(leaf) if isinstance(leaf, _WeakNumber) else leaf)

    packed = (np.ndarray, _WeakNumber)
    return jax.tree.map(
        lambda leaf: unpack_leaf(leaf) if isinstance(leaf, packed) else leaf, tree
    )
