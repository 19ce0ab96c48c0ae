"""Distributions of parameters that are uncertain: by median and coefficient of variation."""

import math
from collections.abc import Callable, Collection
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import expit

from ..validation import AnyArray

_Float = TypeVar("_Float", float, np.ndarray)

_BETWEEN_0_AND_1 = ("restitution", "damping_ratio")  # how the names of such parameters end


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
    """Find widths of distributions from coefficients of variation; tell which are bounded.

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


def _find_logit_width(name: str, median: float, variation: float) -> float:
    """Find the logit's standard deviation for a coefficient of variation, by quadrature."""
    must_be = f"coefficient of variation of {name} must be"
    if median >= 1:
        raise ValueError(f"{must_be} 0 at {median:g}, got {variation:g}")
    logit = abs(math.log(median) - math.log1p(-median))
    z = np.linspace(-9, 9, 1801)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()

    def compute_variation(width: _Float) -> _Float:
        # Of median e^u / (1 - median + median e^u) above the median, u = width z, in a form
        # that keeps its digits where the width is small.
        growth = np.expm1(np.multiply.outer(width, z))
        above = median * (1 - median) * growth / (1 + median * growth)
        mean = above @ weight
        return ((above - mean[..., None]) ** 2 @ weight) ** 0.5 / (median + mean)

    def bisect(condition: Callable[[float], bool], high: float) -> float:
        """Find where a condition that is true at 0 ceases to be."""
        low = 0.0
        # 60 halvings are more than the 53 bits of a number.
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if condition(middle) else (low, middle)
        return low

    # The density has one peak up to here: the equation of its extremes, logit(x) =
    # logit(median) + width^2 (2 x - 1), solved together with its derivative.
    apart = bisect(lambda u: math.sinh(u) - u <= logit, 4 + math.log1p(logit))
    tried = np.linspace(0, 2**0.5 * math.cosh(0.5 * apart), 201)
    variations = compute_variation(tried)
    # Beyond its maximum the coefficient decreases: the mean grows faster than the deviation.
    largest = int(np.argmax(variations))
    if variation > variations[largest]:
        raise ValueError(
            f"{must_be} at most {variations[largest]:.3g} at {median:g}, since with"
            f" more the density has two peaks, near 0 and near 1; got {variation:g}"
        )
    return bisect(lambda width: compute_variation(width) <= variation, float(tried[largest]))
