"""Distributions of parameters that are uncertain: by median and coefficient of variation."""

import math
from collections.abc import Callable, Collection, Iterable

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import expit

from ..validation import AnyArray

_BETWEEN_0_AND_1 = ("restitution", "damping_ratio")  # how the names of such parameters end
# A standard normal distribution, for quadrature.
_NORMAL: np.ndarray = np.linspace(-9, 9, 1801)
_WEIGHT: np.ndarray = np.exp(-0.5 * _NORMAL**2)
_WEIGHT /= _WEIGHT.sum()


def quantiles(z: AnyArray, median: AnyArray, width: AnyArray, bounded: AnyArray) -> AnyArray:
    """Compute parameters at standard normal numbers, distributed as `find_widths` says.

    In NumPy where all is concrete and of NumPy.
    """
    host = all(isinstance(array, np.ndarray) for array in (z, median, width, bounded))
    library = np if host else jnp
    sigmoid = expit if host else jax.nn.sigmoid
    # Each branch is computed for all parameters, and the derivative of a branch that is not
    # taken must not be NaN: hence the 1 in place of a median that has no odds.
    odds = library.where(bounded, median / library.where(bounded, 1 - median, 1), 1.0)
    logit_normal = sigmoid(library.log(odds) + width * z)
    lognormal = median * library.exp(width * z)
    normal = median + width * abs(median) * z
    return library.where(bounded, logit_normal, library.where(median > 0, lognormal, normal))


def find_widths(
    names: Collection[str], median: np.ndarray, variation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find widths of distributions from coefficients of variation, and which are bounded.

    Parameters between 0 and 1 are logit-normal, and thus bounded. Others are lognormal where
    the median is positive, else normal. The width is the standard deviation of the logit, of
    the logarithm, or (normal) of the parameter over its median.
    """
    bounded = np.asarray([name.endswith(_BETWEEN_0_AND_1) for name in names], bool)
    for name, value in zip(names, np.atleast_1d(median), strict=True):
        if name.endswith(_BETWEEN_0_AND_1) and value < 0:
            raise ValueError(f"{name} must be at least 0 to be uncertain, got {value:g}")
    # At a median of 0, or without uncertainty, there is no logit with a width.
    bounded &= (median > 0) & (variation > 0)
    width = np.where(median > 0, np.log1p(variation**2) ** 0.5, variation)
    for k, name in enumerate(names):
        if bounded[k]:
            width[k] = _find_logit_width(name, float(median[k]), float(variation[k]))
    return width, bounded


def find_coefficients(
    names: Collection[str], medians: Iterable[float], widths: Iterable[float]
) -> np.ndarray:
    """Find the coefficients of variation that `find_widths` turns into given widths.

    Parameters
    ----------
    names : collection of str
    medians, widths : array_like, shape (names,)
        The width is the standard deviation of the logit of a ``restitution`` or
        ``damping_ratio``, else that of the logarithm; at a median that is not positive it is
        the coefficient of variation itself.

    Returns
    -------
    ndarray, shape (names,)

    Raises
    ------
    ValueError
        If a width is not finite and at least 0; if a logit is so wide that its density has two
        peaks, or that a smaller width has the same coefficient of variation.
    """
    coefficients = np.zeros(len(names))
    for k, (name, median, width) in enumerate(zip(names, medians, widths, strict=True)):
        if not 0 <= width < math.inf:
            raise ValueError(
                f"standard deviation of the logarithm or logit of {name} must be finite and at"
                f" least 0, got {width:g}"
            )
        if median <= 0:
            coefficients[k] = width
        elif width and name.endswith(_BETWEEN_0_AND_1):
            coefficients[k] = _find_logit_coefficient(name, float(median), float(width))
        else:
            coefficients[k] = math.expm1(width**2) ** 0.5
    return coefficients


def _find_logit_width(name: str, median: float, variation: float) -> float:
    """Find the logit's standard deviation for a coefficient of variation, by quadrature."""
    must_be = f"coefficient of variation of {name} must be"
    if median >= 1:
        raise ValueError(f"{must_be} 0 at a median of {median:g}, got {variation:g}")
    widest, largest = _find_widest_logit(median)
    if variation > largest:
        raise ValueError(
            f"{must_be} at most {largest:.3g} at a median of {median:g}, got {variation:g}, with"
            " which the density would have two peaks, near 0 and near 1"
        )
    return _bisect(
        lambda width: bool(_compute_logit_coefficient(median, width) <= variation), widest
    )


def _find_logit_coefficient(name: str, median: float, width: float) -> float:
    """Find the coefficient of variation for a logit's standard deviation, by quadrature."""
    must_be = f"standard deviation of the logit of {name} must be"
    if median >= 1:
        raise ValueError(f"{must_be} 0 at a median of {median:g}, got {width:g}")
    widest, largest = _find_widest_logit(median)
    # As `_find_logit_width` has it for the largest coefficient: the maximum lies between two of
    # the widths that were tried.
    widest = _bisect(
        lambda tried: bool(_compute_logit_coefficient(median, tried) <= largest), widest
    )
    if width > widest:
        raise ValueError(
            f"{must_be} at most {widest:.3g} at a median of {median:g}, got {width:g}, with which"
            " the density would have two peaks, near 0 and near 1"
        )
    return float(_compute_logit_coefficient(median, width))


def _compute_logit_coefficient(median: float, width: float | np.ndarray) -> np.ndarray:
    """Compute coefficients of variation for standard deviations of a logit, by quadrature."""
    # Of median e^u / (1 - median + median e^u) above the median, u = width z, in a form that
    # keeps its digits where the width is small.
    growth = np.expm1(np.multiply.outer(width, _NORMAL))
    above = median * (1 - median) * growth / (1 + median * growth)
    mean = above @ _WEIGHT
    return np.asarray(((above - mean[..., None]) ** 2 @ _WEIGHT) ** 0.5 / (median + mean))


def _find_widest_logit(median: float) -> tuple[float, float]:
    """Find the largest standard deviation of a logit, and the coefficient of variation there."""
    logit = abs(math.log(median) - math.log1p(-median))
    # The density has one peak up to here: the equation of its extremes, logit(x) =
    # logit(median) + width^2 (2 x - 1), solved together with its derivative.
    apart = _bisect(lambda u: math.sinh(u) - u <= logit, 4 + math.log1p(logit))
    tried = np.linspace(0, 2**0.5 * math.cosh(0.5 * apart), 201)
    coefficients = _compute_logit_coefficient(median, tried)
    # Beyond its maximum the coefficient decreases: the mean grows faster than the deviation.
    widest = float(tried[np.argmax(coefficients)])
    # Computed alone, as those that are compared with it: the last digit depends on that.
    return widest, float(_compute_logit_coefficient(median, widest))


def _bisect(condition: Callable[[float], bool], high: float) -> float:
    """Find where a condition that is true at 0 ceases to be."""
    low = 0.0
    # 60 halvings are more than the 53 bits of a number.
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if condition(middle) else (low, middle)
    return low
