"""Derivatives of closed forms: their accuracy, and the ranges in which answers are finite."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .distributions import is_between_0_and_1
from .parameters import Answer, Parameters, evaluate_answer

# Units of rounding, of each parameter and of the derivative. In comparisons with mpmath, 2 and
# 6 bound the errors of all answers of a scene up to 1e-14 of the overturning threshold; 2 and
# 9 bound the errors of critical values as well.
_UNITS_OF_PARAMETER = 2
_UNITS_OF_DERIVATIVE = 10
# Distances over the value, at which a limit is sought first; the search goes on between two of
# them. They are large for the sake of a small C, whose limit is 1.
_DISTANCES = np.array([0.0, *2.0 ** np.arange(-5, 3), *2.0 ** np.arange(4, 60, 7)])
_ROUNDS = 16  # 18^15 exceeds the number of floats in the first interval


class ClosedFormDerivatives(NamedTuple):
    """Derivatives of answers y of a closed form with respect to its parameters x.

    Attributes
    ----------
    value, gradient, hessian : ndarray, shape (...), (..., names), (..., names, names)
        y with its derivatives; these are NaN where y is not finite.
    error, below, above : ndarray, shape (..., names)
        As `estimate_rounding` and `find_finite_ranges` give them.
    """

    value: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    error: np.ndarray
    below: np.ndarray
    above: np.ndarray


def differentiate_closed_form(
    answer: Answer, parameters: Parameters, names: Sequence[str], point: np.ndarray
) -> ClosedFormDerivatives:
    """Differentiate an answer at points of shape (..., names)."""
    value, gradient, hessian = evaluate_answer(answer, parameters, names, point, 2)
    # Automatic derivatives are 0 where there is no answer, as if nothing had influence.
    unknown = ~np.isfinite(value)[..., None]
    gradient = np.where(unknown, np.nan, gradient)
    hessian = np.where(unknown[..., None], np.nan, hessian)
    error = estimate_rounding(names, point, gradient, hessian)
    ranges = find_finite_ranges(
        lambda trials: evaluate_answer(answer, parameters, names, trials)[0], point
    )
    return ClosedFormDerivatives(value, gradient, hessian, error, *ranges)


def estimate_rounding(
    names: Sequence[str], point: np.ndarray, gradient: np.ndarray, hessian: np.ndarray
) -> np.ndarray:
    """Estimate the error of the derivatives of a closed form by rounding.

    A closed form without cancellation rounds as if its parameters were off by a few units of
    rounding: the error of a derivative is that change times the second derivatives, besides a
    few units of the derivative itself (backward error analysis, Higham 2002, section 1.5,
    https://doi.org/10.1137/1.9780898718027). This assumes that close numbers are subtracted
    only if they are exact, and that nothing underflows. It holds for the answers of a `Scene`
    and for critical values, but not for the motion of a model over time.

    Parameters
    ----------
    names, point : sequence of str, ndarray, shape (..., names)
        The parameters.
    gradient, hessian : ndarray, shape (..., names), (..., names, names)
        First and second derivatives, in the precision of the computation.

    Returns
    -------
    ndarray, shape (..., names)
        Absolute, in the units of the derivatives.
    """
    # Between 1/2 and 1 the difference to 1 is exact, and only this difference is rounded
    # later.
    is_fraction = [is_between_0_and_1(name) for name in names]
    sizes = np.where(is_fraction, np.minimum(point, 1 - point), point)
    changes = np.abs(hessian * sizes[..., None, :]).sum(axis=-1)
    units = _UNITS_OF_PARAMETER * changes + _UNITS_OF_DERIVATIVE * np.abs(gradient)
    return np.finfo(gradient.dtype).eps * units


def find_finite_ranges(
    evaluate: Callable[[np.ndarray], np.ndarray], point: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find from where to where an answer is finite, along each parameter, the others unchanged.

    Parameters
    ----------
    evaluate : callable
        It computes answers, shape (..., points), of parameters, shape (..., points, names).
        They are not finite beyond the overturning threshold, and outside of a domain, where
        only traced parameters are allowed.
    point : ndarray, shape (..., names)
        Parameters.

    Returns
    -------
    below, above : ndarray, shape (..., names)
        The last values with a finite answer, to rounding. NaN where the parameters have none,
        infinite where all values have one, as far as 1e16 times the value. An interval without
        answers is not seen if it lies between two of the distances tried first: 3 % of the value,
        each twice the one before up to four times the value, and each 100 times beyond.
    """
    size = np.where(point == 0, 1.0, np.abs(point))[..., None, :, None]
    directions = np.array([-1.0, 1.0])[:, None, None]
    is_varied = np.eye(point.shape[-1], dtype=bool)[:, None]
    # The last value with a finite answer, one without, and values between them.
    near = point[..., None, :, None] + 0.0 * directions
    far = near + np.inf * directions
    values = near + size * directions * _DISTANCES
    for _ in range(_ROUNDS):
        trials = np.where(is_varied, values[..., None], point[..., None, None, None, :])
        is_finite = np.isfinite(evaluate(trials))
        # The number of finite values before the first that is not finite.
        count = np.cumprod(is_finite, axis=-1).sum(axis=-1, keepdims=True)
        edges = np.concatenate([near, values, far], axis=-1)
        near = np.take_along_axis(edges, count, axis=-1)
        far = np.take_along_axis(edges, count + 1, axis=-1)
        values = near + np.where(np.isinf(far), 0.0, far - near) * np.arange(1, 18) / 18
    # Both are the point itself where it has no finite answer.
    limits = np.where(np.isinf(far), far, np.where(near == far, np.nan, near))
    # The lower limit of a positive parameter is 0, which itself is not allowed.
    limits = np.where(np.abs(limits) < 4 * np.finfo(float).eps * size, 0.0, limits)[..., 0]
    return limits[..., 0, :], limits[..., 1, :]
