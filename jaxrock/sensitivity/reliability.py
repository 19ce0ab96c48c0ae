"""Probability that a margin is negative, by first- and second-order reliability."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm

from ..host import listed
from .parameters import Answer, Spread, evaluated, expansion, sampled, under_scatter


@dataclass(frozen=True)
class ReliabilityResult:
    """Probability that a margin is negative; see `failure_probability`.

    Attributes
    ----------
    probability, first_order_probability : float
        With the limit state as a paraboloid, and as a plane, at its most likely point.
    reliability_index : float
        beta, the distance of that point from the medians, in standard deviations; negative
        where the medians themselves fail.
    most_likely : dict
        The parameters at that point, by name.
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

    def __str__(self) -> str:
        return listed(self, **dict.fromkeys(vars(self), ""))


def failure_probability(
    margin: Answer, at: Any, coefficients_of_variation: Spread, samples: int = 2000, seed: int = 0
) -> ReliabilityResult:
    """Probability that a smooth margin is negative, by first- and second-order reliability.

    From the point of the limit state (where the margin is 0) next to the medians, in the space
    of independent standard normal numbers, and the curvature there. Samples show whether the
    limit state has that shape.

    Parameters
    ----------
    margin : callable
        From a pytree of numbers to one number, smooth where it passes 0:
        `overturning_margin`, or the margin of a response.
    at, coefficients_of_variation, samples, seed
        As in `propagate`.

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
        raise ValueError("coefficients_of_variation must be greater than 0 for at least one number")

    def evaluate(transform: Callable[..., Any], point: np.ndarray) -> list[np.ndarray]:
        return [np.asarray(part) for part in evaluated(transform, function, jnp.asarray(point))]

    point, converged = _most_likely(evaluate, np.zeros(z.shape[1]))
    _, gradient, hessian = evaluate(expansion, point)
    steepness = float(np.linalg.norm(gradient))
    normal = -gradient / steepness if steepness else np.zeros_like(gradient)
    beta = float(normal @ point)
    # Curvature in the tangent plane: samples fail where normal . z > beta + u . K u / 2, with u
    # the part of z in that plane.
    tangent = np.linalg.svd(normal[None])[2][1:]
    curvature = tangent @ hessian @ tangent.T / (steepness or 1.0)
    mean, variance = 0.5 * float(np.trace(curvature)), 0.5 * float((curvature**2).sum())
    second_order = float(norm.cdf(-(beta + mean) / (1 + variance) ** 0.5))

    fails = sampled(jax.vmap, function, z) < 0
    u = z @ tangent.T
    judged = z @ normal > beta + 0.5 * np.einsum("ij,jk,ik->i", u, curvature, u)
    misjudged = float((fails != judged).mean())
    noise = 3 * (max(misjudged, 1 / samples) / samples) ** 0.5
    agrees = misjudged < 0.05 and bool(abs(fails.mean() - judged.mean()) < 0.01 + noise)
    parameters = np.asarray(function.parameters(jnp.asarray(point))).tolist()
    most_likely = dict(zip(function.names, parameters, strict=True))
    return ReliabilityResult(
        second_order, float(norm.cdf(-beta)), beta, most_likely, misjudged, converged and agrees
    )


def _most_likely(
    evaluate: Callable[..., list[np.ndarray]], z: np.ndarray
) -> tuple[np.ndarray, bool]:
    """The point of the limit state next to 0 (Hasofer, Lind, Rackwitz, Fiessler).

    Each step goes to the nearest point of the tangent plane, or part of the way where a merit
    of distance and margin would not decrease. Also whether that has converged.
    """
    value, gradient = evaluate(_value_and_gradient, z)
    for _ in range(100):
        square = float(gradient @ gradient)
        if not np.isfinite(value) or not 0 < square < np.inf:
            return z, False
        step = (gradient @ z - value) / square * gradient - z
        if np.linalg.norm(step) < np.finfo(gradient.dtype).eps ** 0.5:
            return z, True
        weight = 2 * max(float(np.linalg.norm(z)) / square**0.5, 1e-3)
        merit = 0.5 * float(z @ z) + weight * abs(float(value))
        share, start, lower = 1.0, z, False
        while not lower:
            z = start + share * step
            value, gradient = evaluate(_value_and_gradient, z)
            lower = 0.5 * float(z @ z) + weight * abs(float(value)) < merit or share <= 1e-3
            share *= 0.5
    return z, False


def _value_and_gradient(answer: Callable[..., Any]) -> Callable[..., Any]:
    return lambda point: (answer(point), jax.jacfwd(answer)(point))
