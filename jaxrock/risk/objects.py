"""Objects whose risk is asked for: one block or many, and samples of them."""

import jax
import numpy as np

from ..block import Block, change_block
from ..driven import RecordVariants
from ..ground_motion import Suite, vary_floor
from ..impact import read_restitution
from ..sensitivity import FloorFactors, Uncertain
from ..validation import AnyArray, Number, check_concrete, check_kind, check_shapes

# A block and its restitution in NumPy, of shape (objects,), or () for a single one.
Objects = tuple[Block, np.ndarray]


def gather_objects(block: Block, restitution: Number) -> Objects:
    """Gather concrete objects; a `ValueError` if they are not allowed."""
    check_kind("block", block, Block)
    check_concrete((block, restitution), "outcomes are counted on the host")
    coefficient = read_restitution(block, restitution)
    check_shapes(block=block, restitution=coefficient)
    leaves, form = jax.tree.flatten((block, coefficient))
    shape = np.broadcast_shapes(*map(np.shape, leaves))
    if len(shape) > 1 or shape == (0,):
        raise ValueError(
            "block and restitution must be single or have one axis, of at least one object,"
            f" got shape {shape}"
        )
    # In NumPy: JAX would compile a program for each number of objects, and of values that one
    # of them is given.
    leaves = [np.broadcast_to(np.asarray(leaf), shape) for leaf in leaves]
    return jax.tree.unflatten(form, leaves)


def draw_objects(
    objects: Objects, uncertain: Uncertain | None, on_floor: bool = False
) -> tuple[Block, np.ndarray, FloorFactors | None]:
    """Draw samples of objects, with factors on their floors, all of shape (..., samples).

    They are drawn in float64, and are in the precision of the medians. Without uncertainty the
    medians are the only sample.
    """
    parts = (*objects, None)
    if uncertain is not None:
        check_kind("uncertain", uncertain, Uncertain)
        draws = uncertain.draw(*objects, on_floor=on_floor)
        parts = (draws.block, draws.restitution, draws.floor)
    shape = objects[1].shape
    dtype = objects[1].dtype
    return jax.tree.map(lambda leaf: np.asarray(leaf, dtype).reshape(*shape, -1), parts)


def vary_motions(suite: Suite, floors: FloorFactors | None) -> Suite | RecordVariants:
    """Put the ground of a suite on the floors of samples; the suite itself if there are none.

    Parameters
    ----------
    suite : Suite
        On a floor, if there are factors on its period and damping.
    floors : FloorFactors of shape (...), or None

    Returns
    -------
    Suite or RecordVariants
    """
    if floors is None:
        return suite
    # Objects share the floors of samples: each is filtered once.
    pairs = np.stack([np.ravel(factors) for factors in floors], axis=-1)
    different, which = np.unique(pairs, axis=0, return_inverse=True)
    records = vary_floor(suite, *different.T)
    return RecordVariants(records, which.reshape(np.shape(floors.period)).astype(float))


def change_objects(
    objects: Objects, which: np.ndarray | slice, values: np.ndarray, along: str
) -> tuple[Block, AnyArray]:
    """Select objects, and give each a value of the parameter."""
    block, restitution = jax.tree.map(lambda leaf: np.atleast_1d(leaf)[which], objects)
    return change_parameter(block, restitution, along, values.astype(restitution.dtype))


def change_parameter(
    block: Block, restitution: AnyArray, along: str, value: AnyArray
) -> tuple[Block, AnyArray]:
    """Give a block, or its impacts, a value of the parameter."""
    if along == "restitution":
        return block, value
    return change_block(block, along, value), restitution
