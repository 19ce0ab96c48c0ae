"""Driven motion of many blocks to a tolerance: each at the order that it needs."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ..block import Block
from ..dynamics import BatchResponse, respond_batch
from ..ground_motion import Pulse, Record
from ..host import listed
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Number, as_real, check

ORDERS = (4, 6, 8, 10)
# What the others are compared with. One and the next may be off by the same, by chance: 4 and 6
# were so twice in a thousand short pulses, so no order vouches for the one it is compared with.
_MAIN = 8
_SAFETY = 1.25  # an order is off by what a higher one differs by, and by what that is off by
# In units of eps: what rounding amounts to, as a slip of the input, and the tolerance below
# which it counts, too, after the impacts have amplified it.
_ROUNDING, _DELICATE = 64, 2**32
# What no order gets below: pulses are taken as quintics.
_FLOORS = {Record: 1e-12, Pulse: 1e-9}


class EstimatedResponse(NamedTuple):
    """Responses and how good they are; see `respond_within`.

    Attributes
    ----------
    response : BatchResponse
        At the order of each block.
    order : Array of int
        Of the Taylor polynomials: 8, or 10 where that was needed to keep the tolerance.
    error : Array
        By how much the peak rotation is off at most, relative: what a lower order differs by
        (for tolerances below 1e-6 also what rounding, amplified by the impacts, does), and at
        least 1e-9 under a pulse; inf where that has another outcome.
    cheapest : Array of int
        The lowest order that keeps the tolerance, too: cheaper, next time.
    within_tolerance : Array of bool
        Whether the tolerance is kept. Where it is not the response is chaotic, or asks for
        more than the precision has.
    """

    response: BatchResponse
    order: Int[np.ndarray, "..."]
    error: Float[np.ndarray, "..."]
    cheapest: Int[np.ndarray, "..."]
    within_tolerance: Bool[np.ndarray, "..."]

    def __str__(self) -> str:
        return f"{self.response}\n{listed(self, order='', error='', within_tolerance='')}"


def respond_within(
    blocks: Block,
    restitution: Number,
    motion: Pulse | Record,
    tolerance: float,
    duration: Number | None = None,
    *,
    model: ModelLike = Nonlinear(),
) -> EstimatedResponse:
    """Response of many blocks, each computed at two orders or more, and how well they agree.

    Parameters
    ----------
    blocks, restitution, motion, model
        As in `respond_batch`, where everything broadcasts.
    tolerance : float
        On the peak rotation, relative.
    duration : array_like, optional
        As in `respond_batch`: to the end of the motion unless given.

    Returns
    -------
    EstimatedResponse

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed.

    Notes
    -----
    The estimate covers what depends on the order: the truncation of the Taylor polynomials and
    of the times of impacts found from them, as it grows through the impacts, and, for
    tolerances below 1e-6, rounding of the input. What all orders have in common it cannot
    see. That is the model itself, a pulse taken as quintics (in the 1e-9 that it is never
    below), and the rule by which a block comes to rest, which leaves no higher bounce out.
    The tests compare it with an integrator of another kind.
    """
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    restitution = as_real("restitution", restitution)
    if duration is not None:
        duration = as_real("duration", duration)
    everything = (blocks, restitution, motion, duration)
    model = as_model(model)
    now = respond_batch(*everything, model=model, order=_MAIN)
    shape = now.complete.shape
    floor = next(least for kind, least in _FLOORS.items() if isinstance(motion, kind))
    eps = float(np.finfo(now.margin.dtype).eps)
    floor = max(floor, _ROUNDING * eps)
    found = jax.tree.map(lambda leaf: np.array(leaf).reshape(-1), now)
    order = np.full(found.complete.shape, _MAIN)
    error = np.full(found.complete.shape, np.inf)
    cheapest = np.full(found.complete.shape, ORDERS[-1])
    rounding = np.zeros(found.complete.shape)
    for other in (order for order in ORDERS if order != _MAIN):
        (open_,) = np.nonzero(error > tolerance)
        if not open_.size:
            break
        part = _part(everything, shape, open_)
        main = jax.tree.map(lambda leaf, k=open_: leaf[k], found)
        now = _run(part, model, other)
        if other == ORDERS[0] and tolerance < _DELICATE * eps:
            block, c, shaking, end = part
            slipped = block, c, shaking.scaled(1 + _ROUNDING * eps), end
            rounding[open_] = _apart(main, _run(slipped, model, _MAIN))
        differs = np.maximum(_apart(main, now), rounding[open_])
        error[open_] = np.maximum(_SAFETY * differs, floor)
        cheapest[open_] = np.where(error[open_] <= tolerance, min(other, _MAIN), ORDERS[-1])
        if other > _MAIN:
            order[open_] = other
            for leaf, new in zip(jax.tree.leaves(found), jax.tree.leaves(now), strict=True):
                leaf[open_] = new

    def shaped(leaf: np.ndarray) -> np.ndarray:
        return leaf.reshape(shape)

    return EstimatedResponse(
        jax.device_put(jax.tree.map(shaped, found)),
        shaped(order),
        shaped(error),
        shaped(cheapest),
        shaped((error <= tolerance) & found.complete),
    )


def _run(part: tuple[Any, ...], model: RockingModel, order: int) -> BatchResponse:
    """The responses of a flat part of a batch."""
    now = respond_batch(*part, model=model, order=order)
    return jax.tree.map(lambda leaf: np.broadcast_to(leaf, part[1].shape), now)


def _apart(before: BatchResponse, after: BatchResponse) -> np.ndarray:
    """By how much two responses differ, as `EstimatedResponse.error` has it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(before.peak_rotation / after.peak_rotation - 1)
    off = np.where(before.peak_rotation == after.peak_rotation, 0, off)
    off = np.where(after.overturned, 0, off)
    same = (before.overturned == after.overturned) & before.complete & after.complete
    return np.where(same, off, np.inf)


def _part(everything: tuple[Any, ...], shape: tuple[int, ...], index: Any) -> tuple[Any, ...]:
    """The arguments of some blocks of a batch, flat; samples that all share stay as they are."""
    blocks, restitution, motion, duration = everything
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
    end = None if duration is None else taken(duration)
    return jax.tree.map(taken, blocks), taken(restitution), motion, end
