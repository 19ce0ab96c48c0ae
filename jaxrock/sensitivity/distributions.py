"""How uncertain numbers are distributed, by what they are."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

# What is between 0 and 1, by the end of its name.
_BOUNDED = ("restitution", "damping_ratio")


class Distributions(NamedTuple):
    """Independent numbers of a median and a coefficient of variation each.

    Attributes
    ----------
    median : Array, shape (numbers,)
    width : Array, shape (numbers,)
        Standard deviation of what is normal: of the logit of a number between 0 and 1, of
        the logarithm of a positive one; of all others over the median.
    bounded : ndarray of bool, shape (numbers,)
        Which are between 0 and 1.
    """

    median: Any
    width: Any
    bounded: np.ndarray

    @classmethod
    def of(cls, names: tuple[str, ...], median: np.ndarray, variation: np.ndarray) -> Any:
        """What realizes the coefficients of variation, standard deviation over mean."""
        bounded = np.asarray([name.endswith(_BOUNDED) for name in names], bool)
        bounded &= (median > 0) & (variation > 0)
        width = np.where(median > 0, np.log1p(variation**2) ** 0.5, variation)
        for k in np.flatnonzero(bounded):
            width[k] = _deviation_of_logit(names[k], float(median[k]), float(variation[k]))
        return cls(median, width, bounded)

    def at(self, z: Any) -> Any:
        """The numbers for independent standard normal ones, shape (numbers,)."""
        median, width, bounded = self
        odds = jnp.where(bounded, median / jnp.where(bounded, 1 - median, 1), 1.0)
        between = jax.nn.sigmoid(jnp.log(odds) + width * z)
        grown = median * jnp.exp(width * z)
        shifted = median + width * abs(median) * z
        return jnp.where(bounded, between, jnp.where(median > 0, grown, shifted))


def _deviation_of_logit(name: str, median: float, variation: float) -> float:
    if median >= 1:
        raise ValueError(f"variation of {name} must be 0 at {median:g}, got {variation:g}")
    z = np.linspace(-9, 9, 1801)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()

    def realized(width: Any) -> Any:
        growth = np.expm1(np.multiply.outer(width, z))
        above = median * (1 - median) * growth / (1 + median * growth)
        mean = above @ weight
        return ((above - mean[..., None]) ** 2 @ weight) ** 0.5 / (median + mean)

    # Two peaks have a minimum between them, where logit(x) = median + width^2 (2 x - 1).
    logit = abs(math.log(median) - math.log1p(-median))

    def has_one_peak(width: float) -> bool:
        if width**2 <= 2:
            return True
        apart = width**2 * (1 - 2 / width**2) ** 0.5 - 2 * math.acosh(width / 2**0.5)
        return apart <= logit

    widths = np.linspace(0, _last(has_one_peak, 4 + logit), 201)
    reached = realized(widths)
    most = int(np.argmax(reached))  # from where on the mean grows faster than the deviation
    if variation > reached[most]:
        raise ValueError(
            f"variation of {name} must be at most {reached[most]:.3g} at {median:g}, since with"
            f" more it has two peaks, near 0 and near 1; got {variation:g}"
        )
    return _last(lambda width: bool(realized(width) <= variation), float(widths[most]))


def _last(holds: Callable[[float], bool], end: float) -> float:
    """Up to where a condition holds that does from 0 on."""
    low, high = 0.0, end
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
