"""Objects whose risk is asked for: one block or many."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..block import Block, change_block
from ..impact import read_restitution
from ..validation import AnyArray, Number, as_text, check_concrete, check_kind


class Objects(NamedTuple):
    """Objects along one axis, or a single one.

    Attributes
    ----------
    block, restitution : Block, Array
        Leaves of shape (objects,), or () for one block.
    shape : tuple of int
        () or (objects,).
    names : tuple of str
        One for each object; "1", "2", ... where none are given.
    """

    block: Block
    restitution: AnyArray
    shape: tuple[int, ...]
    names: tuple[str, ...]

    @property
    def number(self) -> int:
        """Number of objects."""
        return self.shape[0] if self.shape else 1


def gather_objects(
    block: Block, restitution: Number, names: Sequence[str] | None = None
) -> Objects:
    """Gather concrete objects; a `ValueError` if they are not allowed."""
    check_kind("block", block, Block)
    check_concrete((block, restitution), "outcomes are counted on the host")
    coefficient = read_restitution(block, restitution)
    leaves, form = jax.tree.flatten((block, coefficient))
    shapes = [np.shape(leaf) for leaf in leaves]
    try:
        shape = np.broadcast_shapes(*shapes)
    except ValueError:
        raise ValueError(
            "block and restitution must have shapes that broadcast, got half_width,"
            " slenderness, gravity, inertia_ratio and restitution of"
            f" {', '.join(map(str, shapes))}"
        ) from None
    if len(shape) > 1:
        raise ValueError(
            "block and restitution must be single or have one axis, of objects,"
            f" got shape {shape}"
        )
    if shape == (0,):
        raise ValueError("block and restitution must be of at least one object, got none")
    # In NumPy: JAX would compile a program for each number of objects, and of values that one
    # of them is given.
    leaves = [np.broadcast_to(np.asarray(leaf), shape) for leaf in leaves]
    block, coefficient = jax.tree.unflatten(form, leaves)
    return Objects(block, coefficient, shape, _check_names(names, shape))


def _check_names(names: Sequence[str] | None, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of objects, each its own; a `ValueError` if they are not allowed."""
    if names is None:
        return tuple(str(k + 1) for k in range(shape[0])) if shape else ()
    if not shape:
        raise ValueError("names must be left out for a single block")
    if isinstance(names, str):
        raise ValueError(f"names must be a list, got {names!r:.60}")
    names = tuple(str(as_text(name)) for name in names)
    if len(names) != shape[0]:
        raise ValueError(f"names must be one for each of {shape[0]} objects, got {len(names)}")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"names must differ, got {twice[0]!r} twice")
    return names


def change_objects(
    objects: Objects, indices: np.ndarray, values: np.ndarray, along: str
) -> Objects:
    """Select objects by their indices, and give each a value of the parameter."""
    dtype = np.asarray(objects.restitution).dtype
    block, restitution = jax.tree.map(
        lambda leaf: np.atleast_1d(leaf)[indices], (objects.block, objects.restitution)
    )
    block, restitution = change_parameter(block, restitution, along, values.astype(dtype))
    return objects._replace(block=block, restitution=restitution, names=())


def change_parameter(
    block: Block, restitution: AnyArray, along: str, value: AnyArray
) -> tuple[Block, AnyArray]:
    """Give a block, or its impacts, a value of the parameter."""
    if along == "restitution":
        return block, value
    return change_block(block, along, value), restitution
