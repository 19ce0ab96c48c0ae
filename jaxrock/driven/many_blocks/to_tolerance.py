"""Driven motion of many blocks to a tolerance, and which of them keep it.

Two tolerances cannot be compared where steps end at the samples of a record: both take the same
steps, and agree to the last bit. So the error of a response is estimated from *companions*, which
are less accurate simulations of the same motion. A companion changes or omits the last two terms
of every Taylor polynomial after the step has been chosen. With steps h and the radius r of
convergence of the polynomials, its truncation error is about (r / h)^2 times as large.
Its input is also perturbed by some units in the last place, to show how impacts amplify rounding.

    round   response at        first companion at   second companion at the tolerance of the
                                                    response
    ------  -----------------  -------------------  ---------------------------------------
    1       the second         the first tolerance  where the first one shows amplification,
            tolerance that is  that is tight        or its bound exceeds the tolerance, or
            tight enough       enough               the input is no record
    2       the tightest one   the tightest one     the same
    (where 1 fails)

A companion confirms a response if outcome and peak agree, and if both trajectories stay together
while the input acts: if their sums over impacts (`SimulatedBatch`) differ by little. Without the
last condition chaotic responses would be confirmed: two diverged trajectories may both overturn
by chance, or have the same peak if they diverged after it. Response and companions are one batch.

Two kinds of error remain unseen. A step whose last four terms are all small by chance may be
wrong in the response and in both companions. And rounding may decide in all three, in the same
way, whether a block comes to rest.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from ...block import Block
from ...ground_motion import Motion, Suite
from ...host import Printed, count_work, format_fields
from ...resonance import ModelLike, Nonlinear, RockingModel, as_model
from ...validation import POSITIVE, Booleans, Number, Reals, as_real, check, check_concrete
from .batch import Batch, StepControl, choose_step_tolerance
from .respond_many import (
    BatchResponse,
    SimulatedAnswer,
    SimulatedBatch,
    check_batch,
    simulate_batch,
)

# Tolerances on offer, by the number of bits.
TOLERANCES = {64: (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13), 32: (1e-2, 1e-3, 1e-4, 1e-5)}
# Safety factor on the difference between a response and a companion.
_SAFETY = 3
# Smallest error that is stated, over `rtol`: at the tightest tolerance rounding is as large.
_LEAST = 4
# Perturbation of a companion, in eps. It exceeds the effect of rounding in all steps, as
# comparisons show; in float32, where eps is coarse, hardly more than that.
_ROUNDING = {64: 256, 32: 8}
# The error of the first companion exceeds that of the response by more than this factor. Since
# (h / r)^n is about the tolerance of a step, at most 5e-5 for polynomials of order n = 9 under
# records, (r / h)^2 is at least 9; for the other orders it is at least 4.
_ERROR_RATIO = 4
# Factor on the tolerance of a step of the second companion.
_TIGHTER = 0.25
# Two trajectories stay together if their sums over impacts differ by less than this, in units of
# the contribution of the highest rotation. Sums of diverged trajectories differ by a hundred
# times as much, unless all motion after the divergence is small.
_SAME_TRAJECTORY = {64: 0.001, 32: 0.03}
# A larger difference of these sums than this, or than ten times the looser tolerance, shows that
# impacts amplify errors.
_AMPLIFICATION = 1e-6


class EstimatedResponse(Printed, eqx.Module):
    """Responses with estimates of their errors; see `respond_within`.

    Attributes
    ----------
    response : BatchResponse
        The responses, each computed at its own `rtol`.
    rtol : Array
        Tolerance `rtol` of `respond_batch` for each block, one of a few levels (1e-3, 1e-5, ...
        1e-13; 1e-2 to 1e-5 in float32): one level tighter than requested, or the tightest
        level where the first one did not suffice.
    error : Array
        Estimated bound on the relative error of the peak rotation: three times the difference
        from a less accurate simulation, and at least four times `rtol`. If there are two such
        simulations, the more accurate one is used, but the bound is at least 3/4 of the
        difference from the other one. Inf where outcomes differ or trajectories diverge.
    cheapest : Array
        The loosest `rtol` known to suffice, for later calls; the tightest level if none does.
    within_tolerance : Array of bool
        Whether the error is within the tolerance. If not, the response is chaotic, or the
        floating-point precision does not suffice.
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
    """Compute the responses of many blocks to a tolerance, and estimate the error of each.

    Parameters
    ----------
    blocks, restitution, motion, duration, model
        As in `respond_batch`, where everything broadcasts.
    tolerance : float
        Relative tolerance of the peak rotation.

    Returns
    -------
    EstimatedResponse

    Raises
    ------
    ValueError
        If an argument is not allowed.

    Notes
    -----
    Each response is compared with one or two less accurate simulations of the same motion,
    its companions, at the same tolerance or a looser one. The last two terms of their Taylor
    polynomials are omitted or changed. The input of both companions, and the restitution of
    the second one, are perturbed by 256 units in the last place (8 in float32); C = 0 becomes
    256 eps. The estimate therefore includes the truncation error of every step, errors of
    impact times, and rounding errors, all amplified by impacts. This holds also where steps
    end at every sample of a record.

    The truncation error of each step of a companion is assumed to exceed the truncation error
    of the response: by a factor of about seven where both take the same steps, and of two or
    more where the second companion takes shorter steps. Trajectories must not diverge: the
    sums of the squared impact velocities, weighted by time, must agree while the input acts.
    A response that diverges from its companions after its peak is not within tolerance, since
    a later peak may be higher.

    A test simulated random responses to records, harmonic motions and pulses. Of 15 million
    that were within tolerance, none had another outcome or an error above the tolerance. The
    safety factor was two at that time instead of three, and the real error of 22 responses
    exceeded the stated one.

    The estimate excludes errors that all tolerances have in common: errors of the model, and
    of the rule by which a block comes to rest. The tests of jaxrock compare responses with
    those of another integrator.

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
    check_concrete(batch, "tolerances follow from the answers")
    # A response has two companions at most, and few are simulated in a second round.
    with count_work("motions and their errors", 3 * math.prod(batch.shape)):
        return follow_within(batch, tolerance, as_model(model))


def follow_within(batch: Batch, tolerance: float, model: RockingModel) -> EstimatedResponse:
    """Simulate a concrete batch, as `respond_within` does once it has checked."""
    return _reach_tolerance(batch, tolerance, model)[0]


def differentiate_within(
    batch: Batch, tolerance: float, model: RockingModel, at: np.ndarray
) -> tuple[EstimatedResponse, SimulatedAnswer, SimulatedAnswer, np.ndarray]:
    """Differentiate the answer of a concrete batch along its directions; see `respond_within`.

    The derivative runs beside the response and its companions, so that its error is estimated
    as that of the response is.

    Parameters
    ----------
    batch, tolerance, model
        The batch has an answer and directions.
    at : ndarray, shape (..., parameters)
        Parameters x. An error is within the tolerance relative to the larger of the magnitudes of
        ``dy / dx`` and ``y / x``.

    Returns
    -------
    EstimatedResponse, SimulatedAnswer, SimulatedAnswer, ndarray
        The responses, the answers with their slopes, and the absolute errors of the slopes.
    """
    response, estimate = _reach_tolerance(
        batch, tolerance, model, at.reshape(-1, at.shape[-1])
    )
    results = estimate.simulated.answer, estimate.simulated.slopes, estimate.slope_error
    shaped = jax.tree.map(lambda leaf: leaf.reshape(batch.shape + leaf.shape[1:]), results)
    return response, *shaped


def _reach_tolerance(
    batch: Batch, tolerance: float, model: RockingModel, at: np.ndarray | None = None
) -> tuple[EstimatedResponse, "_Estimate"]:
    """Simulate in two rounds; the table above says which responses and companions."""
    levels = TOLERANCES[np.finfo(batch.dtype).bits]
    first = min(sum(level > tolerance for level in levels), len(levels) - 2)
    # Round 1: all blocks. Under records few of them need the second companion.
    few = batch.ground.input.intervals_end_steps
    options = tolerance, model, at
    estimate = _estimate(batch, *options, levels[first : first + 2], at_once=not few)

    # Round 2: the blocks for which round 1 fails.
    (places,) = np.nonzero(~estimate.suffices(tolerance, at))
    if places.size:
        options = tolerance, model, None if at is None else at[places]
        tightest = levels[-1], levels[-1]
        better = _estimate(batch.select(places), *options, tightest, at_once=True)
        for leaf, new in zip(jax.tree.leaves(estimate), jax.tree.leaves(better), strict=True):
            leaf[places] = new
    within_tolerance = (estimate.error <= tolerance) & estimate.simulated.response.complete
    response = estimate.simulated.response, *estimate[1:4], within_tolerance
    shaped = jax.tree.map(lambda leaf: leaf.reshape(batch.shape), response)
    return EstimatedResponse(*jax.device_put(shaped)), estimate


class _Estimate(NamedTuple):
    """Responses and their errors, as in `EstimatedResponse`; one-dimensional but for slopes."""

    simulated: SimulatedBatch
    rtol: np.ndarray
    error: np.ndarray
    cheapest: np.ndarray
    slope_error: Any  # absolute, shape (blocks, parameters), or None

    def suffices(self, tolerance: float, at: np.ndarray | None) -> np.ndarray:
        """Return whether the errors of a response and of all its slopes are within a tolerance."""
        enough = self.error <= tolerance
        if at is None:
            return enough
        allowed = tolerance * find_slope_scale(
            self.simulated.answer, self.simulated.slopes, at
        )
        # The peak of a block that overturns has no slopes.
        fine = (self.slope_error <= allowed) | np.isnan(self.simulated.answer.value)[:, None]
        return enough & fine.all(-1)


def find_slope_scale(
    answer: SimulatedAnswer, slopes: SimulatedAnswer, at: np.ndarray
) -> np.ndarray:
    """Find what errors of slopes are relative to: ``max(abs(dy / dx), abs(y / x))``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        secant = np.abs(answer.value[..., None] / at)
    return np.fmax(np.abs(slopes.value), secant)


def _estimate(
    batch: Batch,
    tolerance: float,
    model: RockingModel,
    at: np.ndarray | None,
    levels: Sequence[float],
    *,
    at_once: bool,
) -> _Estimate:
    """Simulate a batch at the second of two levels, and estimate its error by companions.

    The first companion is simulated at the first level, the second one at the second level:
    `at_once` for all blocks, or later where it is needed.
    """
    looser, rtol = levels
    dtype = batch.dtype
    slip = 1 + _ROUNDING[np.finfo(dtype).bits] * float(np.finfo(dtype).eps)
    # Of the response and both companions: tolerance of a step, factor on the input, and divisor
    # of the restitution.
    step_tolerances = (
        choose_step_tolerance(rtol, dtype),
        choose_step_tolerance(looser, dtype),
        choose_step_tolerance(rtol, dtype, _TIGHTER),
    )
    table = np.asarray([step_tolerances, (1, slip, 1 / slip), (1, 1, slip)], dtype)

    def simulate(part: Batch, *companions: int) -> list[SimulatedBatch]:
        """Simulate the response (0) or its companions (1, 2), all in one batch."""
        index = np.reshape(companions, (-1, *[1] * len(part.shape)))
        step_tolerance, factor, divisor = table[:, index]
        repeated = replace(
            part.scaled(factor),
            # C = 0 changes as well: to a motion with bounces.
            restitution=np.maximum(part.restitution / divisor, divisor - 1),
            control=StepControl(step_tolerance, index.astype(dtype)),
        )
        simulated = simulate_batch(repeated, model)
        size = math.prod(part.shape)
        axes = len(repeated.shape)
        flat = jax.tree.map(
            lambda leaf: leaf.reshape(len(companions), size, *leaf.shape[axes:]), simulated
        )
        return [_select(flat, k) for k in range(len(companions))]

    best, companion, *others = simulate(batch, 0, 1, 2) if at_once else simulate(batch, 0, 1)
    divergence = _compare_sums(companion, best)
    least = max(_LEAST * rtol, slip - 1)
    first_bound = np.maximum(_bound_error(companion, best), _LEAST * rtol)
    first_slopes = _bound_slope_errors(companion, best, least)
    estimate = _Estimate(
        simulated=best,
        rtol=np.full_like(first_bound, rtol),
        error=np.maximum(first_bound, slip - 1),
        # A response at the looser tolerance is more accurate than the first companion, too.
        cheapest=np.full_like(first_bound, looser),
        slope_error=first_slopes,
    )

    # One companion may agree by chance. So the second one is computed where errors are
    # amplified. It is more accurate, and its input is perturbed to the other side: if the
    # perturbation has cancelled the truncation error in the first companion, they add up in the
    # second. Under records both tolerances lead to the same steps, so that the errors of response
    # and companion are proportional; under other inputs they are not, and agreement by chance is
    # likelier: there the second companion is always computed.
    amplified = ~(divergence <= min(_AMPLIFICATION, 10 * looser))
    amplified |= not batch.ground.input.intervals_end_steps
    (places,) = np.nonzero(~estimate.suffices(tolerance, at) | amplified)
    if places.size:
        if at_once:
            companion = _select(others[0], places)
        else:
            (companion,) = simulate(batch.select(places), 2)
        part = _select(best, places)
        second_bound = np.maximum(_bound_error(companion, part), least)
        estimate.error[places] = np.maximum(second_bound, first_bound[places] / _ERROR_RATIO)
        if first_slopes is not None:
            second_slopes = _bound_slope_errors(companion, part, least)
            first_slopes[places] = np.maximum(
                second_slopes, first_slopes[places] / _ERROR_RATIO
            )
    estimate.cheapest[~(estimate.error <= tolerance)] = rtol
    return estimate


def _select(simulated: SimulatedBatch, index: np.ndarray | int) -> SimulatedBatch:
    return jax.tree.map(lambda leaf: leaf[index], simulated)


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
    same &= _compare_sums(worse, better) <= _SAME_TRAJECTORY[bits]
    return np.where(same, _SAFETY * difference, np.inf)


def _bound_slope_errors(worse: SimulatedBatch, better: SimulatedBatch, least: float) -> Any:
    """Bound the errors of the slopes of the better simulation by a worse one."""
    if better.slopes is None:
        return None
    slopes = better.slopes.value
    difference = _SAFETY * np.abs(worse.slopes.value - slopes)
    same = np.isfinite(_bound_error(worse, better))
    return np.where(same[:, None], np.maximum(difference, least * np.abs(slopes)), np.inf)


def _compare_sums(worse: SimulatedBatch, better: SimulatedBatch) -> np.ndarray:
    """Compute the difference of sums over impacts, in units of the contribution of the peak."""
    difference = np.abs(worse.impact_sum - better.impact_sum)
    # Where nothing moves, 0 / 1.
    return difference / np.where(better.impact_unit > 0, better.impact_unit, 1)
