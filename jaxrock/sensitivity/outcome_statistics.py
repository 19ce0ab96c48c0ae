"""Statistics of outcomes: intervals, Sobol indices, derivatives by score functions."""

import numpy as np

# Number of draws of random weights: the interval is accurate to a hundredth of its width.
_DRAWS = 2**13
_TAIL = 0.025  # probability beyond either end of an interval


def compute_interval(probabilities: np.ndarray, samples: int) -> tuple[float, float]:
    """Compute a 95 % interval of the mean probability over records, or of a single probability.

    The records are independent; the probability under each is counted from samples. All
    records share the samples, so that the interval contains the interval by the samples alone.
    """
    from scipy.stats import binomtest

    # Clopper-Pearson intervals hold for independent samples. Scrambled Sobol points have less
    # noise, so that the interval is wider than necessary.
    count = round(float(probabilities.mean()) * samples)
    interval = binomtest(count, samples).proportion_ci(1 - 2 * _TAIL)
    low, high = interval
    if probabilities.size > 1:
        # A limit is a quantile of the mean with random weights, after the worst possible value
        # of a further record has been added (Gaffke 2005; Learned-Miller and Thomas 2019,
        # arXiv:1905.06208). If all probabilities are 0, or all are 1, this is the
        # Clopper-Pearson interval.
        weights = np.random.default_rng(0).dirichlet(np.ones(probabilities.size + 1), _DRAWS)
        low = min(low, float(np.quantile(weights @ np.append(probabilities, 0.0), _TAIL)))
        high = max(
            high, float(np.quantile(weights @ np.append(probabilities, 1.0), 1 - _TAIL))
        )
    # The sum of the weights may differ from 1 by rounding.
    return max(low, 0.0), min(high, 1.0)


def compute_sobol_indices(
    first: np.ndarray, second: np.ndarray, mixed: np.ndarray
) -> dict[str, np.ndarray]:
    """Compute first-order and total Sobol indices of answers under records.

    Parameters
    ----------
    first, second : ndarray, shape (answers, records, samples)
        Answers at two independent samples of the parameters.
    mixed : ndarray, shape (parameters, answers, records, samples)
        Answers at the first sample, with one parameter from the second.

    Returns
    -------
    dict of ndarray, shape (answers, parameters)
        ``first`` and ``total``, and their standard errors ``first_error`` and ``total_error``.
        Of all parameters, and with several records of the record as the last one, which may be
        each of them with equal probability. NaN for an answer that does not vary.
    """
    records = first.shape[1]
    # The mean over the records, followed by the answers under each record.
    first, second, mixed = (
        np.concatenate([part.mean(axis=-2, keepdims=True), part], axis=-2)
        for part in (first, second, mixed)
    )
    both = np.stack([first, second])
    change = mixed - first
    means = both[:, :, 1:].mean(axis=(0, 3))
    effects = means - means.mean(axis=1, keepdims=True)
    centred = both - means.mean(axis=1)[:, None, None]
    # The contribution of each sample to the total variance.
    whole = 0.5 * (centred[:, :, 1:] ** 2).sum(axis=0).mean(axis=1)
    # The first-order index of a parameter counts its effect on the mean over the records. The
    # total index counts its effect under each record (Saltelli et al. 2010,
    # doi:10.1016/j.cpc.2009.09.018; Jansen 1999).
    alone = [*(centred[1, :, 0] * change[:, :, 0])]
    together = [*(0.5 * change[:, :, 1:] ** 2).mean(axis=2)]
    if records > 1:
        # Records are not sampled, but the means under them are estimated from samples.
        deviations = (both[:, :, 1:] - means[..., None]).sum(axis=0)
        variances = (effects[..., None] * deviations).mean(axis=1)
        alone.append(variances + (effects**2).mean(axis=1, keepdims=True))
        # The rest of the variance belongs to the mean over the records.
        together.append(whole - 0.5 * (centred[:, :, 0] ** 2).sum(axis=0))
    return _estimate("first", alone, whole) | _estimate("total", together, whole)


def _estimate(
    name: str, contributions: list[np.ndarray], whole: np.ndarray
) -> dict[str, np.ndarray]:
    """Estimate indices, the means of `contributions` over the mean of `whole`, and their errors.

    The errors follow from the delta method: where few samples decide the variance, as when a
    block rarely overturns, the error of the variance is most of the error of the quotient.
    """
    stacked = np.stack(contributions, axis=1)
    variance = whole.mean(axis=-1)[:, None]
    variance = np.where(variance > 0, variance, np.nan)  # of an answer that does not vary
    indices = stacked.mean(axis=-1) / variance
    residuals = stacked - indices[..., None] * whole[:, None]
    errors = residuals.std(axis=-1) / whole.shape[-1] ** 0.5 / variance
    return {name: indices, f"{name}_error": errors}


def compute_derivatives(
    values: np.ndarray, scores: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute derivatives of the mean of values (records, samples), and standard errors."""
    records, samples = values.shape
    # Scores have the mean 0: subtracting the mean of the values reduces the noise.
    centred = values - values.mean(axis=1, keepdims=True)
    record_derivatives = centred @ scores / samples
    derivatives = record_derivatives.mean(axis=0)
    products = centred.mean(axis=0)[:, None] * scores
    squares = products.var(axis=0) / samples
    if records > 1:
        # All records share the samples, and the records are a sample themselves.
        squares = squares + record_derivatives.var(axis=0, ddof=1) / records
    return derivatives, squares**0.5
