"""Driven motion of many blocks to a tolerance, and which of them keep it."""

import equinox as eqx
import jax
import numpy as np

from ...block import Block
from ...ground_motion import Motion, Suite
from ...host import Printed, format_fields
from ...resonance import ModelLike, Nonlinear, RockingModel, as_model
from ...validation import POSITIVE, Booleans, Number, Reals, as_real, check
from .batch import Batch
from .respond_many import BatchResponse, check_batch, follow_batch

# Tolerances on offer, by the number of bits.
TOLERANCES = {64: (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13), 32: (1e-2, 1e-3, 1e-4, 1e-5)}
# An answer is off by its difference to a better one, and by the error of the better one.
_SAFETY = 1.25
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
        tolerance under an input that is off by rounding, and at least twice `rtol`; inf where
        that has another outcome.
    cheapest : Array
        The loosest tolerance known to be good enough, for the next time; the tightest where
        none is.
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
        return (
            f"{self.response}\n{format_fields(self, rtol='', error='', within_tolerance='')}"
        )


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
    The estimate covers what depends on the tolerance: the truncation of the Taylor polynomials
    and of the times of impacts found from them, and rounding of the input, as they grow
    through the impacts. It cannot see what all tolerances have in common: the model itself,
    and the rule by which a block comes to rest. The tests compare it with an integrator of
    another kind.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block, pulse = jr.Block(half_width=0.1, slenderness=5.0), jr.Sine(2.5, 0.5)
    >>> found = jr.respond_within(block, 0.9, pulse, tolerance=1e-3)
    >>> print(f"{found.response.peak_rotation:.4f} rad", bool(found.within_tolerance))
    0.0439 rad True
    """
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    restitution, duration = check_batch(blocks, restitution, motion, duration)
    batch = Batch.of(blocks, restitution, motion, duration)
    if batch.traced:
        raise ValueError("arguments must be concrete here: tolerances follow from the answers")
    return follow_within(batch, tolerance, as_model(model))


def follow_within(batch: Batch, tolerance: float, model: RockingModel) -> EstimatedResponse:
    """Follow a concrete batch, as `respond_within` does once it has checked."""
    precision = np.finfo(batch.dtype)
    levels = TOLERANCES[precision.bits]
    first = min(sum(level > tolerance for level in levels), len(levels) - 2)
    # Of two answers one is under an input that is off by rounding: what rounding does through
    # all impacts, which no tolerance mends, then counts as well.
    slip = 1 + _ROUNDING * float(precision.eps)
    shape = batch.shape

    def follow(some: Batch, rtol: float) -> BatchResponse:
        response = follow_batch(some, model, rtol)
        return jax.tree.map(lambda leaf: leaf.reshape(-1), response)

    looser = follow(batch.scaled(slip), levels[first])
    best = follow(batch, levels[first + 1])

    def bound(before: BatchResponse, after: BatchResponse, rtol: float) -> np.ndarray:
        # Both may be better than they were asked to be, and equally so.
        return np.maximum(_SAFETY * _compare(before, after), max(_LEAST * rtol, slip - 1))

    error = bound(looser, best, levels[first + 1])
    rtol = np.full(error.shape, levels[first + 1], batch.dtype)
    cheapest = np.full(error.shape, levels[-1], batch.dtype)
    cheapest[error <= tolerance] = levels[first]

    # Where these two do not agree well enough, once more at the tightest one.
    (places,) = np.nonzero(error > tolerance)
    if places.size and first + 2 < len(levels):
        part = batch.select(places)
        before = follow(part.scaled(slip), levels[first + 1])
        after = follow(part, levels[-1])
        error[places] = bound(before, after, levels[-1])
        rtol[places] = levels[-1]
        cheapest[places[error[places] <= tolerance]] = levels[first + 1]
        for leaf, new in zip(jax.tree.leaves(best), jax.tree.leaves(after), strict=True):
            leaf[places] = new
    result = (best, rtol, error, cheapest, (error <= tolerance) & best.complete)
    shaped = jax.tree.map(lambda leaf: leaf.reshape(shape), result)
    return EstimatedResponse(*jax.device_put(shaped))


def _compare(before: BatchResponse, after: BatchResponse) -> np.ndarray:
    """Compute the relative difference of two responses, as in `EstimatedResponse.error`."""
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = np.abs(before.peak_rotation / after.peak_rotation - 1)
    # Of blocks that overturn, the peak says nothing; 0 / 0 is a block that was never lifted.
    same_peak = before.peak_rotation == after.peak_rotation
    difference = np.where(same_peak | after.overturned, 0, difference)
    same = (before.overturned == after.overturned) & before.complete & after.complete
    return np.where(same, difference, np.inf)
