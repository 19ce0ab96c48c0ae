"""Mean and standard deviation of an answer whose numbers scatter."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..host import listed
from .parameters import Answer, expanded, sampled, scattering, values_at

_ALLOWED = 0.1  # errors of mean and standard deviation, over the standard deviation


class MomentEstimate(NamedTuple):
    """Mean and standard deviation of an answer; see `propagate`.

    Attributes
    ----------
    first_order_mean, first_order_standard_deviation : float
        To first order in the scatter.
    mean, standard_deviation : float
        To second order.
    shares : dict
        Of the variance to first order, by number.
    valid : bool
        Whether `mean` is right to a tenth of the standard deviation and the latter to 10 %,
        as far as samples show, and all of them have an answer. Not so where the answer bends
        too much within the scatter, is chaotic, or ceases to exist because the block overturns.
    mean_error, standard_deviation_error : float
        Errors of `mean` and `standard_deviation` by the samples, with twice the noise of that
        estimate, over the standard deviation; inf where a sample has no answer.
    left_out : float
        Share of samples without an answer.
    """

    first_order_mean: float
    first_order_standard_deviation: float
    mean: float
    standard_deviation: float
    shares: dict[str, float]
    valid: bool
    mean_error: float
    standard_deviation_error: float
    left_out: float

    def __str__(self) -> str:
        return listed(self, **dict.fromkeys(self._fields, ""))


def propagate(
    answer: Answer,
    at: Any,
    coefficients_of_variation: Mapping[str, float],
    samples: int = 1000,
    seed: int = 0,
) -> MomentEstimate:
    """Mean and standard deviation of an answer under scatter, to first and second order.

    Samples then show whether the answer is like that. Only what it differs by from its
    second order is sampled, so that a thousand are enough.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Medians.
    coefficients_of_variation : dict
        Coefficient of variation (standard deviation over mean) by name; what is not named
        does not scatter. Numbers scatter independently: positive ones lognormally, a
        ``restitution`` or ``damping_ratio`` so that its logit is normal, all others normally.
    samples : int
        How many answers to compare with.
    seed : int
        Of the random numbers.

    Returns
    -------
    MomentEstimate
        `valid` is False where the orders are not to be trusted.

    Raises
    ------
    ValueError
        If a name is not one of `at`, or a coefficient is negative, or a restitution cannot
        scatter so much: at 1, or so that it would have two peaks, near 0 and near 1.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> scatter = {"intensity": 0.1, "restitution": 0.05}
    >>> found = jr.sensitivity.propagate(jr.rotation_ratio, wall, scatter)
    >>> print(f"{found.mean:.4f} +- {found.standard_deviation:.4f}")
    0.1311 +- 0.0419
    """
    asked, _, _ = scattering(answer, at, coefficients_of_variation)
    drawn = np.random.default_rng(seed).standard_normal((samples, len(coefficients_of_variation)))
    value, slope, curvature = map(
        np.asarray, expanded(asked, jnp.zeros(len(coefficients_of_variation)))
    )
    found = sampled(values_at, asked, drawn)
    return _compared(tuple(coefficients_of_variation), value, slope, curvature, drawn, found)


def _compared(
    names: tuple[str, ...],
    value: Any,
    slope: np.ndarray,
    curvature: np.ndarray,
    drawn: np.ndarray,
    found: np.ndarray,
) -> MomentEstimate:
    """Moments of a quadratic in standard normal numbers, and how samples differ from them."""
    variance = float((slope**2).sum())
    second = variance + 0.5 * float((curvature**2).sum())
    mean, deviation = float(value + 0.5 * np.trace(curvature)), second**0.5
    known = np.isfinite(found)
    errors = (np.inf, np.inf)
    if known.all() and np.isfinite(mean + second):
        bent = 0.5 * np.einsum("ni,ij,nj->n", drawn, curvature, drawn)
        expected = value + drawn @ slope + bent
        errors = _moment_errors(expected, found - expected, mean, deviation)
    shares = slope**2 / (variance if variance else 1.0)
    return MomentEstimate(
        float(value),
        variance**0.5,
        mean,
        deviation,
        dict(zip(names, shares.tolist(), strict=True)),
        max(errors) <= _ALLOWED,
        *errors,
        float(1 - known.mean()),
    )


def _moment_errors(
    expected: np.ndarray, rest: np.ndarray, mean: float, deviation: float
) -> tuple[float, float]:
    """What mean and deviation are off by because of the rest, with twice the noise of that."""
    noise = 2 / len(rest) ** 0.5
    rounding = 64 * float(np.finfo(rest.dtype).eps) * abs(mean)
    # The variance of the answer is that of what is expected and the mean of this.
    added = (2 * (expected - mean) + rest) * rest - rest.mean() ** 2
    spread = max(deviation**2 + float(added.mean()), 0.0) ** 0.5
    of_mean = float(abs(rest.mean()) + noise * rest.std())
    of_deviation = abs(spread - deviation)
    of_deviation += float(noise * added.std() / (spread + deviation or 1.0))
    if deviation == 0:
        least = 0.0 if max(of_mean, of_deviation) <= rounding else np.inf
        return least, least
    return of_mean / deviation, of_deviation / deviation


def monte_carlo(
    answer: Answer,
    at: Any,
    coefficients_of_variation: Mapping[str, float],
    samples: int = 10_000,
    seed: int = 0,
) -> np.ndarray:
    """Answers for random samples of what scatters, as `propagate` has it scatter.

    Parameters
    ----------
    answer, at, coefficients_of_variation
        As in `propagate`.
    samples : int
        How many.
    seed : int
        Of the random numbers.

    Returns
    -------
    ndarray, shape (samples,)

    Raises
    ------
    ValueError
        As `propagate`.
    """
    asked, _, _ = scattering(answer, at, coefficients_of_variation)
    z = np.random.default_rng(seed).standard_normal((samples, len(coefficients_of_variation)))
    return sampled(values_at, asked, z)
