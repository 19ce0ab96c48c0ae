"""Derivatives of closed forms: their accuracy, and the ranges in which answers are finite."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..host import Printed, format_table
from ..tables import UNITS
from .distributions import is_between_0_and_1
from .parameters import Answer, Parameters, describe_parameter, evaluate, name_parameters

# Units of rounding, of each parameter and of the derivative. In comparisons with mpmath, 2 and
# 6 bound the errors of all answers of a scene up to 1e-14 of the overturning threshold; 2 and
# 9 bound the errors of critical values as well.
_UNITS_OF_PARAMETER = 2
_UNITS_OF_DERIVATIVE = 10
# Distances over the value, at which a limit is sought first; the search goes on between two of
# them. They are large for the sake of a small C, whose limit is 1.
_DISTANCES = np.array([0.0, *2.0 ** np.arange(-5, 3), *2.0 ** np.arange(4, 60, 7)])
_ROUNDS = 16  # 18^15 exceeds the number of floats in the first interval


@dataclass(frozen=True, repr=False)
class Sensitivities(Printed):
    """Derivatives of an answer y with respect to all its parameters x; see `sensitivities`.

    Attributes
    ----------
    names, at : tuple of str and ndarray, shape (parameters,)
        The parameters.
    value : float
        y.
    gradient, hessian : ndarray, shape (parameters,), (parameters, parameters)
        ``dy / dx``, and the second derivatives; NaN where y is not finite.
    error : ndarray, shape (parameters,)
        Absolute error of ``dy / dx`` by rounding.
    below, above : ndarray, shape (parameters,)
        From where to where the answer is finite, the other parameters unchanged: up to the
        overturning threshold, or to the end of a domain; infinite where no end was found.
    """

    names: tuple[str, ...]
    at: np.ndarray
    value: Any
    gradient: np.ndarray
    hessian: np.ndarray
    error: np.ndarray
    below: np.ndarray
    above: np.ndarray

    @property
    def elasticity(self) -> np.ndarray:
        """Relative derivatives ``(x / y) dy / dx`` [-], shape (parameters,)."""
        # An answer of 0, as below uplift, has no elasticity: NaN or inf, without a warning.
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.gradient * self.at.astype(self.gradient.dtype) / self.value

    def table(self) -> dict[str, list[Any]]:
        """List values, derivatives with errors, elasticities and ranges, a row for each parameter.

        Returns
        -------
        dict of list
        """
        units = [UNITS.get(name, "-") for name in self.names]
        columns = {"value": self.at, "derivative": self.gradient, "error": self.error}
        columns |= {"elasticity": self.elasticity, "below": self.below, "above": self.above}
        listed = {head: column.tolist() for head, column in columns.items()}
        return {"quantity": list(self.names), "unit": units, **listed}

    def __str__(self) -> str:
        if not np.isfinite(self.value):
            return f"{self.value:.6g} has no derivatives; it is nan where the block overturns"
        names = [*map(describe_parameter, self.names)]
        slopes = map("{:.6g} +- {:.0e}".format, self.gradient, self.error)
        columns = {"at": self.at, "derivative": slopes, "elasticity": self.elasticity}
        ranges = format_ranges(self.below, self.above)
        return format_table(f"{self.value:.6g}", names, **columns, holds_for=ranges)


def sensitivities(answer: Answer, at: Any, *, sides: bool = False) -> Sensitivities:
    """Compute value, gradient, elasticities and second derivatives of an answer.

    Each derivative comes with its error by rounding, and with the range of its parameter in
    which the answer is finite.

    Parameters
    ----------
    answer, at : callable, pytree
        A function from a pytree of numbers to one number; the pytree at which to
        differentiate.
    sides : bool
        Whether every `Block` in `at` is described by its sides: ``width`` at this height and
        ``height`` at this width [m]. By default it is described by ``half_width`` at this
        slenderness, which is a size, and ``slenderness`` at this half-width.

    Returns
    -------
    Sensitivities

    Raises
    ------
    ValueError
        If `at` does not consist of single numbers, or the answer is not one.

    Notes
    -----
    The error is meant for closed forms: it follows from the second derivatives, as what a few
    units of rounding in each parameter change. It does not see where an answer of your own
    subtracts close numbers, nor that it jumps or bends between finite values.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 6.0), restitution=0.7, intensity=0.15)
    >>> local = jr.sensitivities(jr.rotation_ratio, wall)
    >>> print([*local.table()])
    ['quantity', 'unit', 'value', 'derivative', 'error', 'elasticity', 'below', 'above']
    >>> k = local.names.index("restitution")
    >>> print(f"{local.gradient[k]:.3f} for C up to {local.above[k]:.4f}")
    1.101 for C up to 0.8412
    >>> print(f"{jr.critical_restitution(wall.block, 0.15):.4f}")
    0.8412
    """
    parameters = name_parameters(at, None, "at", "sides" if sides else "shape")
    return differentiate_at(answer, parameters, parameters.get_values(parameters.values))


def format_ranges(below: np.ndarray, above: np.ndarray) -> list[str]:
    """Write from where to where each range goes, apart from what stands before it."""
    return [*map(" {:.4g} to {:.4g}".format, below, above)]


def differentiate_at(
    answer: Answer, parameters: Parameters, point: np.ndarray
) -> Sensitivities:
    """Differentiate an answer at many points, all parameters of which stand in the last axis."""
    names = tuple(parameters.values)
    value, gradient, hessian = evaluate(answer, parameters, names, point, 2)
    # Automatic derivatives are 0 where there is no answer, as if nothing had influence.
    unknown = ~np.isfinite(value)[..., None]
    gradient = np.where(unknown, np.nan, gradient)
    hessian = np.where(unknown[..., None], np.nan, hessian)
    # A closed form without cancellation rounds as if its parameters were off by a few units of
    # rounding: the error of a derivative is that change times the second derivatives, besides
    # a few units of the derivative itself (backward error analysis, Higham 2002, section 1.5,
    # doi:10.1137/1.9780898718027). This assumes that close numbers are subtracted only if they
    # are exact, and that nothing underflows. It holds for the answers of a `Scene` and for
    # critical values, but not for the motion of a model over time. Of a fraction between 1/2
    # and 1 the difference to 1 is exact, and only this difference is rounded later.
    is_fraction = [is_between_0_and_1(name) for name in names]
    sizes = np.where(is_fraction, np.minimum(point, 1 - point), point)
    changes = np.abs(hessian * sizes[..., None, :]).sum(axis=-1)
    units = _UNITS_OF_PARAMETER * changes + _UNITS_OF_DERIVATIVE * np.abs(gradient)
    error = np.finfo(gradient.dtype).eps * units
    ranges = find_finite_ranges(answer, parameters, names, point)
    return Sensitivities(names, point, value[()], gradient, hessian, error, *ranges)


def find_finite_ranges(
    answer: Answer, parameters: Parameters, names: tuple[str, ...], point: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find from where to where an answer is finite, along each parameter, the others unchanged.

    Parameters
    ----------
    answer, parameters : callable, Parameters
        The answer is not finite beyond the overturning threshold and outside of a domain.
    names, point : tuple of str and ndarray, shape (..., names)
        Parameters, and their values.

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
        is_finite = np.isfinite(evaluate(answer, parameters, names, trials)[0])
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
