"""Distributions of uncertain parameters, chosen by what the parameters are."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

_BETWEEN_0_AND_1 = ("restitution", "damping_ratio")  # how the names of such parameters end


class Distributions(eqx.Module):
    """Independent distributions of given medians and coefficients of variation.

    Logit-normal for `bounded` parameters between 0 and 1, lognormal for other positive ones,
    normal for the rest. `width` is the standard deviation of the logit, of the logarithm, or
    (normal) of the parameter over its median.
    """

    median: Array | np.ndarray  # (parameters,)
    width: Array | np.ndarray
    bounded: Array | np.ndarray

    @classmethod
    def of(
        cls, names: tuple[str, ...], median: np.ndarray, variation: np.ndarray
    ) -> "Distributions":
        """Those whose standard deviation over their mean is `variation`."""
        bounded = np.asarray([name.endswith(_BETWEEN_0_AND_1) for name in names], bool)
        bounded &= (median > 0) & (variation > 0)
        width = np.where(median > 0, np.log1p(variation**2) ** 0.5, variation)
        for k in np.flatnonzero(bounded):
            width[k] = _logit_width(names[k], float(median[k]), float(variation[k]))
        return cls(median, width, bounded)

    def quantiles(self, z: Array) -> Array:
        """The parameters at standard normal numbers, shape (parameters,)."""
        median, width, bounded = self.median, self.width, self.bounded
        odds = jnp.where(bounded, median / jnp.where(bounded, 1 - median, 1), 1.0)
        logit_normal = jax.nn.sigmoid(jnp.log(odds) + width * z)
        lognormal = median * jnp.exp(width * z)
        normal = median + width * abs(median) * z
        return jnp.where(bounded, logit_normal, jnp.where(median > 0, lognormal, normal))


def _logit_width(name: str, median: float, variation: float) -> float:
    """Standard deviation of the logit that gives a coefficient of variation, by quadrature."""
    must_be = f"coefficient of variation of {name} must be"
    if median >= 1:
        raise ValueError(f"{must_be} 0 at {median:g}, got {variation:g}")
    z = np.linspace(-9, 9, 1801)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()

    def realized(width: Any) -> Any:
        growth = np.expm1(np.multiply.outer(width, z))
        above = median * (1 - median) * growth / (1 + median * growth)
        mean = above @ weight
        return ((above - mean[..., None]) ** 2 @ weight) ** 0.5 / (median + mean)

    logit = abs(math.log(median) - math.log1p(-median))

    def has_one_peak(width: float) -> bool:
        # Two peaks have a minimum between them, where logit(x) = median + width^2 (2 x - 1).
        if width**2 <= 2:
            return True
        apart = width**2 * (1 - 2 / width**2) ** 0.5 - 2 * math.acosh(width / 2**0.5)
        return apart <= logit

    widths = np.linspace(0, _last(has_one_peak, 4 + logit), 201)
    variations = realized(widths)
    # Beyond its maximum the coefficient decreases: the mean grows faster than the deviation.
    largest = int(np.argmax(variations))
    if variation > variations[largest]:
        raise ValueError(
            f"{must_be} at most {variations[largest]:.3g} at {median:g}, since with"
            f" more the density has two peaks, near 0 and near 1; got {variation:g}"
        )
    return _last(lambda width: bool(realized(width) <= variation), float(widths[largest]))


def _last(condition: Callable[[float], bool], end: float) -> float:
    """Where a condition that is true at 0 becomes false, or `end`, by bisection."""
    low, high = 0.0, end
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if condition(middle) else (low, middle)
    return low
