"""The probability that a margin of uncertain parameters is negative."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm

from ..host import Printed, Status, format_fields
from .parameters import Answer, ParametricAnswer
from .uncertain import Uncertain, make_uncertain_answer


@dataclass(frozen=True, repr=False)
class ReliabilityResult(Printed):
    """Probability that a margin is negative; see `failure_probability`.

    Attributes
    ----------
    probability, first_order_probability : float
        With the limit state approximated by a paraboloid (SORM), and by a plane (FORM), at
        its most probable point.
    reliability_index : float
        beta, the distance of that point from the medians in standard deviations; negative if
        the margin is negative at the medians.
    most_likely : dict
        The parameters there, by name.
    misjudged : float
        Fraction of samples that the paraboloid puts on the wrong side of the limit state.
        Apart from sampling noise, it bounds the error of the paraboloid's probability, which
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


def failure_probability(margin: Answer, at: Any, uncertain: Uncertain) -> ReliabilityResult:
    """Estimate the probability that a smooth margin is negative, by FORM and SORM.

    The limit state is the set of parameters with a margin of 0. At its point nearest to the
    medians it is replaced by a plane (FORM) and a paraboloid (SORM), in the space of
    independent standard normal variables. The logarithms and logits of correlated parameters
    are a linear map of these variables. Samples check whether the limit state has that shape;
    1,024 samples suffice, while the default of 64 shows only a coarse disagreement.

    Parameters
    ----------
    margin, at, uncertain
        As in `propagate`. The margin is smooth where it passes 0, as `overturning_margin` and
        the margin of a response are.

    Returns
    -------
    ReliabilityResult

    Raises
    ------
    ValueError
        As `propagate`; also if nothing is uncertain.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.28)
    >>> uncertain = jr.Uncertain({"intensity": 0.1, "restitution": 0.05}, samples=1024)
    >>> result = jr.sensitivity.failure_probability(jr.overturning_margin, wall, uncertain)
    >>> print(f"{result.probability:.3f}", result.status.name)
    0.245 COMPLETE
    """
    function, z = make_uncertain_answer(margin, at, uncertain)
    if not any(uncertain.coefficients):
        raise ValueError(
            "coefficients_of_variation must be greater than 0 for at least one parameter"
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
    # fractions that differ by less than 1 % and three standard deviations of the samples between
    # which the two disagree.
    misjudged = float((fails != judged).mean())
    noise = 3 * (max(misjudged, 1 / len(z)) / len(z)) ** 0.5
    agrees = misjudged < 0.05 and bool(abs(fails.mean() - judged.mean()) < 0.01 + noise)
    parameters = np.asarray(function.parameters_at(jnp.asarray(point))).tolist()
    likely = dict(zip(function.names, parameters, strict=True))
    first_order = float(norm.cdf(-beta))
    status = Status.COMPLETE if agrees else Status.NOT_VALIDATED
    status = status if converged else Status.NOT_CONVERGED
    return ReliabilityResult(second_order, first_order, beta, likely, misjudged, status)


def _find_design_point(function: ParametricAnswer, z: np.ndarray) -> tuple[np.ndarray, bool]:
    """Find the design point, next to 0 on the limit state; return whether that converged.

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
        part = 1.0
        start = z
        lower = False
        # A step of a thousandth is taken whatever the merit says: where the margin has a kink,
        # or is NaN further on, standing still would end the search for good.
        while not lower:
            z = start + part * step
            margin, gradient = function.evaluate(z, 1)
            lower = 0.5 * float(z @ z) + weight * abs(float(margin)) < merit or part <= 1e-3
            part *= 0.5
    return z, False
