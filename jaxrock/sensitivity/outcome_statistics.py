"""Statistics of outcomes: intervals, Sobol indices, derivatives by score functions."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .distributions import find_widths

# Draws of random weights, for an interval to a hundredth of its width.
_DRAWS = 2**13
# Steps of the derivatives of a distribution's width; it is found to rounding by bisection.
_STEP = 1e-4


class SobolIndices(NamedTuple):
    """Sobol indices with standard errors; each of shape (answers, parameters)."""

    first: np.ndarray
    first_error: np.ndarray
    total: np.ndarray
    total_error: np.ndarray


def compute_interval(
    probabilities: np.ndarray, samples: int, confidence: float
) -> tuple[float, float]:
    """Compute an interval of the mean of probabilities, one under each record, or of one.

    The records are independent units; each of their probabilities is counted from
    samples. The interval contains the one of the samples as well, which all records have in
    common.
    """
    from scipy.stats import binomtest

    # Clopper-Pearson intervals are those of independent samples. Scrambled Sobol points have
    # less noise, so that the interval is wider than it need be.
    count = round(float(probabilities.mean()) * samples)
    interval = binomtest(count, samples).proportion_ci(confidence, method="exact")
    low = float(interval.low)
    high = float(interval.high)
    if probabilities.size > 1:
        tail = 0.5 * (1 - confidence)
        # An end is a quantile of the mean with random weights, to which the worst value that a
        # further record could have is added (Gaffke 2005; Learned-Miller and Thomas 2019,
        # arXiv:1905.06208). Where all are 0 or 1 it is the Clopper-Pearson interval.
        weights = np.random.default_rng(0).dirichlet(np.ones(probabilities.size + 1), _DRAWS)
        low = min(low, float(np.quantile(weights @ np.append(probabilities, 0.0), tail)))
        high = max(high, float(np.quantile(weights @ np.append(probabilities, 1.0), 1 - tail)))
    # Rounding, in weights that add up to 1 but for it.
    return max(low, 0.0), min(high, 1.0)


def compute_sobol_indices(
    first: np.ndarray, second: np.ndarray, mixed: np.ndarray
) -> SobolIndices:
    """Compute first-order and total Sobol indices of answers under records.

    Parameters
    ----------
    first, second : ndarray, shape (answers, records, samples)
        Answers at two independent samples of the parameters.
    mixed : ndarray, shape (parameters, answers, records, samples)
        Answers at the first sample, with one parameter from the second.

    Returns
    -------
    SobolIndices
        Of all parameters, and with several records of the record as the last one, which may be
        each of them with equal probability. NaN for an answer that does not vary.
    """
    from scipy.stats import sobol_indices

    answers, records, samples = first.shape
    parameters = len(mixed)
    shape = (answers, parameters + (records > 1))
    result = SobolIndices(*(np.full(shape, np.nan) for _ in range(4)))
    for k in range(answers):
        # Beside the answers under each record, their mean over the records.
        both = np.stack([_add_mean(first[k]), _add_mean(second[k])])
        exchanged = np.stack([_add_mean(of_parameter[k]) for of_parameter in mixed])
        variance = both.transpose(1, 0, 2).reshape(1 + records, -1).var(axis=1)
        # The variance of all: within the records, and of their means.
        means = both[:, 1:].mean(axis=(0, 2))
        whole = variance[1:].mean() + means.var()
        varies = variance > 0
        if not whole > 0:
            continue
        first_order = np.zeros((1 + records, parameters))
        total = np.zeros((1 + records, parameters))
        if varies.any():
            values = {
                "f_A": both[0, varies],
                "f_B": both[1, varies],
                "f_AB": exchanged[:, varies],
            }
            indices = sobol_indices(func=values, n=samples)
            # SciPy leaves out axes of length 1.
            first_order[varies] = np.reshape(indices.first_order, (-1, parameters))
            total[varies] = np.reshape(indices.total_order, (-1, parameters))
            first_order *= variance[:, None]
            total *= variance[:, None]
        # A parameter alone explains what it does to the mean over the records. Together with
        # all others, the record among them, it explains what it does under each.
        result.first[k, :parameters] = first_order[0] / whole
        result.total[k, :parameters] = total[1:].mean(axis=0) / whole
        change = exchanged - both[0]
        centred = both - means.mean()
        # What each sample adds to the variance of all.
        of_whole = 0.5 * (centred[:, 1:] ** 2).sum(axis=0).mean(axis=0)

        for i in range(parameters):
            parts = centred[1, 0] * change[i, 0]
            result.first_error[k, i] = _estimate_error(parts, of_whole, result.first[k, i])
            # All records share the same samples: average over the records first.
            parts = (0.5 * change[i, 1:] ** 2).mean(axis=0)
            result.total_error[k, i] = _estimate_error(parts, of_whole, result.total[k, i])
        if records > 1:
            result.first[k, -1] = means.var() / whole
            result.total[k, -1] = 1 - variance[0] / whole
            # Records are not drawn at random, but their means are estimated from samples.
            deviations = (both[:, 1:] - means[:, None]).sum(axis=0)
            parts = ((means - means.mean())[:, None] * deviations).mean(axis=0)
            result.first_error[k, -1] = _estimate_error(parts, of_whole, result.first[k, -1])
            parts = 0.5 * (centred[:, 0] ** 2).sum(axis=0)
            # The complement is the index of the mean over the records.
            result.total_error[k, -1] = _estimate_error(
                parts, of_whole, 1 - result.total[k, -1]
            )
    return result


def _estimate_error(parts: np.ndarray, of_whole: np.ndarray, index: float) -> float:
    """Estimate the error of an index, the mean of `parts` over the mean of `of_whole`.

    By the delta method: where few samples decide the variance, as where a block rarely
    overturns, its error is most of the error of the quotient.
    """
    return float((parts - index * of_whole).std() / parts.size**0.5 / of_whole.mean())


def _add_mean(values: np.ndarray) -> np.ndarray:
    """Put the mean over the records before the values, shape (1 + records, samples)."""
    return np.concatenate([values.mean(axis=0, keepdims=True), values])


def compute_scores(
    names: Sequence[str], medians: np.ndarray, coefficients: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute derivatives of a sample's log-density, each of shape (samples, parameters).

    With respect to the logarithm of each median, and to each coefficient of variation. The
    derivative of a mean is the mean of the product of the values and these scores, however rough
    the values are: only the density is differentiated (Rubinstein 1986; Glynn 1990,
    doi:10.1145/84537.84552).
    """
    # Lognormal or logit-normal: z = (t(x) - t(median)) / width, t the logarithm or the logit.
    # So the derivatives of the log-density are z / width with respect to t(median), and
    # (z^2 - 1) / width with respect to the width.
    width, bounded = find_widths(names, medians, coefficients)
    to_place = z / width
    to_width = (z**2 - 1) / width
    # d t(median) / d ln(median).
    stretch = np.where(bounded, 1 / np.where(bounded, 1 - medians, 1.0), 1.0)

    def differentiate_width(relative_median: float, relative_coefficient: float) -> np.ndarray:
        """Differentiate the widths by a central difference."""
        ends = [
            find_widths(
                names,
                medians * (1 + sign * relative_median),
                coefficients * (1 + sign * relative_coefficient),
            )[0]
            for sign in (-1, 1)
        ]
        return (ends[1] - ends[0]) / (2 * _STEP)

    # The width that belongs to a coefficient of variation depends on the median, too.
    to_median = to_place * stretch + to_width * differentiate_width(_STEP, 0.0)
    to_coefficient = to_width * differentiate_width(0.0, _STEP) / coefficients
    return to_median, to_coefficient


def compute_derivatives(
    values: np.ndarray, scores: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute derivatives of the mean of values (records, samples), and standard errors."""
    records, samples = values.shape
    # Scores have the mean 0: without the mean of the values there is less noise.
    centred = values - values.mean(axis=1, keepdims=True)
    of_records = centred @ scores / samples
    derivatives = of_records.mean(axis=0)
    products = centred.mean(axis=0)[:, None] * scores
    squares = products.var(axis=0) / samples
    if records > 1:
        # The samples are common to all records, which themselves are a sample.
        squares = squares + of_records.var(axis=0, ddof=1) / records
    return derivatives, squares**0.5
