"""Statistics of outcomes: intervals, Sobol indices, derivatives by score functions."""

from typing import NamedTuple

import numpy as np

# Draws of random weights, for an interval to a hundredth of its width.
_DRAWS = 2**13


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
    answers, records, _ = first.shape
    shape = (answers, len(mixed) + (records > 1))
    result = SobolIndices(*(np.full(shape, np.nan) for _ in range(4)))
    for k in range(answers):
        # Beside the answers under each record, their mean over the records.
        both = np.stack([_add_mean(first[k]), _add_mean(second[k])])
        change = np.stack([_add_mean(exchanged[k]) for exchanged in mixed]) - both[0]
        means = both[:, 1:].mean(axis=(0, 2))
        centred = both - means.mean()
        # What each sample adds to the variance of all.
        whole = 0.5 * (centred[:, 1:] ** 2).sum(axis=0).mean(axis=0)
        if not whole.mean() > 0:
            continue
        # A parameter alone explains what it does to the mean over the records. Together with
        # all others, the record among them, it explains what it does under each (Saltelli et
        # al. 2010, doi:10.1016/j.cpc.2009.09.018; Jansen 1999).
        alone = [*(centred[1, 0] * change[:, 0])]
        together = [*(0.5 * change[:, 1:] ** 2).mean(axis=1)]
        if records > 1:
            # Records are not drawn at random, but their means are estimated from samples.
            deviations = (both[:, 1:] - means[:, None]).sum(axis=0)
            variances = (means - means.mean())[:, None] * deviations
            alone.append(variances.mean(axis=0) + means.var())
            # The complement is the index of the mean over the records.
            together.append(whole - 0.5 * (centred[:, 0] ** 2).sum(axis=0))
        result.first[k], result.first_error[k] = _estimate_indices(alone, whole)
        result.total[k], result.total_error[k] = _estimate_indices(together, whole)
    return result


def _estimate_indices(
    contributions: list[np.ndarray], whole: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate indices, the means of `contributions` over the mean of `whole`, and their errors.

    By the delta method: where few samples decide the variance, as where a block rarely
    overturns, its error is most of the error of the quotient.
    """
    stacked = np.stack(contributions)
    indices = stacked.mean(axis=1) / whole.mean()
    residuals = stacked - indices[:, None] * whole
    return indices, residuals.std(axis=1) / whole.size**0.5 / whole.mean()


def _add_mean(values: np.ndarray) -> np.ndarray:
    """Put the mean over the records before the values, shape (1 + records, samples)."""
    return np.concatenate([values.mean(axis=0, keepdims=True), values])


def compute_derivatives(
    values: np.ndarray, scores: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute derivatives of the mean of values (records, samples), and standard errors."""
    records, samples = values.shape
    # Scores have the mean 0: without the mean of the values there is less noise.
    centred = values - values.mean(axis=1, keepdims=True)
    record_derivatives = centred @ scores / samples
    derivatives = record_derivatives.mean(axis=0)
    products = centred.mean(axis=0)[:, None] * scores
    squares = products.var(axis=0) / samples
    if records > 1:
        # The samples are common to all records, which themselves are a sample.
        squares = squares + record_derivatives.var(axis=0, ddof=1) / records
    return derivatives, squares**0.5
