"""Driven motion of many blocks to a tolerance, and which of them keep it.

Two tolerances alone tell nothing where steps end at the samples of a record: both take the same
steps, and agree to the last bit. So the error of a response is estimated from *companions*, the
same motion computed worse. A companion changes or leaves out the last two terms of every
polynomial, once the step is chosen: what that leaves behind exceeds what the response leaves
behind by (r / h)^2, with steps h and the radius r of convergence of the polynomials. And its
numbers are off by some units in the last place, so that what impacts make of rounding shows.

    round   response at        first companion at   second companion, where the first shows
                                                    that errors grow or no record ends the
                                                    steps, at
    ------  -----------------  -------------------  ---------------------------------------
    1       the second         the first tolerance  the same as the response
            tolerance that is  that is tight
            tight enough       enough
    2       the tightest one   the one before       the same as the response
    (where 1 fails)

Two motions agree if outcome and peak do, and if they went the same way while the input acted:
if the sums over their impacts (`ImpactSum`) differ by little. Without that, chaos would be
certified: two chaotic motions overturn both by chance, and have the same peak if it was reached
before they parted.

What this cannot see: an error that a response and both companions share, as of a step whose last
four terms are all small by chance; and rounding that decides whether a block comes to rest, if it
decides in the same way three times.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from ...block import Block
from ...ground_motion import Motion, Suite
from ...host import Printed, format_fields
from ...resonance import ModelLike, Nonlinear, RockingModel, as_model
from ...validation import POSITIVE, Booleans, Number, Reals, as_real, check
from .batch import Batch
from .record_input import RecordInput
from .respond_many import (
    BatchResponse,
    SimulatedBatch,
    StepChange,
    check_batch,
    simulate_batch,
)

# Tolerances on offer, by the number of bits.
TOLERANCES = {64: (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13), 32: (1e-2, 1e-3, 1e-4, 1e-5)}
# A response is off by its difference to a companion at most, with a margin for chance.
_SAFETY = 3
_LEAST = 4  # errors over `rtol`, at least: at the tightest one rounding is as large
# By how much the numbers of a companion are off, in eps: more than what rounding amounts to over
# all steps, as comparisons show, but in float32, where a unit is coarse, not much more.
_ROUNDING = {64: 256, 32: 8}
# What the first companion is off by is more than this many times what the response is off by:
# (h / r)^n is about the tolerance of a step, at most 5e-5 for polynomials of order n = 10, as
# under records, so that (r / h)^2 is at least 7. Of other orders it is at least 4.
_LARGER = 4
# Steps of the companions. Without both terms, or with twice the first of them, so that what
# cancels in one companion adds in the other; and the second takes shorter steps where no
# sample ends them, so that a step whose last terms are small by chance shows as well.
_FIRST_CHANGE = StepChange(last_terms=(0.0, 0.0))
_SECOND_CHANGE = StepChange(tolerance=0.25, longest=0.75, last_terms=(2.0, 0.0))
# Sums over impacts of motions that went the same way differ by less than this, in units of
# what the highest rotation contributes. Those of motions that parted differ by a hundred times
# as much, unless all that came after was small.
_SAME_WAY = {64: 0.001, 32: 0.03}
# The same difference shows that errors grow, if it is more than this or than ten times the
# looser tolerance.
_GROWTH = 1e-6


class EstimatedResponse(Printed, eqx.Module):
    """Responses and how good they are; see `respond_within`.

    Attributes
    ----------
    response : BatchResponse
        At the tolerance of each block.
    rtol : Array
        That tolerance: a step tighter than asked for, or the tightest where that was needed.
    error : Array
        Estimated bound on the relative error of the peak rotation: three times the difference
        to a response that is computed worse; where two were computed, to the better one, but no
        less than a quarter of what the other one says. At least four times `rtol`, and inf where
        one of them has another outcome, or went another way.
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
    """Response of many blocks, each computed better and worse, and how well these agree.

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
    Each response is compared with one companion, or with two, at the same tolerance or a looser
    one, whose Taylor polynomials lack or change their last two terms. The input of a companion is
    off by 256 units in the last place, in float32 by 8, and so is the restitution of the second
    one. So the estimate covers the truncation of every
    step, the times of impacts found from it, and rounding, all of them as they grow through the
    impacts, also where steps end at every sample of a record.

    It assumes that each step of a companion leaves more behind than the same step of the
    response: about seven times as much where both take the same steps, twice as much or more where
    the second companion takes shorter ones. Where errors grow through impacts, two companions of
    different steps have to agree, and both have to go the same way: over all impacts while the
    input acts, squared velocities and their times sum up to the same number. Of 15 million
    random responses to records, harmonic motions and pulses that were certified none had
    another outcome or was beyond its tolerance, and the stated error, with a margin of two
    instead of three, was exceeded in 22.

    The estimate cannot see what all tolerances have in common: the model itself, and the rule by
    which a block comes to rest. The tests compare it with an integrator of another kind.

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
    """Simulate a concrete batch, as `respond_within` does once it has checked."""
    levels = TOLERANCES[np.finfo(batch.dtype).bits]
    first = min(sum(level > tolerance for level in levels), len(levels) - 2)
    # 1: all blocks.
    estimate = _estimate(batch, model, levels[first], levels[first + 1], tolerance)
    best = estimate.simulated.response
    error = estimate.error
    rtol = np.full(error.shape, levels[first + 1], batch.dtype)
    cheapest = estimate.cheapest.astype(batch.dtype)

    # 2: where that is not good enough.
    (places,) = np.nonzero(error > tolerance)
    if places.size and first + 2 < len(levels):
        part = batch.select(places)
        estimate = _estimate(part, model, levels[-2], levels[-1], tolerance)
        error[places] = estimate.error
        rtol[places] = levels[-1]
        cheapest[places] = estimate.cheapest
        better = estimate.simulated.response
        for leaf, new in zip(jax.tree.leaves(best), jax.tree.leaves(better), strict=True):
            leaf[places] = new
    result = (best, rtol, error, cheapest, (error <= tolerance) & best.complete)
    shaped = jax.tree.map(lambda leaf: leaf.reshape(batch.shape), result)
    return EstimatedResponse(*jax.device_put(shaped))


class _Estimate(NamedTuple):
    """A simulation and its error, block by block; all one-dimensional."""

    simulated: SimulatedBatch
    error: np.ndarray
    cheapest: np.ndarray  # the loosest tolerance known to be good enough, or the tighter one


def _estimate(
    batch: Batch, model: RockingModel, looser: float, rtol: float, tolerance: float
) -> _Estimate:
    """Simulate a batch at `rtol`, and estimate its error by companions there and at `looser`."""
    precision = np.finfo(batch.dtype)
    slip = 1 + _ROUNDING[precision.bits] * float(precision.eps)

    def simulate(blocks: Batch, rtol: float, *change: StepChange) -> SimulatedBatch:
        simulated = simulate_batch(blocks, model, rtol, None, *change)
        return jax.tree.map(lambda leaf: leaf.reshape(-1), simulated)

    best = simulate(batch, rtol)
    companion = simulate(batch.scaled(slip), looser, _FIRST_CHANGE)
    apart = _compare_sums(companion, best)
    first_bound = np.maximum(_bound_error(companion, best), _LEAST * rtol)
    error = np.maximum(first_bound, slip - 1)

    # One companion may agree by chance. So where errors grow a second one is asked, which is
    # better, and whose input is off to the other side: there a slip that has made up for the
    # truncation adds to it. What it says counts, but not less than the first one implies. Only
    # under records do the two tolerances take the same steps, so that what a companion leaves
    # behind is in proportion; elsewhere chance plays a larger part, and the second is always asked.
    grown = ~(apart <= min(_GROWTH, 10 * looser))
    grown |= not isinstance(batch.ground.parts[0], RecordInput)
    (places,) = np.nonzero((error > tolerance) | grown)
    if places.size:
        part = batch.select(places).scaled(1 / slip, restitution=1 / slip)
        companion = simulate(part, rtol, _SECOND_CHANGE)
        better = jax.tree.map(lambda leaf: leaf[places], best)
        least = max(_LEAST * rtol, slip - 1)
        second_bound = np.maximum(_bound_error(companion, better), least)
        error[places] = np.maximum(second_bound, first_bound[places] / _LARGER)
    # What the first companion implies, it implies for a response at the looser tolerance too.
    return _Estimate(best, error, np.where(error <= tolerance, looser, rtol))


def _bound_error(worse: SimulatedBatch, better: SimulatedBatch) -> np.ndarray:
    """Bound the relative error of the peaks of the better simulation by a worse one."""
    before = worse.response
    after = better.response
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = np.abs(before.peak_rotation / after.peak_rotation - 1)
    # Of blocks that overturn, the peak says nothing; 0 / 0 is a block that was never lifted.
    same_peak = before.peak_rotation == after.peak_rotation
    difference = np.where(same_peak | after.overturned, 0, difference)
    same = (before.overturned == after.overturned) & before.complete & after.complete
    bits = np.finfo(after.margin.dtype).bits
    same &= _compare_sums(worse, better) <= _SAME_WAY[bits]
    return np.where(same, _SAFETY * difference, np.inf)


def _compare_sums(worse: SimulatedBatch, better: SimulatedBatch) -> np.ndarray:
    """Compute the difference of sums over impacts, in units of what the peak contributes."""
    difference = np.abs(worse.impact_sum.energy - better.impact_sum.energy)
    unit = better.impact_sum.unit
    # Where nothing moves, 0 / 1.
    return difference / np.where(unit > 0, unit, 1)
