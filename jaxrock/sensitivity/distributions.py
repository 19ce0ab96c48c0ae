"""Distributions of uncertain parameters, and the numbers from which samples follow."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.special import betaincinv, betaln, digamma, ndtr, ndtri

from ..validation import Number

_BETWEEN_0_AND_1 = ("restitution", "damping_ratio")  # endings of the names of such parameters
_BITS = 30  # bits of a Sobol point, the default of SciPy


def is_between_0_and_1(name: str) -> bool:
    """Return whether a parameter has a Beta distribution."""
    return name.endswith(_BETWEEN_0_AND_1)


def draw_normal_numbers(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Draw standard normal numbers, shape (samples, dimensions), by scrambled Sobol points.

    The number of samples is a power of 2.
    """
    from scipy.stats import qmc  # which loads slowly

    if not dimensions:
        return np.empty((samples, 0))
    engine = qmc.Sobol(dimensions, bits=_BITS, rng=np.random.default_rng(seed))
    points = engine.random_base2(samples.bit_length() - 1)
    # A point stands for its cell, and is moved to its middle: at 0 the normal number would be
    # infinite.
    return ndtri(points + 0.5 ** (_BITS + 1))


def find_shape(name: str, mean: Number, variation: Number) -> tuple[Any, Any]:
    """Find both exponents of a Beta distribution from its mean and coefficient of variation.

    Raises
    ------
    ValueError
        If the mean is not between 0 and 1, or the coefficient is so large that the density has
        two peaks, at 0 and at 1.
    """
    mean, variation = np.broadcast_arrays(mean, variation)
    with np.errstate(divide="ignore"):
        total = (1 - mean) / (mean * np.square(variation)) - 1
    first = mean * total
    second = (1 - mean) * total
    invalid = (mean <= 0) | (mean >= 1) | ((first < 1) & (second < 1))
    if invalid.any():
        raise ValueError(
            f"coefficient of variation of {name} must not be {variation[invalid][0]:g} at a mean of"
            f" {mean[invalid][0]:g}: the mean must be between 0 and 1, and the density must not"
            " have two peaks"
        )
    return first, second


def compute_quantiles(
    name: str, normal: np.ndarray, value: Number, variation: Number
) -> np.ndarray:
    """Compute samples of a parameter from standard normal numbers; the shapes broadcast.

    A parameter between 0 and 1 has a Beta distribution, and the value is its mean. The
    magnitude of any other is lognormal, and the value is the median.
    """
    value, variation, normal = np.broadcast_arrays(np.asarray(value), variation, normal)
    if is_between_0_and_1(name):
        samples = np.array(value, float)
        is_uncertain = variation * value != 0
        shape = find_shape(name, value[is_uncertain], variation[is_uncertain])
        samples[is_uncertain] = betaincinv(*shape, ndtr(normal[is_uncertain]))
        return samples
    return value * np.exp(np.log1p(variation**2) ** 0.5 * normal)


def map_normal_numbers(
    names: Iterable[str], normal: np.ndarray, values: np.ndarray, variations: Iterable[float]
) -> np.ndarray:
    """Map standard normal numbers to parameters, both of shape (samples, names)."""
    columns = [*map(compute_quantiles, names, normal.T, values, variations)]
    return np.transpose(columns).reshape(normal.shape)


def expand_quantile(name: str, value: float, variation: float) -> tuple[float, ...]:
    """Return a parameter where its standard normal number is 0, and two derivatives there."""
    if not (is_between_0_and_1(name) and variation * value):
        width = np.log1p(variation**2) ** 0.5
        return (value, value * width, value * width**2)
    a, b = find_shape(name, value, variation)
    median = betaincinv(a, b, 0.5)
    # By equal probabilities, the slope is the ratio of the normal density to the Beta density.
    log_density = (a - 1) * np.log(median) + (b - 1) * np.log1p(-median) - betaln(a, b)
    slope = (2 * np.pi) ** -0.5 * np.exp(-log_density)
    return (median, slope, slope**2 * ((b - 1) / (1 - median) - (a - 1) / median))


def compute_scores(
    name: str, samples: np.ndarray, value: float, variation: float
) -> np.ndarray:
    """Compute derivatives of the log-density at samples, shape (samples,).

    The derivatives are with respect to the logarithm of the value. The derivative of a mean is
    the mean of the product of an answer and these scores, however rough the answer is: only
    the density is differentiated (Rubinstein 1986; Glynn 1990, doi:10.1145/84537.84552).
    """
    if is_between_0_and_1(name):
        a, b = find_shape(name, value, variation)
        score_a = np.log(samples) - digamma(a) + digamma(a + b)
        # A sample close to 1 may be rounded to 1.
        score_b = np.log(np.maximum(1 - samples, 2**-54)) - digamma(b) + digamma(a + b)
        # The exponents are the fractions mean and 1 - mean of their sum, which is (1 - mean) /
        # (mean variation^2) - 1.
        score_sum = value * score_a + (1 - value) * score_b
        return value * (a + b) * (score_a - score_b) - score_sum / value / variation**2
    return np.log(samples / value) / np.log1p(variation**2)
