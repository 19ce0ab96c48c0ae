"""Scores of predicted probabilities and distributions against what was observed in tests."""

from typing import NamedTuple

import numpy as np

from ...numerics import bound_probabilities


class Reliability(NamedTuple):
    """Predicted probabilities beside observed frequencies; NaN in bins without tests.

    Attributes
    ----------
    bin_low, bin_high : ndarray, shape (bins,)
        Ends of the bins of predicted probability [-].
    predicted : ndarray, shape (bins,)
        Weighted mean of the predicted probabilities [-].
    observed : ndarray, shape (bins,)
        Weighted frequency of overturning [-].
    observed_low, observed_high : ndarray, shape (bins,)
        Clopper-Pearson interval of that frequency [-].
    tests : ndarray, shape (bins,)
        Sum of the weights [-], 0 in bins without tests.
    """

    bin_low: np.ndarray
    bin_high: np.ndarray
    predicted: np.ndarray
    observed: np.ndarray
    observed_low: np.ndarray
    observed_high: np.ndarray
    tests: np.ndarray


class DistributionComparison(NamedTuple):
    """Distance of Kolmogorov and Smirnov, and its p-value.

    Attributes
    ----------
    distance : float
        Largest difference between two distribution functions [-].
    p_value : float
        Probability of at least this distance if the predicted distribution is true [-].
    """

    distance: float
    p_value: float


def brier_score(
    probability: np.ndarray, overturned: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Compute the Brier score: the mean square of probability less outcome.

    See Brier (1950), doi:10.1175/1520-0493(1950)078<0001:VOFEIT>2.0.CO;2.

    Parameters
    ----------
    probability : ndarray, shape (..., tests)
        Predicted probabilities of overturning [-]; NaN where a test is left out, for example
        since it was fitted.
    overturned : ndarray of bool, shape (..., tests)
    weights : ndarray, shape (..., tests), optional
        Weights of the tests [-], at least 0; by default all are 1.

    Returns
    -------
    ndarray, shape (...)
        Between 0, the best, and 1 [-]; NaN where there is no test.
    """
    return _average(np.square(probability - overturned), weights)


def log_score(
    probability: np.ndarray, overturned: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Compute the logarithmic score: the mean of -ln(probability of what happened).

    See Good (1952), doi:10.1111/j.2517-6161.1952.tb00104.x. It is infinite where what happened
    had the probability 0; nothing is clipped.

    Parameters
    ----------
    probability, overturned, weights
        As in `brier_score`.

    Returns
    -------
    ndarray, shape (...)
        At least 0, the best [-]; NaN where there is no test.
    """
    with np.errstate(divide="ignore"):
        # log1p keeps the digits of small probabilities of tests that did not overturn.
        logarithm = np.where(overturned, np.log(probability), np.log1p(-probability))
    return _average(-logarithm, weights)


def accuracy(
    probability: np.ndarray, overturned: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Compute the fraction of tests whose outcome had a probability above 1/2.

    A probability of exactly 1/2 counts half.

    Parameters
    ----------
    probability, overturned, weights
        As in `brier_score`.

    Returns
    -------
    ndarray, shape (...)
        Between 0 and 1, the best [-]; NaN where there is no test.
    """
    of_outcome = np.where(overturned, probability, 1 - probability)
    # The sign of NaN is NaN: tests that are left out stay so.
    return _average(0.5 * (1 + np.sign(of_outcome - 0.5)), weights)


def _average(values: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
    """Average over the last axis, without values that are NaN or have the weight 0."""
    weights = np.broadcast_to(1.0 if weights is None else weights, values.shape)
    counted = ~np.isnan(values) & (weights > 0)
    weights = np.where(counted, weights, 0.0)
    # An infinite score of weight 0 would make the sum NaN.
    total = np.sum(weights * np.where(counted, values, 0.0), axis=-1)
    # Of a single split the sums are numbers.
    return _divide(np.asarray(total), np.asarray(weights.sum(axis=-1)))


def _divide(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Divide; NaN where the whole is 0."""
    return np.asarray(part / np.where(whole > 0, whole, np.nan))


def weight_held_out(probability: np.ndarray) -> np.ndarray:
    """Weight predictions of several splits such that each test counts once in all.

    Parameters
    ----------
    probability : ndarray, shape (splits, tests) or (tests,)
        Predicted probabilities [-]; NaN where a test was fitted.

    Returns
    -------
    ndarray, shape of `probability`
        1 over the number of splits in which the test was not fitted [-]; 0 where it was.
    """
    held_out = ~np.isnan(probability)
    # A test that was fitted in all splits has no prediction, and 0 in all.
    return held_out / np.maximum(np.atleast_2d(held_out).sum(axis=0), 1)


def compute_reliability(
    probability: np.ndarray,
    overturned: np.ndarray,
    weights: np.ndarray,
    bins: int = 10,
    confidence: float = 0.9,
) -> Reliability:
    """Compare predicted probabilities with observed frequencies, in bins of equal width.

    The interval takes the sum of weights for a number of independent tests. It is too narrow
    where tests depend on each other, as those with motions of one earthquake may.

    Parameters
    ----------
    probability : ndarray, shape (tests,) or (splits, tests)
        Predicted probabilities of overturning [-]; NaN where a test was fitted.
    overturned : ndarray of bool, shape (tests,)
    weights : ndarray, shape of `probability`
        Weights of the predictions [-], as `weight_held_out` gives them.
    bins : int
        Number of bins between 0 and 1. A probability between two bins belongs to the upper
        one, 1 to the last one.
    confidence : float
        Of the intervals, between 0 and 1.

    Returns
    -------
    Reliability
    """
    counted = ~np.isnan(probability) & (weights > 0)
    predicted = probability[counted]
    happened = np.broadcast_to(overturned, probability.shape)[counted]
    weight = weights[counted]
    # Quotients, not multiples of a width: 3/10 is the number 0.3, 3 * 0.1 is not.
    ends = np.arange(bins + 1) / bins
    places = np.minimum(np.searchsorted(ends, predicted, side="right") - 1, bins - 1)
    tests = np.bincount(places, weight, bins)
    # Summed in the same order as `tests`: equal to it, without rounding, where all overturned.
    overturnings = np.bincount(places, weight * happened, bins)
    low, high = bound_probabilities(overturnings, tests, confidence)
    filled = tests > 0
    return Reliability(
        ends[:-1],
        ends[1:],
        _divide(np.bincount(places, weight * predicted, bins), tests),
        _divide(overturnings, tests),
        np.where(filled, low, np.nan),
        np.where(filled, high, np.nan),
        tests,
    )


def compute_crps(samples: np.ndarray, weights: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """Compute the continuous ranked probability score of weighted samples.

    The integral of (F(x) - [x >= observed])^2, F being the distribution function of the
    samples; see Gneiting and Raftery (2007), doi:10.1198/016214506000001437.

    Parameters
    ----------
    samples : ndarray, shape (tests, samples)
        Predicted values, in the unit of what was observed. Those of weight 0 may be anything,
        infinite or NaN.
    weights : ndarray, shape (samples,) or (tests, samples)
        Weights of the samples [-], at least 0, of any sum above 0.
    observed : ndarray, shape (tests,)

    Returns
    -------
    ndarray, shape (tests,)
        At least 0, the best, in the unit of what was observed. NaN where nothing was observed
        (NaN) or all weights are 0, infinite where a sample with a weight is.
    """
    observed = observed[:, None]
    weights = np.broadcast_to(weights, samples.shape)
    # What was observed is one more place, of weight 0: between two neighbours (F - [..])^2 is
    # then constant. A sample of weight 0 is moved there, where it changes nothing.
    places = np.concatenate([np.where(weights > 0, samples, observed), observed], axis=-1)
    weights = np.concatenate([weights, np.zeros_like(observed)], axis=-1)
    order = np.argsort(places, axis=-1)
    places = np.take_along_axis(places, order, axis=-1)
    sums = np.cumsum(np.take_along_axis(weights, order, axis=-1), axis=-1)
    distribution = _divide(sums[:, :-1], sums[:, -1:])
    step = places[:, :-1] >= observed
    return (np.diff(places, axis=-1) * np.square(distribution - step)).sum(axis=-1)


def compare_distributions(
    samples: np.ndarray, weights: np.ndarray, observed: np.ndarray
) -> DistributionComparison:
    """Compare the distribution of observed values with the one predicted for all tests.

    The predicted distribution is the mixture of those of the tests, each test with the same
    weight. Bachmann et al. (2018), doi:10.1002/eqe.2978, compare ensembles of motions so. Where
    the prediction is true, the p-value is on the large side: observed values, one from each
    test, differ less from the mixture than independent draws of it, and for distributions with
    jumps the distance is smaller than for continuous ones (Noether 1963).

    Parameters
    ----------
    samples, weights, observed
        As in `compute_crps`, with at least one test.

    Returns
    -------
    DistributionComparison
    """
    from scipy.stats import kstwo

    tests = observed.size
    weights = np.broadcast_to(weights, samples.shape)
    jumps = weights / weights.sum(axis=-1, keepdims=True) / tests
    counted = jumps > 0
    # The difference of both functions is a sum of jumps. `ks_1samp` would take the predicted
    # one for continuous: of blocks that do not rock, whose peaks are all 0, it would see the
    # observed ones after the other, and none of them where prediction and test agree.
    values = np.concatenate([samples[counted], observed])
    steps = np.concatenate([jumps[counted], np.full(tests, -1 / tests)])
    order = np.argsort(values)
    values = values[order]
    difference = np.abs(np.cumsum(steps[order]))
    # Of values that are equal, the last one has all their jumps.
    last = np.append(values[1:] != values[:-1], True)
    distance = float(difference[last].max())
    return DistributionComparison(distance, float(kstwo.sf(distance, tests)))
