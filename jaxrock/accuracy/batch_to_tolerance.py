"""Driven motion of many blocks to a tolerance: each at the order that it needs."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..block import Block
from ..dynamics import BatchResponse, respond_batch
from ..ground_motion import Pulse, Record
from ..host import listed
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Number, as_real, check

ORDERS = (4, 6, 8, 10)
# The order that the others are compared with. One and the next may be off by the same, by
# chance: 4 and 6 were so twice in a thousand short pulses, so no two neighbours are compared.
_MAIN = 8
_SAFETY = 1.25  # an order is off by what a higher one differs by, and by the error of that one
# In units of eps: what rounding amounts to, as a slip of the input, and the tolerance below
# which it counts, too, after the impacts have amplified it.
_ROUNDING, _DELICATE = 64, 2**32
# The error that no order gets below: pulses are taken as quintics.
_FLOORS = {Record: 1e-12, Pulse: 1e-9}


class EstimatedResponse(eqx.Module):
    """Responses and how good they are; see `respond_within`.

    Attributes
    ----------
    response : BatchResponse
        At the order of each block.
    order : Array of int
        Of the Taylor polynomials: 8, or 10 where that was needed to keep the tolerance.
    error : Array
        Estimated bound on the relative error of the peak rotation: the difference to a lower
        order (for tolerances below 1e-6 also that due to rounding, amplified by the impacts),
        and at least 1e-9 under a pulse; inf where the other order has another outcome.
    cheapest : Array of int
        The lowest order that keeps the tolerance, too: cheaper, next time.
    within_tolerance : Array of bool
        Whether the error is within the tolerance. Where it is not, the response is chaotic,
        or the precision cannot deliver it.
    """

    response: BatchResponse
    order: Int[Array, "..."]
    error: Float[Array, "..."]
    cheapest: Int[Array, "..."]
    within_tolerance: Bool[Array, "..."]

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
    """Response of many blocks, each at two orders or more, and how well these agree.

    Parameters
    ----------
    blocks, restitution, motion, duration, model
        As in `respond_batch`, where everything broadcasts.
    tolerance : float
        On the peak rotation, relative.

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
    tolerances below 1e-6, rounding of the input. It cannot see what all orders have in common:
    the model itself, the quintics that stand for a pulse (for which the error is at least 1e-9),
    and the rule by which a block comes to rest. The tests compare it with an integrator of
    another kind.
    """
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    restitution = as_real("restitution", restitution)
    if duration is not None:
        duration = as_real("duration", duration)
    arguments = (blocks, restitution, motion, duration)
    model = as_model(model)
    main = respond_batch(*arguments, model=model, order=_MAIN)
    shape = main.complete.shape
    eps = float(np.finfo(main.margin.dtype).eps)
    floor = next(least for kind, least in _FLOORS.items() if isinstance(motion, kind))
    floor = max(floor, _ROUNDING * eps)
    best = jax.tree.map(lambda leaf: np.array(leaf).reshape(-1), main)
    order = np.full(best.complete.shape, _MAIN)
    cheapest = np.full(best.complete.shape, ORDERS[-1])
    error = np.full(best.complete.shape, np.inf)
    rounding = np.zeros(best.complete.shape)
    for other in (order for order in ORDERS if order != _MAIN):
        (open_,) = np.nonzero(error > tolerance)
        if not open_.size:
            break
        part = _part(arguments, shape, open_)
        before = jax.tree.map(lambda leaf, k=open_: leaf[k], best)
        after = _run(part, model, other)
        if other == ORDERS[0] and tolerance < _DELICATE * eps:
            block, c, shaking, end = part
            slipped = block, c, shaking.scaled(1 + _ROUNDING * eps), end
            rounding[open_] = _difference(before, _run(slipped, model, _MAIN))
        difference = np.maximum(_difference(before, after), rounding[open_])
        error[open_] = np.maximum(_SAFETY * difference, floor)
        cheapest[open_] = np.where(error[open_] <= tolerance, min(other, _MAIN), ORDERS[-1])
        if other > _MAIN:
            order[open_] = other
            for leaf, new in zip(jax.tree.leaves(best), jax.tree.leaves(after), strict=True):
                leaf[open_] = new
    result = (best, order, error, cheapest, (error <= tolerance) & best.complete)
    return EstimatedResponse(
        *jax.device_put(jax.tree.map(lambda leaf: leaf.reshape(shape), result))
    )


def _run(part: tuple[Any, ...], model: RockingModel, order: int) -> BatchResponse:
    """The responses of a flat part of a batch."""
    response = respond_batch(*part, model=model, order=order)
    return jax.tree.map(lambda leaf: np.broadcast_to(leaf, part[1].shape), response)


def _difference(before: BatchResponse, after: BatchResponse) -> np.ndarray:
    """Relative difference of two responses, as in `EstimatedResponse.error`."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(before.peak_rotation / after.peak_rotation - 1)
    off = np.where((before.peak_rotation == after.peak_rotation) | after.overturned, 0, off)
    same = (before.overturned == after.overturned) & before.complete & after.complete
    return np.where(same, off, np.inf)


def _part(arguments: tuple[Any, ...], shape: tuple[int, ...], index: Any) -> tuple[Any, ...]:
    """The arguments of some blocks of a batch, flat; samples that all share stay as they are."""
    blocks, restitution, motion, duration = arguments
    shape = shape or (1,)
    where = np.unravel_index(index, shape)

    def taken(leaf: Any) -> np.ndarray:
        return np.broadcast_to(leaf, shape)[where]

    def samples_taken(samples: Any) -> np.ndarray:
        samples = np.asarray(samples)
        if samples.ndim == 1:
            return samples
        return np.broadcast_to(samples, (*shape, samples.shape[-1]))[where]

    if isinstance(motion, Record):
        vertical = None if motion.vertical is None else samples_taken(motion.vertical)
        time_step, scale, start = map(taken, (motion.time_step, motion.scale, motion.start))
        motion = Record(samples_taken(motion.acceleration), time_step, vertical, scale, start)
    else:
        motion = jax.tree.map(taken, motion)
    end = None if duration is None else taken(duration)
    return jax.tree.map(taken, blocks), taken(restitution), motion, end
