"""Maximum-likelihood lognormal fragility curves (Baker 2015, doi:10.1193/021113EQS025M)."""

from typing import NamedTuple

import numpy as np

from ..validation import AnyArray
from .outcome_table import OutcomeTable

# A dispersion below the first is 0: the levels differ by rounding. One that grows beyond the
# second, times that at the start of the search, means a probability that does not increase.
_LEAST_DISPERSION = 1e-6
_LARGEST_DISPERSION = 1e4


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


def fit_boundaries(table: OutcomeTable) -> list[LognormalFit]:
    """Fit the curve of each object to all boundaries of its samples, which are the last axis."""
    _, objects, samples, _ = table.boundaries.shape
    part = 1 / (samples * table.directions)
    below = part * table.overturns_first.sum(axis=(0, 2))
    above = part * (~table.overturned[..., -1]).sum(axis=(0, 2))
    fits = []
    for k in range(objects):
        exists = np.isfinite(table.boundaries[:, k])
        weights = np.where(table.begins[:, k], part, -part)[exists]
        levels = np.asarray(table.boundaries)[:, k][exists]
        fits.append(
            fit_lognormal(levels, weights, float(below[k]), float(above[k]), table.levels)
        )
    return fits


def fit_lognormal(
    boundaries: np.ndarray, weights: np.ndarray, below: float, above: float, levels: AnyArray
) -> LognormalFit:
    """Fit the maximum-likelihood lognormal fragility curve to boundaries of exceedance.

    Parameters
    ----------
    boundaries, weights : ndarray, shape (boundaries,)
        Levels at which exceedance begins, and 1 for each, or a fraction of samples; minus that
        where exceedance ends.
    below, above : float
        Numbers of records that exceed at the lowest level already, and that do not exceed at
        the highest one. They need not be whole.
    levels : ndarray, shape (levels,)
        Those between which boundaries were located.

    Returns
    -------
    LognormalFit

    Notes
    -----
    A record with one boundary contributes its probability density; one that exceeds at the
    lowest level, or not at the highest one, the probability of that (Baker 2015, Equation 6).
    Survival windows make more boundaries. With the signs of the weights, mean and variance are
    those of the counted probability as a distribution function. That lies between 0 and 1, so
    that the variance is not negative although it need not increase.
    """
    count = weights.sum()
    if count <= 0:
        remark = "the probability does not increase with the level"
        if not boundaries.size and not (below and above):
            remark = "always exceeded" if below else "never exceeded"
        return LognormalFit(np.nan, np.nan, remark)
    low, high = np.log(np.asarray(levels, float))[[0, -1]]
    logarithms = np.log(boundaries)
    # As if the boundaries of records without one were at the outer levels.
    extended = np.append(logarithms, [low, high])
    numbers = np.append(weights, [below, above])
    mean = np.average(extended, weights=numbers)
    dispersion = max(np.average((extended - mean) ** 2, weights=numbers), 0.0) ** 0.5
    if dispersion < _LEAST_DISPERSION:
        remark = "the same level under all records" if numbers.sum() > 1 else "a single record"
        return LognormalFit(float(np.exp(mean)), 0.0, remark)
    if below + above == 0:
        return LognormalFit(float(np.exp(mean)), float(dispersion))
    # Scaled to mean 0 and dispersion 1, as searches like it.
    scaled = (extended - mean) / dispersion
    offset, logarithm = _maximize_likelihood(scaled[:-2], weights, (below, above), scaled[-2:])
    if logarithm <= 0.1 - np.log(_LARGEST_DISPERSION):
        return LognormalFit(np.nan, np.nan, "the probability does not increase with the level")
    width = dispersion * np.exp(-logarithm)
    return LognormalFit(float(np.exp(mean + width * offset)), float(width))


def _maximize_likelihood(
    located: np.ndarray, weights: np.ndarray, censored: tuple[float, float], limits: np.ndarray
) -> np.ndarray:
    """Maximize the likelihood over Olsen's parameters, of increasing outcomes concave in them.

    They are the mean over the dispersion, and the inverse of the dispersion, here its logarithm.
    """
    from scipy.optimize import minimize
    from scipy.special import log_ndtr

    def compute_negative_log_likelihood(parameters: np.ndarray) -> float:
        offset, logarithm = parameters
        inverse = np.exp(logarithm)
        inside = weights @ (logarithm - 0.5 * (inverse * located - offset) ** 2)
        below = censored[0] * log_ndtr(inverse * limits[0] - offset)
        above = censored[1] * log_ndtr(offset - inverse * limits[1])
        return -(inside + below + above)

    return minimize(
        compute_negative_log_likelihood,
        np.zeros(2),
        method="Nelder-Mead",
        bounds=[(None, None), (-np.log(_LARGEST_DISPERSION), -np.log(_LEAST_DISPERSION))],
        options={
            "xatol": 1e-8,
            "fatol": 1e-14,
            "initial_simplex": [[0, 0], [0.2, 0], [0, 0.2]],
        },
    ).x
