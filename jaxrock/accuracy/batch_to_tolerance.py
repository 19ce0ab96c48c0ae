"""Driven motion of many blocks to a tolerance, and which of them keep it."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..dynamics import BatchResponse, respond_batch
from ..ground_motion import Motion, Record, Suite
from ..host import Printed, listed
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Booleans, Number, Reals, as_real, check, check_kind

# Tolerances on offer, by the number of bits.
TOLERANCES = {64: (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13), 32: (1e-2, 1e-3, 1e-4, 1e-5)}
_SAFETY = 1.25  # an answer is off by what a better one differs by, and by the error of that one
_LEAST = 2  # errors over `rtol`, at least: at the tightest one rounding is as large
_ROUNDING = 64  # what rounding of the input amounts to, in eps


class EstimatedResponse(Printed, eqx.Module):
    """Responses and how good they are; see `respond_within`.

    Attributes
    ----------
    response : BatchResponse
        At the tolerance of each block.
    rtol : Array
        That tolerance: a step tighter than asked for, or the tightest where that was needed.
    error : Array
        Estimated bound on the relative error of the peak rotation: the difference to a looser
        tolerance under an input that is off by rounding, and at least twice `rtol`; inf where that
        has another outcome.
    cheapest : Array
        The loosest tolerance that is good enough: cheaper, next time.
    within_tolerance : Array of bool
        Whether the error is within the tolerance. Where it is not, the response is chaotic,
        or the precision cannot deliver it.
    """

    response: BatchResponse
    rtol: Reals
    error: Reals
    cheapest: Reals
    within_tolerance: Booleans

    def __str__(self) -> str:
        return f"{self.response}\n{listed(self, rtol='', error='', within_tolerance='')}"


def respond_within(
    blocks: Block,
    restitution: Number,
    motion: Motion | Suite,
    tolerance: float,
    duration: Number | None = None,
    *,
    model: ModelLike = Nonlinear(),
) -> EstimatedResponse:
    """Response of many blocks, each at two tolerances or three, and how well these agree.

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
    The estimate covers what depends on the tolerance: the truncation of the Taylor polynomials and
    of the times of impacts found from them, and rounding of the input, as they grow through
    the impacts. It cannot see what all tolerances have in common: the model itself, and the rule
    by which a block comes to rest. The tests compare it with an integrator of another kind.
    """
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    if isinstance(motion, Suite):
        return motion.apply(
            lambda record: respond_within(
                blocks, restitution, record, tolerance, duration, model=model
            )
        )
    check_kind("blocks", blocks, Block)
    restitution = as_real("restitution", restitution)
    if duration is not None:
        duration = as_real("duration", duration)
    arguments = (blocks, restitution, motion, duration)
    model = as_model(model)
    precision = np.finfo(np.result_type(*(leaf.dtype for leaf in jax.tree.leaves(arguments))))
    levels = TOLERANCES[precision.bits]
    first = min(sum(level > tolerance for level in levels), len(levels) - 2)
    slip = 1 + _ROUNDING * float(precision.eps)
    looser = respond_batch(
        blocks, restitution, motion.scaled(slip), duration, model=model, rtol=levels[first]
    )
    main = respond_batch(*arguments, model=model, rtol=levels[first + 1])
    shape = main.complete.shape
    best, looser = (
        jax.tree.map(lambda leaf: np.array(leaf).reshape(-1), each) for each in (main, looser)
    )

    def bound(before: BatchResponse, after: BatchResponse, rtol: float) -> np.ndarray:
        # Both may be better than they were asked to be, and equally so.
        return np.maximum(_SAFETY * _difference(before, after), max(_LEAST * rtol, slip - 1))

    error = bound(looser, best, levels[first + 1])
    rtol, cheapest = (np.full(error.shape, level) for level in (levels[first + 1], levels[-1]))
    cheapest[error <= tolerance] = levels[first]
    (open_,) = np.nonzero(error > tolerance)
    if open_.size and first + 2 < len(levels):
        block, c, shaking, end = part = _part(arguments, shape, open_)
        before = _run((block, c, shaking.scaled(slip), end), model, levels[first + 1])
        after = _run(part, model, levels[-1])
        error[open_], rtol[open_] = bound(before, after, levels[-1]), levels[-1]
        cheapest[open_[error[open_] <= tolerance]] = levels[first + 1]
        for leaf, new in zip(jax.tree.leaves(best), jax.tree.leaves(after), strict=True):
            leaf[open_] = new
    result = (best, rtol, error, cheapest, (error <= tolerance) & best.complete)
    return EstimatedResponse(
        *jax.device_put(jax.tree.map(lambda leaf: leaf.reshape(shape), result))
    )


def _run(part: tuple[Any, ...], model: RockingModel, rtol: float) -> BatchResponse:
    """The responses of a flat part of a batch."""
    response = respond_batch(*part, model=model, rtol=rtol)
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
        # In place, so that what a padded record knows of its end stays.
        names = ("acceleration", "vertical", "time_step", "scale", "start")
        places = [name for name in names if getattr(motion, name) is not None]
        new = [
            (samples_taken if name in names[:2] else taken)(getattr(motion, name))
            for name in places
        ]
        motion = eqx.tree_at(lambda m: [getattr(m, name) for name in places], motion, new)
    else:
        motion = jax.tree.map(taken, motion)
    end = None if duration is None else taken(duration)
    return jax.tree.map(taken, blocks), taken(restitution), motion, end
