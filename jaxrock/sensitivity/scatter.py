"""An answer whose parameters scatter: its moments, and the probability that it is negative."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm

from ..host import Printed, listed
from .parameters import Answer, ParametricAnswer, Spread, under_scatter

_ALLOWED = 0.1  # errors of mean and standard deviation, over the standard deviation


@dataclass(frozen=True, repr=False)
class MomentEstimate(Printed):
    """Mean and standard deviation of an answer; see `propagate`.

    Attributes
    ----------
    first_order_mean, first_order_standard_deviation, mean, standard_deviation : float
        From the gradient alone, and from the gradient and the Hessian.
    shares : dict
        Of the first-order variance, by parameter.
    mean_error, standard_deviation_error, left_out : float
        Errors of `mean` and `standard_deviation` by the samples, plus two standard errors of
        that estimate, over the standard deviation; inf where a sample has no answer. Share of
        such samples.
    valid : bool
        Whether both errors are at most 0.1. Not so where the answer is too nonlinear within
        the scatter, chaotic, or ceases to exist because the block overturns.
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
    answer: Answer,
    at: Any,
    coefficients_of_variation: Spread,
    samples: int = 1000,
    seed: int = 0,
) -> MomentEstimate:
    """Mean and standard deviation of an answer under scatter, to first and second order.

    Samples show whether the second order describes the answer. Only the difference between
    the two is sampled, so that a thousand suffice.

    Parameters
    ----------
    answer, at : callable, pytree
        From a pytree of numbers to one number; the medians of these numbers.
    coefficients_of_variation : dict
        Standard deviation over mean, by name; other parameters do not scatter. They are
        independent: positive ones lognormal, a ``restitution`` or ``damping_ratio``
        logit-normal, all others normal.
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
    series = function.series(np.zeros(z.shape[1]), 2)
    (answers,) = function.series(z)
    return _estimate(tuple(coefficients_of_variation), series, z, answers)


def monte_carlo(
    answer: Answer,
    at: Any,
    coefficients_of_variation: Spread,
    samples: int = 10_000,
    seed: int = 0,
) -> np.ndarray:
    """Answers for random parameters, distributed as in `propagate`.

    Parameters
    ----------
    answer, at, coefficients_of_variation, samples, seed
        As in `propagate`, with the same errors.

    Returns
    -------
    ndarray, shape (samples,)
    """
    function, z = under_scatter(answer, at, coefficients_of_variation, samples, seed)
    return function.series(z)[0]


def _estimate(
    names: tuple[str, ...], series: Any, z: np.ndarray, answers: Any
) -> MomentEstimate:
    """Moments of a quadratic in standard normal numbers, compared with answers at some."""
    value, gradient, hessian = series
    first_variance = float((gradient**2).sum())
    variance = first_variance + 0.5 * float((hessian**2).sum())
    mean = float(value + 0.5 * np.trace(hessian))
    deviation = variance**0.5
    finite = np.isfinite(answers)
    errors = (np.inf, np.inf)
    if finite.all() and np.isfinite(mean + variance):
        quadratic = value + z @ gradient + 0.5 * np.einsum("ni,ij,nj->n", z, hessian, z)
        errors = _errors(quadratic, answers - quadratic, mean, deviation)
    shares = dict(zip(names, (gradient**2 / (first_variance or 1.0)).tolist(), strict=True))
    moments = (float(value), first_variance**0.5, mean, deviation)
    left_out = 1 - finite.mean()
    return MomentEstimate(*moments, shares, max(errors) <= _ALLOWED, *errors, float(left_out))


def _errors(
    quadratic: np.ndarray, rest: np.ndarray, mean: float, deviation: float
) -> tuple[float, float]:
    """Errors of both moments due to the rest, with two standard errors, over the deviation."""
    noise = 2 / len(rest) ** 0.5
    # The variance of the answer is that of the quadratic plus the mean of this.
    added = (2 * (quadratic - mean) + rest) * rest - rest.mean() ** 2
    corrected = max(deviation**2 + float(added.mean()), 0.0) ** 0.5
    of_mean = float(abs(rest.mean()) + noise * rest.std())
    of_deviation = abs(corrected - deviation)
    of_deviation += float(noise * added.std() / (corrected + deviation or 1.0))
    if deviation > 0:
        return of_mean / deviation, of_deviation / deviation
    # Nothing scatters, so that only rounding is allowed.
    rounding = 64 * float(np.finfo(rest.dtype).eps) * abs(mean)
    error = 0.0 if max(of_mean, of_deviation) <= rounding else np.inf
    return error, error


@dataclass(frozen=True)
class ReliabilityResult:
    """Probability that a margin is negative; see `failure_probability`.

    Attributes
    ----------
    probability, first_order_probability : float
        With the limit state as a paraboloid, and as a plane, at its most likely point.
    reliability_index : float
        beta, its distance from the medians in standard deviations, negative where these fail.
    most_likely : dict
        The parameters there, by name.
    misjudged : float
        Share of samples that the paraboloid puts on the wrong side of the limit state: but for
        the noise of sampling, no less than the error of `probability`.
    valid : bool
        Whether the search has converged, and the samples do not contradict.
    """

    probability: float
    first_order_probability: float
    reliability_index: float
    most_likely: dict[str, float]
    misjudged: float
    valid: bool

    __str__ = MomentEstimate.__str__


def failure_probability(
    margin: Answer,
    at: Any,
    coefficients_of_variation: Spread,
    samples: int = 2000,
    seed: int = 0,
) -> ReliabilityResult:
    """Probability that a smooth margin is negative, by first- and second-order reliability.

    From the point of the limit state (where the margin is 0) next to the medians, in the space
    of independent standard normal numbers, and the curvature there. Samples show whether the
    limit state has that shape.

    Parameters
    ----------
    margin, at, coefficients_of_variation, samples, seed
        As in `propagate`; the margin smooth where it passes 0, for example
        `overturning_margin`, or that of a response.

    Returns
    -------
    ReliabilityResult

    Raises
    ------
    ValueError
        As `propagate`; also if nothing scatters.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.28)
    >>> scatter = {"intensity": 0.1, "restitution": 0.05}
    >>> chance = jr.sensitivity.failure_probability(jr.overturning_margin, wall, scatter)
    >>> print(f"{chance.probability:.3f}", chance.valid)
    0.245 True
    """
    function, z = under_scatter(margin, at, coefficients_of_variation, samples, seed)
    if not any(coefficients_of_variation.values()):
        raise ValueError(
            "coefficients_of_variation must be greater than 0 for at least one number"
        )
    point, converged = _most_likely(function, np.zeros(z.shape[1]))
    _, gradient, hessian = function.series(point, 2)
    steepness = float(np.linalg.norm(gradient))
    normal = -gradient / steepness if steepness else np.zeros_like(gradient)
    beta = float(normal @ point)
    # Curvature in the tangent plane: samples fail where normal . z > beta + u . K u / 2, with
    # u the part of z in that plane.
    tangent = np.linalg.svd(normal[None])[2][1:]
    curvature = tangent @ hessian @ tangent.T / (steepness or 1.0)
    mean = 0.5 * float(np.trace(curvature))
    variance = 0.5 * float((curvature**2).sum())
    second_order = float(norm.cdf(-(beta + mean) / (1 + variance) ** 0.5))

    fails = function.series(z)[0] < 0
    u = z @ tangent.T
    judged = z @ normal > beta + 0.5 * np.einsum("ij,jk,ik->i", u, curvature, u)
    misjudged = float((fails != judged).mean())
    noise = 3 * (max(misjudged, 1 / samples) / samples) ** 0.5
    agrees = misjudged < 0.05 and bool(abs(fails.mean() - judged.mean()) < 0.01 + noise)
    parameters = np.asarray(function.parameters(jnp.asarray(point))).tolist()
    likely = dict(zip(function.names, parameters, strict=True))
    first_order = float(norm.cdf(-beta))
    valid = converged and agrees
    return ReliabilityResult(second_order, first_order, beta, likely, misjudged, valid)


def _most_likely(function: ParametricAnswer, z: np.ndarray) -> tuple[np.ndarray, bool]:
    """Find the point of the limit state next to 0 (Hasofer, Lind, Rackwitz, Fiessler).

    Each step goes to the nearest point of the tangent plane, or part of the way where a merit
    of distance and margin would not decrease. Also whether that has converged.
    """
    margin, gradient = function.series(z, 1)
    for _ in range(100):
        square = float(gradient @ gradient)
        if not np.isfinite(margin) or not 0 < square < np.inf:
            return z, False
        step = (gradient @ z - margin) / square * gradient - z
        if np.linalg.norm(step) < np.finfo(gradient.dtype).eps ** 0.5:
            return z, True
        weight = 2 * max(float(np.linalg.norm(z)) / square**0.5, 1e-3)
        merit = 0.5 * float(z @ z) + weight * abs(float(margin))
        share = 1.0
        start = z
        lower = False
        while not lower:
            z = start + share * step
            margin, gradient = function.series(z, 1)
            lower = 0.5 * float(z @ z) + weight * abs(float(margin)) < merit or share <= 1e-3
            share *= 0.5
    return z, False
