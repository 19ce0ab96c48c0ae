"""Moments of an answer whose parameters are uncertain."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..host import Printed, format_fields
from .distributions import draw_normal_numbers, expand_quantile, map_normal_numbers
from .parameters import Answer, evaluate, name_parameters
from .uncertain import ARGUMENT, Uncertain, list_single_coefficients

# Largest errors of mean and standard deviation, over the standard deviation, of an estimate
# within tolerance.
_ALLOWED = 0.1


@dataclass(frozen=True, repr=False)
class MomentEstimate(Printed):
    """Mean and standard deviation of an answer; see `propagate`.

    Attributes
    ----------
    first_order_mean, first_order_standard_deviation, mean, standard_deviation : float
        From the gradient alone, and from the gradient and the Hessian.
    variance_fractions : dict
        Fractions of the first-order variance, by parameter. Empty if parameters are
        correlated, since part of the variance then belongs to several of them.
    mean_error, standard_deviation_error, left_out : float
        Errors of `mean` and of `standard_deviation`, both divided by the standard deviation:
        estimates from the samples plus two standard errors of the estimates; inf if a sample
        has no answer. `left_out` is the fraction of samples without an answer.
    within_tolerance : bool
        Whether both errors are at most 0.1. They are larger where the answer is too nonlinear
        within the uncertainty, chaotic, or does not exist because the block overturns.
    """

    first_order_mean: float
    first_order_standard_deviation: float
    mean: float
    standard_deviation: float
    variance_fractions: dict[str, float]
    within_tolerance: bool
    mean_error: float
    standard_deviation_error: float
    left_out: float

    def __str__(self) -> str:
        fractions = [f"{name} {part:.6g}" for name, part in self.variance_fractions.items()]
        names = [name for name in vars(self) if name != "variance_fractions"]
        lines = [format_fields(self, **dict.fromkeys(names, ""))]
        lines += [f"variance fractions  {', '.join(fractions)}"] * bool(fractions)
        return "\n".join(lines)


def propagate(answer: Answer, at: Any, uncertain: Uncertain) -> MomentEstimate:
    """Estimate mean and standard deviation of an answer to second order.

    Samples check whether the second-order expansion describes the answer. Only the difference
    between answer and expansion is sampled, so that 1,024 samples suffice. With the default of
    64 an estimate counts as within tolerance only if the answer is nearly quadratic.

    Parameters
    ----------
    answer, at : callable, pytree
        A function from a pytree of numbers to one number; the pytree of their values
        without uncertainty, as `Uncertain` has them.
    uncertain : Uncertain
        One coefficient of variation for each uncertain parameter, by name. Names of a `Block`
        are its fields, or ``width`` (at this height) and ``height`` (at this width), or
        ``critical_angle`` and ``frequency_parameter``.

    Returns
    -------
    MomentEstimate

    Raises
    ------
    ValueError
        If a name is not one of `at`; if the coefficient of variation of a restitution is above
        0 at a mean of 1, or so large that the density has two peaks.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> uncertain = jr.Uncertain({"intensity": 0.1, "restitution": 0.05}, samples=1024)
    >>> moments = jr.sensitivity.propagate(jr.rotation_ratio, wall, uncertain)
    >>> print(f"{moments.mean:.4f} +- {moments.standard_deviation:.4f}")
    0.1323 +- 0.0424
    """
    variations = list_single_coefficients(uncertain)
    names = uncertain.names
    parameters = name_parameters(at, names, ARGUMENT)
    values = parameters.get_values(names)
    normal = draw_normal_numbers(len(names), uncertain.samples, uncertain.seed)
    factor = uncertain.factor
    points = map_normal_numbers(names, normal @ factor.T, values, variations)
    (answers,) = evaluate(answer, parameters, names, points)
    # The chain rule turns derivatives with respect to parameters into derivatives with respect
    # to normal numbers, first correlated and then independent.
    expansion = [*map(expand_quantile, names, values, variations)]
    middle, first, second = np.reshape(expansion, (-1, 3)).T
    value, gradient, hessian = evaluate(answer, parameters, names, middle, 2)
    hessian = first[:, None] * hessian * first + np.diag(gradient * second)
    hessian = factor.T @ hessian @ factor
    gradient = factor.T @ (gradient * first)
    # For y + g . z + z . H z / 2 of independent standard normal z the mean is y + tr(H) / 2,
    # the variance g . g + tr(H H) / 2.
    first_variance = float((gradient**2).sum())
    mean = float(value + 0.5 * np.trace(hessian))
    deviation = (first_variance + 0.5 * float((hessian**2).sum())) ** 0.5
    quadratic = value + normal @ gradient
    quadratic += 0.5 * np.einsum("ni,ij,nj->n", normal, hessian, normal)
    # Each error is the difference in the samples, plus two standard errors of this difference.
    # Standard errors hold for independent samples. Sobol points have less noise, so that the
    # error is overestimated rather than underestimated.
    noise = 2 / len(answers) ** 0.5
    with np.errstate(invalid="ignore"):
        # Only the remainder is sampled (a control variate): the moments of the quadratic are
        # exact, and the noise is as small as the remainder. The variance of the answer is that
        # of the quadratic plus the mean of `added`.
        remainder = answers - quadratic
        added = (2 * (quadratic - mean) + remainder) * remainder - remainder.mean() ** 2
        corrected = np.maximum(deviation**2 + added.mean(), 0.0) ** 0.5
        mean_error = abs(remainder.mean()) + noise * remainder.std()
        deviation_error = abs(corrected - deviation)
        deviation_error += noise * added.std() / (corrected + deviation or 1.0)
    # Where nothing is uncertain, the errors are absolute. If one sample has no answer, the
    # moments do not exist.
    errors = np.array([mean_error, deviation_error]) / (deviation or 1.0)
    errors = np.nan_to_num(errors, nan=np.inf, posinf=np.inf).tolist()
    fractions = gradient**2 / (first_variance or 1.0)
    portions = dict(zip(names, fractions.tolist(), strict=True))
    portions = {} if uncertain.correlations else portions
    moments = (float(value), first_variance**0.5, mean, deviation)
    left_out = float(1 - np.isfinite(answers).mean())
    is_within = max(errors) <= _ALLOWED
    return MomentEstimate(*moments, portions, is_within, errors[0], errors[1], left_out)
