"""Maximum-likelihood lognormal fragility curves (Baker 2015, doi:10.1193/021113EQS025M)."""

from typing import NamedTuple

import numpy as np

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


class BoundarySums(NamedTuple):
    """Boundaries of exceedance, and records without one, to which a curve is fitted.

    Attributes
    ----------
    below : float
        Number of records that exceed at the lowest level already. They need not be whole.
    above : float
        Number of records that do not exceed at the highest level.
    powers : ndarray, shape (3,)
        Sums over all boundaries of 1, x and x^2, where x is ln(level). A boundary at which
        exceedance ends has a minus sign.
    """

    below: float
    above: float
    powers: np.ndarray


def sum_powers(levels: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Sum signs times powers 0, 1 and 2 of ln(level) along the last axis, to shape (..., 3)."""
    logarithms = np.log(np.asarray(levels, float))
    return np.stack([(signs * logarithms**k).sum(axis=-1) for k in range(3)], axis=-1)


def fit_lognormal(sums: BoundarySums, ends: tuple[float, float]) -> LognormalFit:
    """Fit the maximum-likelihood lognormal fragility curve to boundaries of exceedance.

    Parameters
    ----------
    sums : BoundarySums
    ends : tuple of two floats
        The lowest and the highest level.

    Returns
    -------
    LognormalFit

    Notes
    -----
    A record with one boundary contributes its probability density; one that exceeds at the
    lowest level, or not at the highest one, the probability of that (Baker 2015, Equation 6).
    Survival windows make more boundaries. With the signs of `BoundarySums`, mean and variance
    are those of the counted probability as a distribution function. That lies between 0 and
    1, so that the variance is not negative although it need not increase.
    """
    below, above, (count, total, squares) = sums
    if count <= 0:
        return LognormalFit(np.nan, np.nan, _explain_missing(sums, ends))
    low, high = np.log(np.asarray(ends, float)).tolist()
    # As if the boundaries of records without one were at the ends.
    records = below + count + above
    mean = (total + below * low + above * high) / records
    squared = (squares + below * low**2 + above * high**2) / records - mean**2
    dispersion = max(squared, 0.0) ** 0.5
    if dispersion < _LEAST_DISPERSION:
        remark = "the same level under all records" if records > 1 else "a single record"
        return LognormalFit(float(np.exp(mean)), 0.0, remark)
    if below + above == 0:
        return LognormalFit(float(np.exp(mean)), float(dispersion))
    return _fit_censored(sums, (low, high), mean, dispersion)


def _explain_missing(sums: BoundarySums, ends: tuple[float, float]) -> str:
    """Explain why there is no curve where exceedance does not begin more often than it ends."""
    if not sums.below and not sums.powers.any():
        return "never exceeded"
    if not sums.above and not sums.powers.any():
        return "always exceeded"
    if ends[0] == ends[1]:
        return "one level is not enough for a curve"
    return "the probability does not increase with the level"


def _fit_censored(
    sums: BoundarySums, ends: tuple[float, float], mean: float, dispersion: float
) -> LognormalFit:
    """Fit where some records have no boundary, from a mean and a dispersion to start from."""
    from scipy.optimize import minimize
    from scipy.special import log_ndtr

    below, above, (count, total, squares) = sums
    records = below + count + above
    # Scaled to mean 0 and dispersion 1 at the start, as searches like it.
    low, high = ((end - mean) / dispersion for end in ends)
    first = (total - count * mean) / dispersion
    second = (squares - 2 * mean * total + count * mean**2) / dispersion**2

    def compute_negative_log_likelihood(
        parameters: np.ndarray,
    ) -> tuple[float, np.ndarray]:
        # By Olsen's parameters, in which the likelihood of increasing outcomes is concave:
        # the mean over the dispersion, and the inverse of the dispersion, here its logarithm.
        offset, logarithm = parameters
        inverse = np.exp(logarithm)
        at_low = inverse * low - offset
        at_high = offset - inverse * high
        log_low = log_ndtr(at_low)
        log_high = log_ndtr(at_high)
        value = (
            count * logarithm
            - 0.5 * (second * inverse**2 - 2 * first * inverse * offset + count * offset**2)
            + below * log_low
            + above * log_high
        )
        constant = 0.5 * np.log(2 * np.pi)
        of_low = below * np.exp(-0.5 * at_low**2 - constant - log_low)
        of_high = above * np.exp(-0.5 * at_high**2 - constant - log_high)
        by_offset = first * inverse - count * offset - of_low + of_high
        by_inverse = (
            count / inverse - second * inverse + first * offset + of_low * low - of_high * high
        )
        gradient = -np.array([by_offset, by_inverse * inverse])
        return -value / records, gradient / records

    limits = [(None, None), (-np.log(_LARGEST_DISPERSION), -np.log(_LEAST_DISPERSION))]
    search = minimize(
        compute_negative_log_likelihood,
        np.zeros(2),
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"ftol": 1e-15, "gtol": 1e-10},
    )
    offset, logarithm = search.x
    inverse = float(np.exp(logarithm))
    if logarithm <= limits[1][0] + 1e-9:
        return LognormalFit(np.nan, np.nan, "the probability does not increase with the level")
    median = np.exp(mean + dispersion * offset / inverse)
    return LognormalFit(float(median), float(dispersion / inverse))
