"""Lognormal fragility curves by maximum likelihood."""

from typing import Any, NamedTuple

import numpy as np

_LEVEL = 1e-4  # a slope that is none, for a change of ln(level) by its standard deviation


class LognormalFit(NamedTuple):
    """A curve Phi(ln(x / median) / dispersion); NaN where there is none."""

    median: float
    dispersion: float
    remark: str = ""  # why there is none, or what is wrong with it; empty if all is well

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
    x = np.log(levels)
    middle = x.mean()
    width = x.std()
    scaled = (x - middle) / width

    def minus_log_likelihood(parameters: Any) -> tuple[float, np.ndarray]:
        z = parameters[0] + parameters[1] * scaled
        above = log_ndtr(z)
        below = log_ndtr(-z)
        value = -(exceeded * above + (trials - exceeded) * below).sum()
        density = -0.5 * z * z - 0.5 * np.log(2 * np.pi)
        pull = exceeded * np.exp(density - above) - (trials - exceeded) * np.exp(
            density - below
        )
        return value / trials, -np.array([pull.sum(), (pull * scaled).sum()]) / trials

    # Concave in both: where it ends does not depend on the start.
    found = minimize(minus_log_likelihood, np.zeros(2), jac=True, method="BFGS", tol=1e-10)
    offset, slope = found.x
    if slope < _LEVEL:
        return LognormalFit(np.nan, np.nan, "the share does not rise with the level")
    median = float(np.exp(middle - offset / slope * width))
    return LognormalFit(median, float(width / slope), "")
