"""Probability that a margin is negative."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..host import listed
from .parameters import Answer, Asked, expanded, sampled, scattering, slope_of, value_of, values_at


class ReliabilityResult(NamedTuple):
    """Probability that a margin is negative; see `failure_probability`.

    Attributes
    ----------
    probability : float
        From the verge as a parabola at its most likely point.
    first_order_probability : float
        From the verge as a plane there.
    reliability_index : float
        beta, the distance of that point from the median, in standard deviations; negative
        where the median itself is beyond the verge.
    most_likely : dict
        The numbers at that point.
    misjudged : float
        Share of samples that the parabola puts on the wrong side of the verge, no less than
        the error of `probability`, but for the noise of sampling.
    valid : bool
        Whether the search came to an end, and the samples do not contradict.
    """

    probability: float
    first_order_probability: float
    reliability_index: float
    most_likely: dict[str, float]
    misjudged: float
    valid: bool

    def __str__(self) -> str:
        return listed(self, **dict.fromkeys(self._fields, ""))


def failure_probability(
    margin: Answer,
    at: Any,
    coefficients_of_variation: Mapping[str, float],
    samples: int = 2000,
    seed: int = 0,
) -> ReliabilityResult:
    """Probability that a smooth margin is negative, from the verge at its most likely point.

    First- and second-order reliability: in the space of independent standard normal numbers,
    the point of the verge next to the median, and the verge's curvature there. Samples then
    show whether the verge is like that.

    Parameters
    ----------
    margin : callable
        From a pytree of numbers to one number, smooth where it passes 0:
        `overturning_margin`, or the margin of a response.
    at : pytree
        Medians.
    coefficients_of_variation : dict
        Coefficient of variation by name; see `propagate`.
    samples : int
        How many fates to compare with.
    seed : int
        Of the random numbers.

    Returns
    -------
    ReliabilityResult
        `valid` is False where the method is not to be trusted.

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
    asked, names, spread = scattering(margin, at, coefficients_of_variation)
    if not spread.any():
        raise ValueError("coefficients_of_variation must be greater than 0 for at least one number")
    start = float(value_of(asked, jnp.zeros(len(coefficients_of_variation))))
    z, ended = _nearest(asked, len(coefficients_of_variation))
    _, slope, curvature = map(np.asarray, expanded(asked, jnp.asarray(z)))
    steep = float(np.linalg.norm(slope))
    away = -slope / steep if steep else np.zeros_like(slope)
    beta = float(away @ z)
    # Curvature of the verge in the plane that touches it there.
    basis = np.linalg.svd(away[None])[2][1:]
    curvature = basis @ curvature @ basis.T / (steep or 1.0)
    # Beyond where away . z > beta + u . K u / 2, u the rest of z.
    bend, twist = 0.5 * np.trace(curvature), 0.5 * (curvature**2).sum()
    first = _normal(-beta)
    second = _normal(-(beta + float(bend)) / (1 + float(twist)) ** 0.5)

    drawn = np.random.default_rng(seed).standard_normal((samples, len(coefficients_of_variation)))
    fails = sampled(values_at, asked, drawn) < 0
    rest = drawn @ basis.T
    judged = drawn @ away > beta + 0.5 * np.einsum("ij,jk,ik->i", rest, curvature, rest)
    misjudged = float((fails != judged).mean())
    noise = 3 * (max(misjudged, 1 / samples) / samples) ** 0.5
    point = np.asarray(asked.numbers(jnp.asarray(z)))
    holds = ended and np.isfinite(start) and abs(fails.mean() - judged.mean()) < 0.01 + noise
    return ReliabilityResult(
        second,
        first,
        beta,
        dict(zip(names, point.tolist(), strict=True)),
        misjudged,
        bool(holds and misjudged < 0.05),
    )


def _nearest(asked: Asked, size: int) -> tuple[np.ndarray, bool]:
    """The point of the verge that is nearest to 0 (Hasofer, Lind, Rackwitz, Fiessler).

    Each step goes to the nearest point of the verge's tangent plane, or part of the way if
    that would not bring it nearer.
    """
    z = np.zeros(size)
    for _ in range(100):
        value, slope = (
            float(value_of(asked, jnp.asarray(z))),
            np.asarray(slope_of(asked, jnp.asarray(z))),
        )
        square = float(slope @ slope)
        if not np.isfinite(value) or not 0 < square < np.inf:
            return z, False
        change = (slope @ z - value) / square * slope - z
        if np.linalg.norm(change) < np.finfo(slope.dtype).eps ** 0.5:
            return z, True
        weight = 2 * max(np.linalg.norm(z) / square**0.5, 1e-3)

        def merit(z: np.ndarray, value: float, weight: float = weight) -> float:
            return 0.5 * float(z @ z) + weight * abs(value)

        share, now = 1.0, merit(z, value)
        while share > 1e-3:
            there = float(value_of(asked, jnp.asarray(z + share * change)))
            if merit(z + share * change, there) < now:
                break
            share *= 0.5
        z = z + share * change
    return z, False


def _normal(x: float) -> float:
    return float(jax.scipy.stats.norm.cdf(x))
