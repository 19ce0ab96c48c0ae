"""Scores of predicted probabilities, and rules in the intensity of a motion to compare with."""

import numpy as np

from ...numerics import bound_probabilities

# Standard deviation of the Gaussian priors of intercept and coefficient, per standard deviation
# of the logarithm of the intensity. Weakly informative, as in Gelman, Jakulin, Pittau and Su
# (2008, doi:10.1214/08-AOAS191): it keeps the curve finite where outcomes are separated.
_PRIOR_DEVIATION = 5.0
# Smaller differences of logarithms are rounding of one intensity.
_LEAST_DEVIATION = 1e-9


def compute_scores(probability: np.ndarray, overturned: np.ndarray) -> dict[str, np.ndarray]:
    """Compute mean scores of predictions over tests.

    Parameters
    ----------
    probability : ndarray, shape (..., tests)
        Predicted probabilities of overturning [-]; NaN where a test is left out, since it was
        fitted.
    overturned : ndarray of bool, shape (tests,)

    Returns
    -------
    dict of ndarray, shape (...)
        ``brier``: mean square of probability less outcome (Brier 1950,
        doi:10.1175/1520-0493(1950)078<0001:VOFEIT>2.0.CO;2). ``log_score``: mean of
        -ln(probability of the observed outcome) (Good 1952,
        doi:10.1111/j.2517-6161.1952.tb00104.x), infinite where that is 0. ``accuracy``: fraction
        of outcomes with a probability above 1/2; one of exactly 1/2 counts half.
    """
    predicted = np.where(overturned, probability, 1 - probability)
    with np.errstate(divide="ignore"):
        scores = {
            "brier": (1 - predicted) ** 2,
            "log_score": -np.log(predicted),
            "accuracy": 0.5 * (1 + np.sign(predicted - 0.5)),
        }
    return {name: np.asarray(np.nanmean(values, axis=-1)) for name, values in scores.items()}


def compute_reliability(
    probability: np.ndarray, overturned: np.ndarray, confidence: float, bins: int = 10
) -> dict[str, np.ndarray]:
    """Compare predicted probabilities with observed frequencies, in bins of equal width.

    Each test counts once over all splits. The interval takes tests for independent; it is too
    narrow where they are not, as those with motions of one earthquake may be.

    Parameters
    ----------
    probability : ndarray, shape (splits, tests)
        Predicted probabilities of overturning [-]; NaN where a test was fitted.
    overturned : ndarray of bool, shape (tests,)
    confidence : float
        Of the intervals, between 0 and 1.
    bins : int
        A probability between two bins belongs to the upper one, 1 to the last one.

    Returns
    -------
    dict of ndarray, shape (bins,)
        ``predicted`` mean probability and ``observed`` frequency [-] with its Clopper-Pearson
        interval ``observed_low`` to ``observed_high``, NaN in bins without tests; number of
        ``tests``, which need not be whole.
    """
    held_out = ~np.isnan(probability)
    weights = (held_out / np.maximum(held_out.sum(axis=0), 1))[held_out]
    predicted = probability[held_out]
    happened = np.broadcast_to(overturned, probability.shape)[held_out]
    # Edges are quotients, not multiples of a width: 3 / 10 is 0.3, but 3 * 0.1 is not.
    index = np.searchsorted(np.arange(1, bins) / bins, predicted, side="right")
    tests = np.bincount(index, weights, bins)
    # Summed in the same order as `tests`, so that both are exactly equal where all overturned.
    overturnings = np.bincount(index, weights * happened, bins)
    low, high = bound_probabilities(overturnings, tests, confidence)
    divisor = np.where(tests > 0, tests, np.nan)
    return {
        "predicted": np.bincount(index, weights * predicted, bins) / divisor,
        "observed": overturnings / divisor,
        "observed_low": np.where(tests > 0, low, np.nan),
        "observed_high": np.where(tests > 0, high, np.nan),
        "tests": tests,
    }


def predict_by_intensity(
    intensity: np.ndarray, overturned: np.ndarray, fitted: np.ndarray
) -> np.ndarray:
    """Predict overturning by a logistic regression in the logarithm of an intensity.

    Of greatest posterior density, with Gaussian priors of standard deviation 5 for the
    intercept and the coefficient of the standardized logarithm. So it is finite also where an
    intensity separates the outcomes, where all are the same, and for a single test.

    Parameters
    ----------
    intensity : ndarray, shape (tests,)
        Greater than 0, in any unit.
    overturned, fitted : ndarray of bool, shape (tests,)
        Outcomes, and which of them are fitted.

    Returns
    -------
    ndarray, shape (tests,)
        Probabilities of overturning [-], of all tests.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    logarithm = np.log(intensity)
    mean = logarithm[fitted].mean()
    deviation = logarithm[fitted].std()
    scale = deviation if deviation > _LEAST_DEVIATION else 1.0
    design = np.stack([np.ones(intensity.size), (logarithm - mean) / scale], axis=-1)
    # With this sign, logits of overturning become logits of the observed outcomes.
    signed = np.where(overturned, 1.0, -1.0)[fitted, None] * design[fitted]

    def compute_loss(coefficients: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute -ln(posterior density), but for a constant, and its gradient."""
        logit = signed @ coefficients
        loss = np.logaddexp(0, -logit).sum()
        loss += 0.5 * np.square(coefficients / _PRIOR_DEVIATION).sum()
        return float(loss), coefficients / _PRIOR_DEVIATION**2 - expit(-logit) @ signed

    result = minimize(compute_loss, np.zeros(2), jac=True, options={"gtol": 1e-8})
    return expit(design @ result.x)
