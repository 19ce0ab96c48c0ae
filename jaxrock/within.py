"""Driven motion of many blocks to a tolerance: each at the order that it needs."""

import itertools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from .arguments import POSITIVE, Number, as_real, check
from .batch import BatchResponse, respond_batch
from .block import Block
from .motion import Pulse, Record
from .printing import listed

ORDERS = (4, 6, 8, 10)
_SAFETY = 1.25  # an order is off by what the next one differs by, and by what that is off by
# In units of eps: what rounding amounts to, as a slip of the input, and the tolerance below
# which it counts, too, after the impacts have amplified it.
_ROUNDING, _DELICATE = 64, 2**32
# What no order gets below: pulses are taken as quintics.
_FLOORS = {Record: 1e-12, Pulse: 1e-9}


class Within(NamedTuple):
    """Responses and how good they are; see `respond_within`.

    Attributes
    ----------
    response : BatchResponse
        At the order of each block.
    order : Array of int
        Of the Taylor polynomials.
    error : Array
        By how much the peak rotation is off, relative: what the order before differs by (for
        tolerances below 1e-6 also what rounding, amplified by the impacts, does), and at least
        1e-9 under a pulse; inf where that has another fate.
    cheapest : Array of int
        The order before, where it keeps the tolerance, too: cheaper, next time.
    kept : Array of bool
        Whether the tolerance is kept. Where it is not the response is chaotic, or asks for
        more than the precision has.
    """

    response: BatchResponse
    order: Int[np.ndarray, "..."]
    error: Float[np.ndarray, "..."]
    cheapest: Int[np.ndarray, "..."]
    kept: Bool[np.ndarray, "..."]

    def __str__(self) -> str:
        return f"{self.response}\n{listed(self, order='', error='', kept='')}"


def respond_within(
    blocks: Block,
    restitution: Number,
    motion: Pulse | Record,
    tolerance: float,
    *,
    linearized: bool = False,
) -> Within:
    """Response of many blocks, each computed at two orders or more until they agree.

    Parameters
    ----------
    blocks, restitution, motion, linearized
        As in `respond_batch`, where everything broadcasts.
    tolerance : float
        On the peak rotation, relative.

    Returns
    -------
    Within

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed.
    """
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    restitution = as_real("restitution", restitution)
    now = respond_batch(blocks, restitution, motion, linearized=linearized, order=ORDERS[0])
    shape = now.complete.shape
    floor = next(least for kind, least in _FLOORS.items() if isinstance(motion, kind))
    eps = float(np.finfo(now.margin.dtype).eps)
    floor = max(floor, _ROUNDING * eps)
    found = jax.tree.map(lambda leaf: np.array(leaf).reshape(-1), now)
    order = np.full(found.complete.shape, ORDERS[0])
    error = np.full(found.complete.shape, np.inf)
    cheapest = order.copy()
    for before, after in itertools.pairwise(ORDERS):
        (open_,) = np.nonzero(error > tolerance)
        if not open_.size:
            break
        block, c, shaking = _part(blocks, restitution, motion, shape, open_)
        now = respond_batch(block, c, shaking, linearized=linearized, order=after)
        now = jax.tree.map(lambda leaf, size=open_.size: np.broadcast_to(leaf, (size,)), now)
        differs = _apart(jax.tree.map(lambda leaf, k=open_: leaf[k], found), now)
        if tolerance < _DELICATE * eps:
            slipped = shaking.scaled(1 + _ROUNDING * eps)
            other = respond_batch(block, c, slipped, linearized=linearized, order=after)
            differs = np.maximum(differs, _apart(now, jax.tree.map(np.asarray, other)))
        error[open_] = np.maximum(_SAFETY * differs, floor)
        cheapest[open_] = np.where(error[open_] <= tolerance, before, after)
        order[open_] = after
        for leaf, new in zip(jax.tree.leaves(found), jax.tree.leaves(now), strict=True):
            leaf[open_] = new

    def shaped(leaf: np.ndarray) -> np.ndarray:
        return leaf.reshape(shape)

    return Within(
        jax.device_put(jax.tree.map(shaped, found)),
        shaped(order),
        shaped(error),
        shaped(cheapest),
        shaped((error <= tolerance) & found.complete),
    )


def _apart(before: BatchResponse, after: BatchResponse) -> np.ndarray:
    """By how much two responses differ, as `Within.error` has it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(before.peak_rotation / after.peak_rotation - 1)
    off = np.where(before.peak_rotation == after.peak_rotation, 0, off)
    off = np.where(after.overturned, 0, off)
    same = (before.overturned == after.overturned) & before.complete & after.complete
    return np.where(same, off, np.inf)


def _part(
    blocks: Block, restitution: Any, motion: Pulse | Record, shape: tuple[int, ...], index: Any
) -> tuple[Block, Any, Pulse | Record]:
    """The arguments of some blocks of a batch; samples that all share stay as they are."""
    shape = shape or (1,)
    where = np.unravel_index(index, shape)

    def taken(leaf: Any, lasting: int = 0) -> np.ndarray:
        leaf = np.asarray(leaf)
        last = leaf.shape[leaf.ndim - lasting :]
        if last == leaf.shape and lasting:
            return leaf
        return np.broadcast_to(leaf, (*shape, *last))[where]

    if isinstance(motion, Record):
        vertical = None if motion.vertical is None else taken(motion.vertical, 1)
        shared = (taken(leaf) for leaf in (motion.time_step, motion.scale, motion.start))
        time_step, scale, start = shared
        motion = Record(taken(motion.acceleration, 1), time_step, vertical, scale, start)
    else:
        motion = jax.tree.map(taken, motion)
    return jax.tree.map(taken, blocks), taken(restitution), motion
