"""Objects and their samples along one axis, for one simulation of all."""

from typing import NamedTuple

import jax
import numpy as np

from ..block import Block
from ..ground_motion import Suite
from ..sensitivity import FloorFactors, Uncertain
from .objects import Objects


class DrawnObjects(NamedTuple):
    """The medians of all objects, then the samples of those that have any.

    Attributes
    ----------
    block, restitution : Block, ndarray, shape (rows,)
    floors : FloorFactors of shape (rows,), or None
        None where the floor is the same for all.
    owner : ndarray of int, shape (rows,)
        Index of the object; -1 of rows that are no sample of one.
    """

    block: Block
    restitution: np.ndarray
    floors: FloorFactors | None
    owner: np.ndarray


def draw_objects(objects: Objects, uncertain: Uncertain | None, suite: Suite) -> DrawnObjects:
    """Draw samples of objects that stand on the ground or the floor of a suite."""
    number = objects.number
    owner = np.arange(number)
    if uncertain is None:
        return DrawnObjects(objects.block, np.asarray(objects.restitution), None, owner)
    on_floor = suite.floor is not None
    draws = uncertain.draw(objects.block, objects.restitution, on_floor=on_floor)
    drawn = (draws.block, draws.restitution, draws.floor)
    # An object of which nothing is uncertain has no samples: its median is all.
    has_samples = np.zeros(number, bool)
    for leaf in jax.tree.leaves(drawn):
        has_samples |= np.ptp(leaf, axis=-1) > 0
    of_medians = (
        None if draws.floor is None else FloorFactors(np.ones(number), np.ones(number))
    )
    block, restitution, floors = jax.tree.map(
        lambda median, samples: np.concatenate([median, samples[has_samples].reshape(-1)]),
        (objects.block, objects.restitution, of_medians),
        drawn,
    )
    owner = np.concatenate([owner, np.repeat(np.flatnonzero(has_samples), uncertain.samples)])
    return DrawnObjects(block, restitution, floors, owner)


def add_restitutions(
    drawn: DrawnObjects, indices: np.ndarray, restitution: np.ndarray
) -> DrawnObjects:
    """Add the medians of some objects once more, with other restitutions."""
    block, floors = jax.tree.map(
        lambda rows: np.concatenate([rows, np.asarray(rows)[indices]]),
        (drawn.block, drawn.floors),
    )
    restitution = restitution.astype(drawn.restitution.dtype)
    return DrawnObjects(
        block,
        np.concatenate([drawn.restitution, restitution]),
        floors,
        np.concatenate([drawn.owner, np.full(len(indices), -1)]),
    )
