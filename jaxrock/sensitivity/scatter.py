"""An answer whose parameters scatter: its moments, and the probability that it is negative."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm

from ..host import Printed, Status, format_fields
from ..validation import as_text
from .parameters import Answer, ParametricAnswer, Spread, sample_scatter

# Largest errors of mean and standard deviation, over the standard deviation, with which an
# estimate counts as within tolerance.
_ALLOWED = 0.1


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
    within_tolerance : bool
        Whether both errors are at most 0.1. Not so where the answer is too nonlinear within
        the scatter, chaotic, or ceases to exist because the block overturns.
    """

    first_order_mean: float
    first_order_standard_deviation: float
    mean: float
    standard_deviation: float
    shares: dict[str, float]
    within_tolerance: bool
    mean_error: float
    standard_deviation_error: float
    left_out: float

    def __str__(self) -> str:
        return format_fields(self, **dict.fromkeys(vars(self), ""))


def propagate(
    answer: Answer,
    at: Any,
    coefficients_of_variation: Spread,
    samples: int = 1000,
    seed: int = 0,
) -> MomentEstimate:
    """Estimate mean and standard deviation of an answer under scatter, to second order.

    Samples show whether the second order describes the answer. Only the difference between
    the two is sampled, so that a thousand suffice.

    Parameters
    ----------
    answer, at : callable, pytree
        From a pytree of numbers to one number; the medians of these numbers.
    coefficients_of_variation : dict
        Standard deviation over mean, by name; other parameters do not scatter. Of a `Block`
        the names are those of its fields, or ``width`` (at this height) and ``height`` (at
        this width). They are independent: positive ones lognormal, a ``restitution`` or
        ``damping_ratio`` logit-normal, all others normal.
    samples, seed : int
        Number of samples, and the seed that they are drawn with.

    Returns
    -------
    MomentEstimate

    Raises
    ------
    ValueError
        If a name is not one of `at`; if a coefficient is negative; if the coefficient of a
        restitution is too large: not 0 at a median of 1, or such that the density has two
        peaks.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> scatter = {"intensity": 0.1, "restitution": 0.05}
    >>> found = jr.sensitivity.propagate(jr.rotation_ratio, wall, scatter)
    >>> print(f"{found.mean:.4f} +- {found.standard_deviation:.4f}")
    0.1311 +- 0.0419
    """
    function, z = sample_scatter(answer, at, coefficients_of_variation, samples, seed)
    series = function.evaluate(np.zeros(z.shape[1]), 2)
    (answers,) = function.evaluate(z)
    return _estimate_moments(
        tuple(map(as_text, coefficients_of_variation)), series, z, answers
    )


def monte_carlo(
    answer: Answer,
    at: Any,
    coefficients_of_variation: Spread,
    samples: int = 10_000,
    seed: int = 0,
) -> np.ndarray:
    """Compute answers for random parameters, distributed as in `propagate`.

    Parameters
    ----------
    answer, at, coefficients_of_variation, samples, seed
        As in `propagate`, with the same errors.

    Returns
    -------
    ndarray, shape (samples,)
    """
    function, z = sample_scatter(answer, at, coefficients_of_variation, samples, seed)
    return function.evaluate(z)[0]


def _estimate_moments(
    names: tuple[str, ...],
    series: Sequence[np.ndarray],
    z: np.ndarray,
    answers: np.ndarray,
) -> MomentEstimate:
    """Compute the moments of a quadratic in normal numbers, and compare it with answers."""
    # For y + g . z + z . H z / 2 of independent standard normal z the mean is y + tr(H) / 2,
    # the variance g . g + tr(H H) / 2.
    value, gradient, hessian = series
    first_variance = float((gradient**2).sum())
    variance = first_variance + 0.5 * float((hessian**2).sum())
    mean = float(value + 0.5 * np.trace(hessian))
    deviation = variance**0.5
    # One sample without an answer, and the moments that are asked for do not exist.
    finite = np.isfinite(answers)
    errors = (np.inf, np.inf)
    if finite.all() and np.isfinite(mean + variance):
        quadratic = value + z @ gradient + 0.5 * np.einsum("ni,ij,nj->n", z, hessian, z)
        errors = _estimate_errors(quadratic, answers - quadratic, mean, deviation)
    shares = dict(zip(names, (gradient**2 / (first_variance or 1.0)).tolist(), strict=True))
    moments = (float(value), first_variance**0.5, mean, deviation)
    left_out = 1 - finite.mean()
    return MomentEstimate(*moments, shares, max(errors) <= _ALLOWED, *errors, float(left_out))


def _estimate_errors(
    quadratic: np.ndarray, rest: np.ndarray, mean: float, deviation: float
) -> tuple[float, float]:
    """Estimate the errors of both moments by what the quadratic leaves, over the deviation.

    Each error is the difference that the samples show, plus two standard errors of it.
    """
    noise = 2 / len(rest) ** 0.5
    # Only the rest is sampled (a control variate): the moments of the quadratic are exact, and
    # where the rest is small so is its noise. The answer's variance is the quadratic's plus
    # the mean of this.
    added = (2 * (quadratic - mean) + rest) * rest - rest.mean() ** 2
    corrected = max(deviation**2 + float(added.mean()), 0.0) ** 0.5
    of_mean = float(abs(rest.mean()) + noise * rest.std())
    of_deviation = abs(corrected - deviation)
    of_deviation += float(noise * added.std() / (corrected + deviation or 1.0))
    if deviation > 0:
        return of_mean / deviation, of_deviation / deviation
    # Nothing scatters, so that only rounding is allowed, 64 units of it.
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
        Share of samples that the paraboloid puts on the wrong side of the limit state. But for
        the noise of sampling, it bounds the error of the paraboloid's probability, which
        `probability` approximates.
    status : Status
        NOT_CONVERGED if the search for that point has not converged, NOT_VALIDATED if the
        samples contradict the paraboloid.
    """

    probability: float
    first_order_probability: float
    reliability_index: float
    most_likely: dict[str, float]
    misjudged: float
    status: Status

    def __str__(self) -> str:
        names = [name for name in vars(self) if name != "status"]
        return format_fields(self, **dict.fromkeys(names, ""))


def failure_probability(
    margin: Answer,
    at: Any,
    coefficients_of_variation: Spread,
    samples: int = 2000,
    seed: int = 0,
) -> ReliabilityResult:
    """Estimate the probability that a smooth margin is negative, by FORM and SORM.

    The limit state, where the margin is 0, is replaced by a plane (FORM) and a paraboloid
    (SORM) at its point next to the medians, in the space of independent standard normal
    numbers. Samples show whether the limit state has that shape.

    Parameters
    ----------
    margin, at, coefficients_of_variation, samples, seed
        As in `propagate`. The margin is smooth where it passes 0, as `overturning_margin` and
        the margin of a response are.

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
    >>> print(f"{chance.probability:.3f}", chance.status.name)
    0.245 COMPLETE
    """
    function, z = sample_scatter(margin, at, coefficients_of_variation, samples, seed)
    if not any(coefficients_of_variation.values()):
        raise ValueError(
            "coefficients_of_variation must be greater than 0 for at least one number"
        )
    point, converged = _find_design_point(function, np.zeros(z.shape[1]))
    _, gradient, hessian = function.evaluate(point, 2)
    steepness = float(np.linalg.norm(gradient))
    normal = -gradient / steepness if steepness else np.zeros_like(gradient)
    beta = float(normal @ point)
    # Curvature K in the tangent plane: samples fail where normal . z > beta + u . K u / 2,
    # with u the part of z in that plane (the paraboloid of Fiessler, Neumann and Rackwitz
    # 1979). The last rows of V in a singular value decomposition of the normal span the plane.
    tangent = np.linalg.svd(normal[None])[2][1:]
    curvature = tangent @ hessian @ tangent.T / (steepness or 1.0)
    mean = 0.5 * float(np.trace(curvature))
    variance = 0.5 * float((curvature**2).sum())
    # normal . z - u . K u / 2 has the mean -tr(K) / 2 and the variance 1 + tr(K K) / 2. It is
    # taken for normal, which is exact where K vanishes. Breitung's formula (1984,
    # doi:10.1061/(ASCE)0733-9399(1984)110:3(357)) holds for large beta only, and has a pole
    # where the limit state curves towards the medians as much as a sphere around them.
    second_order = float(norm.cdf(-(beta + mean) / (1 + variance) ** 0.5))

    fails = function.evaluate(z)[0] < 0
    u = z @ tangent.T
    judged = z @ normal > beta + 0.5 * np.einsum("ij,jk,ik->i", u, curvature, u)
    # The paraboloid may err on a few samples, and on both sides alike: below 5 % of them, with
    # shares that differ by less than 1 % and three standard deviations of the samples between
    # which the two disagree.
    misjudged = float((fails != judged).mean())
    noise = 3 * (max(misjudged, 1 / samples) / samples) ** 0.5
    agrees = misjudged < 0.05 and bool(abs(fails.mean() - judged.mean()) < 0.01 + noise)
    parameters = np.asarray(function.parameters_at(jnp.asarray(point))).tolist()
    likely = dict(zip(function.names, parameters, strict=True))
    first_order = float(norm.cdf(-beta))
    status = Status.COMPLETE if agrees else Status.NOT_VALIDATED
    status = status if converged else Status.NOT_CONVERGED
    return ReliabilityResult(second_order, first_order, beta, likely, misjudged, status)


def _find_design_point(function: ParametricAnswer, z: np.ndarray) -> tuple[np.ndarray, bool]:
    """Find the design point, the point of the limit state next to 0; tell if that converged.

    Each step goes to the nearest point of the tangent plane (Hasofer and Lind 1974; Rackwitz
    and Fiessler 1978, doi:10.1016/0045-7949(78)90046-9), or part of the way where a merit of
    distance and margin would not decrease (Zhang and Der Kiureghian 1995).
    """
    margin, gradient = function.evaluate(z, 1)
    for _ in range(100):
        # Without an answer, or where it is flat, no tangent plane says where to go.
        square = float(gradient @ gradient)
        if not np.isfinite(margin) or not 0 < square < np.inf:
            return z, False
        step = (gradient @ z - margin) / square * gradient - z
        # Half of the digits: the distance is least there, so that its error is the square of
        # this, and rounding in the margin allows no smaller steps.
        if np.linalg.norm(step) < np.finfo(gradient.dtype).eps ** 0.5:
            return z, True
        # The step descends on this merit if the weight is greater than |z| / |gradient|. With
        # twice as much there is room for rounding; near 0 the weight must not vanish.
        weight = 2 * max(float(np.linalg.norm(z)) / square**0.5, 1e-3)
        merit = 0.5 * float(z @ z) + weight * abs(float(margin))
        share = 1.0
        start = z
        lower = False
        # A step of a thousandth is taken whatever the merit says: where the margin has a kink,
        # or is NaN further on, standing still would end the search for good.
        while not lower:
            z = start + share * step
            margin, gradient = function.evaluate(z, 1)
            lower = 0.5 * float(z @ z) + weight * abs(float(margin)) < merit or share <= 1e-3
            share *= 0.5
    return z, False
