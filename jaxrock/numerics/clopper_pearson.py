"""Clopper-Pearson intervals of probabilities (1934, doi:10.1093/biomet/26.4.404)."""

import numpy as np


def bound_probabilities(
    exceeded: np.ndarray, trials: int | np.ndarray, confidence: float
) -> tuple[np.ndarray, np.ndarray]:
    """Bound probabilities by Clopper-Pearson intervals.

    Parameters
    ----------
    exceeded : ndarray, shape (...)
        Counts of trials that exceed, between 0 and `trials`. They need not be whole.
    trials : int or ndarray, shape (...)
        Number of trials. It need not be whole, as the sum of weights is not.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    low, high : ndarray, shape (...)
        Limits of the probability of exceedance [-].
    """
    from scipy.special import betaincinv

    # At the ends of the counts the beta distribution degenerates: to 0 and 1.
    tail = 0.5 * (1 - confidence)
    with np.errstate(invalid="ignore"):
        low = np.where(exceeded > 0, betaincinv(exceeded, trials - exceeded + 1, tail), 0.0)
        high = np.where(
            exceeded < trials, betaincinv(exceeded + 1, trials - exceeded, 1 - tail), 1.0
        )
    return low, high
