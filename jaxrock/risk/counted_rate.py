"""Yearly rates counted from outcomes at levels, for thousands of blocks."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np

from ..block import Block
from ..driven import Batch, follow_batch
from ..ground_motion import Suite
from ..host import show_progress
from ..resonance import RockingModel
from ..validation import AnyArray

# Responses that are followed at once: so many that a batch is efficient, and so few that their
# numbers take 100 MB.
AT_ONCE = 2**18


class Counting(NamedTuple):
    """Plan of a count: levels at which outcomes are counted, and the rate each stands for.

    Attributes
    ----------
    levels : ndarray, shape (levels,)
    rates : ndarray, shape (levels,)
        Yearly rates at which the levels are exceeded [1/yr].
    weights : ndarray, shape (levels,)
        Fall of the hazard between the midpoints below and above a level; from the first level
        itself, and to 0 beyond the last [1/yr].
    """

    levels: np.ndarray
    rates: np.ndarray
    weights: np.ndarray


class CountedRate(NamedTuple):
    """Rates counted from outcomes.

    Attributes
    ----------
    rate : ndarray, shape (...)
        Mean over the records [1/yr].
    contributions : ndarray, shape (records, ...)
        The rate if each motion were like this record [1/yr].
    error : ndarray, shape (...)
        Standard error from counting at separate levels [1/yr].
    """

    rate: np.ndarray
    contributions: np.ndarray
    error: np.ndarray


def plan_counting(hazard: Callable[[AnyArray], AnyArray], levels: np.ndarray) -> Counting:
    """Plan a count at increasing levels."""
    rates = np.asarray(hazard(levels))
    if len(levels) == 1:
        return Counting(levels, rates, rates)
    # Halfway in logarithms, in which a hazard curve is straight.
    middle = np.asarray(hazard(np.sqrt(levels[1:] * levels[:-1])))
    # Where the curve is level, rounding must not make it rise.
    edges = np.minimum.accumulate(np.concatenate([rates[:1], middle, [0.0]]))
    return Counting(levels, rates, edges[:-1] - edges[1:])


# The outcome at a level stands for all levels that are nearer to it than to its neighbours. A
# window of width w between levels that are d apart is hit with probability w / d, and then
# counts as d: on average as w. So windows that are narrower than the distance between levels
# make the count less precise, and do not shift it, whatever the distance is. A rate summed over
# boundaries has less noise, since each boundary that was found is exact, but misses windows
# that no level hits; and to find boundaries takes ten times as long.
def count_rates(overturned: np.ndarray, counting: Counting) -> CountedRate:
    """Count the rates of outcomes (records, ..., levels), and average them over records."""
    records = len(overturned)
    # One after the other along the levels, so that the bits do not depend on the shape.
    contributions = np.zeros(overturned.shape[:-1])
    for k, weight in enumerate(counting.weights):
        contributions += np.where(overturned[..., k], weight, 0.0)
    rate = np.zeros(overturned.shape[1:-1])
    for of_record in contributions:
        rate += of_record / records
    # A boundary lies anywhere between two levels, uniformly in the rate of the hazard: 1 / 12
    # is the variance of that. A level alone in its window was met by chance (Poisson).
    changed = overturned[..., 1:] != overturned[..., :-1]
    steps = counting.rates[:-1] - counting.rates[1:]
    variance = (changed * steps**2 / 12).sum(axis=-1)
    lonely = changed[..., :-1] & changed[..., 1:]
    variance += (lonely * counting.weights[1:-1] ** 2).sum(axis=-1)
    error = np.sqrt(variance.sum(axis=0)) / records
    return CountedRate(rate, contributions, error)


# All samples of uncertain parameters are counted at the same levels. If their boundaries are much
# closer together than the levels, all samples have the same error; if they are spread over
# several levels, errors cancel as between independent samples. The outcomes show which is the
# case: with alternating signs for successive intervals, changes in one interval add up, and
# changes spread over many cancel. For each record, the variance of the mean of N samples is
#
#     (sum of the variances of single samples + sum of products of pairs of samples) / N^2,
#
# where the products are formed of the signed sums. In both limits their expected values are the
# covariances. Where samples are spread over about one interval, the products are larger, since
# the alternating signs do not cancel there: the error is then up to sqrt(N) / 2 times too large,
# and hardly ever too small.
def estimate_error_of_mean(overturned: np.ndarray, counting: Counting) -> np.ndarray:
    """Estimate the counting error [1/yr] of mean rates of samples, (records, ..., samples, levels).

    Without uncertainty, of a single sample, it is the `error` of `count_rates`.
    """
    records = len(overturned)
    samples = overturned.shape[-2]
    alone = (count_rates(overturned, counting).error ** 2).sum(axis=-1) * records**2
    steps = (counting.rates[:-1] - counting.rates[1:]) / 12**0.5
    windows = counting.weights[1:-1]
    shared = np.zeros(np.shape(alone))
    for place in np.ndindex(*shared.shape):
        for of_record in overturned:
            changes = np.diff(of_record[place].astype(np.int8), axis=-1)
            lonely = np.where(changes[:, 1:] != 0, changes[:, :-1], 0)
            shared[place] += _sum_products_of_pairs(changes * steps)
            shared[place] += _sum_products_of_pairs(lonely * windows)
    # Sums of products may be negative by chance; their expected values are not.
    return np.asarray(np.sqrt(alone + np.maximum(shared, 0)) / (records * samples))


def _sum_products_of_pairs(values: np.ndarray) -> float:
    """Sum the products of all pairs of different samples, of values (samples, places).

    The values of a sample are added up with alternating signs, over each stretch of places
    that has values of any sample at all of its places. Stretches that are apart are
    uncorrelated, and their products would only add noise.
    """
    occupied = values.any(axis=0)
    begins = np.flatnonzero(occupied & ~np.append(False, occupied[:-1]))
    if not begins.size:
        return 0.0
    signs = 1 - 2 * (np.arange(occupied.size) % 2)
    sums = np.add.reduceat(values * signs, begins, axis=1)
    return float((sums.sum(axis=0) ** 2 - (sums**2).sum(axis=0)).sum())


def find_outcomes(
    block: Block,
    restitution: AnyArray,
    levels: AnyArray,
    suite: Suite,
    strengths: np.ndarray,
    model: RockingModel,
) -> np.ndarray:
    """Find which blocks overturn under each record, scaled to a level: (records, blocks).

    Blocks, restitutions and levels broadcast to one axis. The records have the intensities
    `strengths`.

    Raises
    ------
    ValueError
        If a motion could not be followed.
    """
    leaves, form = jax.tree.flatten((block, restitution, levels))
    leaves = np.broadcast_arrays(*leaves)
    size = leaves[0].size
    together = max(1, AT_ONCE // len(suite))
    overturned = np.empty((len(suite), size), bool)
    for k in show_progress(range(0, size, together), "blocks"):
        part = slice(k, k + together)
        some, c, level = jax.tree.unflatten(form, [leaf[part] for leaf in leaves])
        batch = Batch.of(some, c, suite, axes=1).scaled(level / strengths[:, None])
        response = follow_batch(batch, model)
        if not np.asarray(response.complete).all():
            raise ValueError(
                "motion could not be followed to its end for every record and level"
            )
        overturned[:, part] = np.asarray(response.overturned)
    return overturned
