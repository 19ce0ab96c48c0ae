"""Lognormal fragility curves by maximum likelihood (Baker 2015, doi:10.1193/021113EQS025M)."""

from typing import NamedTuple

import numpy as np

# Least slope of the probit, for a change of ln(level) by its standard deviation. A fit to
# counts that do not rise ends near 0, and its median would be beyond all levels.
_LEAST_SLOPE = 1e-4


class LognormalFit(NamedTuple):
    """A curve Phi(ln(x / median) / dispersion); NaN where there is none."""

    median: float
    dispersion: float
    remark: str = ""  # a reason why there is none, or a fault of it; empty if all is well

    def at(self, levels: np.ndarray) -> np.ndarray:
        """Evaluate the curve at levels."""
        from scipy.special import ndtr

        if self.dispersion == 0:
            return 0.5 * (1 + np.sign(levels - self.median))
        return ndtr(np.log(levels / self.median) / self.dispersion)


def fit_lognormal(levels: np.ndarray, exceeded: np.ndarray, trials: int) -> LognormalFit:
    """Fit the most likely curve to counts of exceedance at levels, with `trials` at each."""
    from scipy.optimize import minimize
    from scipy.special import log_ndtr

    if not exceeded.any():
        return LognormalFit(np.nan, np.nan, "never exceeded")
    if (exceeded == trials).all():
        return LognormalFit(np.nan, np.nan, "always exceeded")
    if len(levels) < 2:
        return LognormalFit(np.nan, np.nan, "one level is not enough for a curve")
    # Data that a threshold separates have no most likely curve: the steeper, the likelier. The
    # search would not end, so these are answered by a step.
    partly = np.flatnonzero((exceeded > 0) & (exceeded < trials))
    if len(partly) < 2 and (np.diff(exceeded) >= 0).all():
        # Any steep curve through the one level between does, the likelier the steeper.
        at = int(np.argmax(exceeded > 0))
        if len(partly) and at in (0, len(levels) - 1):
            where = "begins" if at else "ends"
            return LognormalFit(np.nan, np.nan, f"the levels end where exceedance {where}")
        median = levels[at] if len(partly) else np.sqrt(levels[at - 1] * levels[at])
        where = "around one level" if len(partly) else "between two levels"
        return LognormalFit(float(median), 0.0, f"from none to all {where}")
    # Levels of mean 0 and deviation 1: the search starts at 0 and takes steps of about 1.
    x = np.log(levels)
    middle = x.mean()
    width = x.std()
    scaled = (x - middle) / width

    def minus_log_likelihood(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        # In logarithms of the distribution function, which do not underflow far from the
        # median.
        z = parameters[0] + parameters[1] * scaled
        above = log_ndtr(z)
        below = log_ndtr(-z)
        value = -(exceeded * above + (trials - exceeded) * below).sum()
        density = -0.5 * z * z - 0.5 * np.log(2 * np.pi)
        pull = exceeded * np.exp(density - above) - (trials - exceeded) * np.exp(
            density - below
        )
        return value / trials, -np.array([pull.sum(), (pull * scaled).sum()]) / trials

    # The log-likelihood is concave in both parameters (Pratt 1981), so that where the search
    # ends does not depend on where it starts.
    found = minimize(minus_log_likelihood, np.zeros(2), jac=True, method="BFGS", tol=1e-10)
    offset, slope = found.x
    if slope < _LEAST_SLOPE:
        return LognormalFit(np.nan, np.nan, "the share does not rise with the level")
    median = float(np.exp(middle - offset / slope * width))
    return LognormalFit(median, float(width / slope), "")
