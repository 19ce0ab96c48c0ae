"""Maximum-likelihood lognormal fragility curves (Baker 2015, doi:10.1193/021113EQS025M)."""

from typing import NamedTuple

import numpy as np

# Least derivative of the probit with respect to ln(level), for a change by its standard
# deviation. A fit to counts that do not increase ends near 0, and its median would be beyond
# all levels.
_LEAST_DERIVATIVE = 1e-4


class LognormalFit(NamedTuple):
    """A fragility curve Phi(ln(level / median) / dispersion); NaN where there is none.

    Attributes
    ----------
    median : float
        Level at which the probability of exceedance is 1/2 [unit of the levels].
    dispersion : float
        Standard deviation of ln(level) [-].
    remark : str
        Why there is no curve, or that it is a step; empty otherwise.
    """

    median: float
    dispersion: float
    remark: str = ""

    def at(self, levels: np.ndarray) -> np.ndarray:
        """Evaluate the probability of exceedance at levels."""
        from scipy.special import ndtr

        if self.dispersion == 0:
            return 0.5 * (1 + np.sign(levels - self.median))
        return ndtr(np.log(levels / self.median) / self.dispersion)


def fit_lognormal(levels: np.ndarray, exceeded: np.ndarray, trials: int) -> LognormalFit:
    """Fit the maximum-likelihood lognormal fragility curve to counts of exceedance.

    Parameters
    ----------
    levels : ndarray, shape (n,)
        Increasing, greater than 0.
    exceeded : ndarray, shape (n,)
        Counts of trials that exceed, between 0 and `trials`. They need not be whole.
    trials : int
        Number of trials at each level.

    Returns
    -------
    LognormalFit
    """
    from scipy.optimize import minimize
    from scipy.special import log_ndtr

    if not exceeded.any():
        return LognormalFit(np.nan, np.nan, "never exceeded")
    if (exceeded == trials).all():
        return LognormalFit(np.nan, np.nan, "always exceeded")
    if len(levels) < 2:
        return LognormalFit(np.nan, np.nan, "one level is not enough for a curve")
    # If a level separates the counts, the likelihood has no maximum: it increases with the
    # steepness of the curve. The search would not end, so the answer is a step.
    between = np.flatnonzero((exceeded > 0) & (exceeded < trials))
    if len(between) < 2 and (np.diff(exceeded) >= 0).all():
        first = int(np.argmax(exceeded > 0))
        if not len(between):
            median = float(np.sqrt(levels[first - 1] * levels[first]))
            return LognormalFit(median, 0.0, "from none to all between two levels")
        # Any steep curve through the only level between none and all.
        if 0 < first < len(levels) - 1:
            return LognormalFit(float(levels[first]), 0.0, "from none to all around one level")
        end = "begins" if first else "ends"
        return LognormalFit(np.nan, np.nan, f"the levels end where exceedance {end}")
    # Levels of mean 0 and deviation 1: the search starts at 0 and takes steps of about 1.
    logarithms = np.log(levels)
    middle = logarithms.mean()
    width = logarithms.std()
    scaled = (logarithms - middle) / width

    def compute_negative_log_likelihood(
        parameters: np.ndarray,
    ) -> tuple[float, np.ndarray]:
        # In logarithms of the distribution function, which do not underflow far from the
        # median.
        probit = parameters[0] + parameters[1] * scaled
        above = log_ndtr(probit)
        below = log_ndtr(-probit)
        value = -(exceeded * above + (trials - exceeded) * below).sum()
        density = -0.5 * probit * probit - 0.5 * np.log(2 * np.pi)
        derivative = exceeded * np.exp(density - above) - (trials - exceeded) * np.exp(
            density - below
        )
        gradient = -np.array([derivative.sum(), (derivative * scaled).sum()])
        return value / trials, gradient / trials

    # The log-likelihood is concave in both parameters (Pratt 1981), so that where the search
    # ends does not depend on where it starts.
    search = minimize(
        compute_negative_log_likelihood, np.zeros(2), jac=True, method="BFGS", tol=1e-10
    )
    offset, derivative = search.x
    if derivative < _LEAST_DERIVATIVE:
        return LognormalFit(np.nan, np.nan, "the probability does not increase with the level")
    median = float(np.exp(middle - offset / derivative * width))
    return LognormalFit(median, float(width / derivative))
