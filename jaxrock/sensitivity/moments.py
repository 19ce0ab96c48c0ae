"""Mean and standard deviation of an answer whose parameters scatter."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..host import listed
from .parameters import Answer, Spread, evaluated, expansion, sampled, under_scatter

_ALLOWED = 0.1  # errors of mean and standard deviation, over the standard deviation


@dataclass(frozen=True)
class MomentEstimate:
    """Mean and standard deviation of an answer; see `propagate`.

    Attributes
    ----------
    first_order_mean, first_order_standard_deviation : float
        From the gradient alone.
    mean, standard_deviation : float
        From the gradient and the Hessian.
    shares : dict
        Of the first-order variance, by parameter.
    valid : bool
        Whether all samples have an answer, and by them both errors are at most 0.1. Not so
        where the answer is too nonlinear within the scatter, chaotic, or ceases to exist
        because the block overturns.
    mean_error, standard_deviation_error : float
        Errors of `mean` and `standard_deviation` by the samples, plus two standard errors of
        that estimate, over the standard deviation; inf where a sample has no answer.
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
        return listed(self, **dict.fromkeys(vars(self), ""))


def propagate(
    answer: Answer, at: Any, coefficients_of_variation: Spread, samples: int = 1000, seed: int = 0
) -> MomentEstimate:
    """Mean and standard deviation of an answer under scatter, to first and second order.

    Samples show whether the second order describes the answer. Only the difference between
    the two is sampled, so that a thousand suffice.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Medians.
    coefficients_of_variation : dict
        Coefficient of variation (standard deviation over mean) by name; other parameters do
        not scatter. Parameters are independent: positive ones lognormal, a ``restitution`` or
        ``damping_ratio`` logit-normal, all others normal.
    samples, seed : int
        Number of samples, and the seed that they are drawn with.

    Returns
    -------
    MomentEstimate

    Raises
    ------
    ValueError
        If a name is not one of `at`, a coefficient is negative, or that of a restitution is
        too large: not 0 at a median of 1, or such that the density has two peaks.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> scatter = {"intensity": 0.1, "restitution": 0.05}
    >>> found = jr.sensitivity.propagate(jr.rotation_ratio, wall, scatter)
    >>> print(f"{found.mean:.4f} +- {found.standard_deviation:.4f}")
    0.1311 +- 0.0419
    """
    function, z = under_scatter(answer, at, coefficients_of_variation, samples, seed)
    names, answers = tuple(coefficients_of_variation), sampled(jax.vmap, function, z)
    return _estimate(names, evaluated(expansion, function, jnp.zeros(len(names))), z, answers)


def _estimate(
    names: tuple[str, ...], expansion: tuple[Any, Any, Any], z: np.ndarray, answers: np.ndarray
) -> MomentEstimate:
    """Moments of a quadratic in standard normal numbers, compared with answers at some."""
    value, gradient, hessian = map(np.asarray, expansion)
    first_variance = float((gradient**2).sum())
    variance = first_variance + 0.5 * float((hessian**2).sum())
    mean, deviation = float(value + 0.5 * np.trace(hessian)), variance**0.5
    finite = np.isfinite(answers)
    errors = (np.inf, np.inf)
    if finite.all() and np.isfinite(mean + variance):
        quadratic = value + z @ gradient + 0.5 * np.einsum("ni,ij,nj->n", z, hessian, z)
        errors = _moment_errors(quadratic, answers - quadratic, mean, deviation)
    shares = (gradient**2 / (first_variance if first_variance else 1.0)).tolist()
    by_name, valid = dict(zip(names, shares, strict=True)), max(errors) <= _ALLOWED
    moments = float(value), first_variance**0.5, mean, deviation
    return MomentEstimate(*moments, by_name, valid, *errors, left_out=float(1 - finite.mean()))


def _moment_errors(
    quadratic: np.ndarray, remainder: np.ndarray, mean: float, deviation: float
) -> tuple[float, float]:
    """Errors of both moments due to the remainder, with two standard errors of each."""
    noise = 2 / len(remainder) ** 0.5
    # The variance of the answer is that of the quadratic plus the mean of this.
    added = (2 * (quadratic - mean) + remainder) * remainder - remainder.mean() ** 2
    corrected = max(deviation**2 + float(added.mean()), 0.0) ** 0.5
    of_mean = float(abs(remainder.mean()) + noise * remainder.std())
    of_deviation = abs(corrected - deviation)
    of_deviation += float(noise * added.std() / (corrected + deviation or 1.0))
    if deviation == 0:  # nothing scatters, so that only rounding is allowed
        rounding = 64 * float(np.finfo(remainder.dtype).eps) * abs(mean)
        error = 0.0 if max(of_mean, of_deviation) <= rounding else np.inf
        return error, error
    return of_mean / deviation, of_deviation / deviation


def monte_carlo(
    answer: Answer, at: Any, coefficients_of_variation: Spread, samples: int = 10_000, seed: int = 0
) -> np.ndarray:
    """Answers for random parameters, distributed as in `propagate`.

    Parameters
    ----------
    answer, at, coefficients_of_variation, samples, seed
        As in `propagate`.

    Returns
    -------
    ndarray, shape (samples,)

    Raises
    ------
    ValueError
        As `propagate`.
    """
    function, z = under_scatter(answer, at, coefficients_of_variation, samples, seed)
    return sampled(jax.vmap, function, z)
