"""The parameters that matter around a point: derivatives, and ranges one at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..host import Printed, Shown, format_table
from ..tables import UNITS
from ..validation import as_real, describe
from .derivative_validity import differentiate_closed_form, find_finite_ranges
from .parameters import Answer, describe_parameter, evaluate_answer, name_single_parameters

Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, repr=False)
class Sensitivities(Printed):
    """Derivatives of an answer y with respect to all its parameters x; see `sensitivities`.

    Attributes
    ----------
    names, at : tuple of str and ndarray, shape (parameters,)
        The parameters.
    value : float
    gradient, elasticity, hessian : ndarray, shape (parameters,), (parameters, parameters)
        ``dy / dx``, relative ``(x / y) dy / dx`` [-], and the second derivatives.
    error : ndarray, shape (parameters,)
        Absolute error of ``dy / dx`` by rounding.
    below, above : ndarray, shape (parameters,)
        From where to where the answer is finite, the other parameters unchanged: up to the
        overturning threshold, or to the end of a domain; infinite where no end was found.
    """

    names: tuple[str, ...]
    at: np.ndarray
    value: float
    gradient: np.ndarray
    elasticity: np.ndarray
    hessian: np.ndarray
    error: np.ndarray
    below: np.ndarray
    above: np.ndarray

    def table(self) -> dict[str, list[Any]]:
        """List values, derivatives with errors, elasticities and ranges, a row for each parameter.

        Returns
        -------
        dict of list
        """
        units = [UNITS.get(name, "-") for name in self.names]
        heads = ("value", "derivative", "error", "elasticity", "below", "above")
        columns = (self.at, self.gradient, self.error, self.elasticity, self.below, self.above)
        listed = {head: column.tolist() for head, column in zip(heads, columns, strict=True)}
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
    parameters = name_single_parameters(answer, at, None, "", by="sides" if sides else "shape")
    names = parameters.names
    x = parameters.get_values(names)
    result = differentiate_closed_form(answer, parameters, names, x)
    # An answer of 0, as below uplift, has no elasticity: NaN or inf, without a warning.
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = result.gradient * x.astype(result.gradient.dtype) / result.value
    return Sensitivities(
        names, x, elasticity=elasticity, **result._replace(value=float(result.value))._asdict()
    )


def format_ranges(below: np.ndarray, above: np.ndarray) -> list[str]:
    """Write from where to where each range goes, apart from what stands before it."""
    return [*map(" {:.4g} to {:.4g}".format, below, above)]


@dataclass(frozen=True, repr=False)
class TornadoBars(Shown):
    """Changes of an answer within the range of each parameter; see `tornado`.

    Attributes
    ----------
    names : tuple of str
        The parameter with the widest bar first.
    low, high, at_low, at_high : ndarray, shape (parameters,)
        The ranges, and the answer at their ends, the other parameters unchanged.
    below, above : ndarray, shape (parameters,)
        From where to where the answer goes on, as in `Sensitivities`; NaN where not known.
    value : float
        The answer with all parameters unchanged. NaN stands for a block that overturns.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    at_low: np.ndarray
    at_high: np.ndarray
    below: np.ndarray
    above: np.ndarray
    value: float

    picture: ClassVar[str] = "plot_tornado"

    def table(self, names: Sequence[str] = ()) -> dict[str, list[Any]]:
        """List ranges and answers, a row for each parameter.

        Parameters
        ----------
        names : sequence of str
            The order of the rows; by default that of the bars.

        Returns
        -------
        dict of list
        """
        names = names or self.names
        order = [self.names.index(name) for name in names]
        columns = ("low", "high", "at_low", "at_high")
        listed = {name: getattr(self, name)[order].tolist() for name in columns}
        return {"quantity": list(names), **listed}

    @property
    def reason_without_bars(self) -> str:
        """Why there are no bars, in a sentence; empty where there are some."""
        answers = np.concatenate([self.at_low, self.at_high])
        if not np.isfinite([self.value, *answers]).any():
            return "has no value: the block overturns, also at both ends of every range"
        if (answers == self.value).all():
            return f"is {self.value:.6g}, also at both ends of every range"
        return ""

    def __str__(self) -> str:
        if self.reason_without_bars:
            return self.reason_without_bars
        columns: dict[str, Any] = {"range": format_ranges(self.low, self.high)}
        columns |= {"at_low": self.at_low, "at_high": self.at_high}
        if not np.isnan(self.above).all():
            columns["holds_for"] = format_ranges(self.below, self.above)
        head = f"{self.value:.6g}"
        if not np.isfinite(self.value):
            head = "has no value: the block overturns with all parameters unchanged"
        text = format_table(head, [*map(describe_parameter, self.names)], **columns)
        # Answers of this package are NaN where a block overturns.
        return text.replace("           nan", "     overturns")


def tornado(answer: Answer, at: Any, ranges: Ranges) -> TornadoBars:
    """Vary each parameter within its range, one at a time, and compute the answer.

    Parameters
    ----------
    answer, at, ranges : callable, pytree, dict
        As in `sensitivities`; low and high value of each parameter to vary, by name, with its
        value in `at` between them. Of a `Block` these are its fields, or ``width`` (at this
        height) and ``height`` (at this width).

    Returns
    -------
    TornadoBars

    Raises
    ------
    ValueError
        If a name is not one of `at`, a block is described both by sides and by half-width or
        slenderness, or a range does not hold the value of its parameter.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8)}
    >>> print(jr.tornado(jr.rotation_ratio, wall, ranges))
    0.123215
                                 range        at low       at high     holds for
    restitution             0.6 to 0.8     0.0673033      0.307402   0 to 0.8557
    slenderness                 4 to 6     0.0954255       0.15161    0 to 20.97
    """
    parameters = name_single_parameters(answer, at, ranges, "ranges")
    points = list_ends(parameters.get_values(ranges), ranges)
    (values,) = evaluate_answer(answer, parameters, tuple(ranges), points)
    limits = find_finite_ranges(
        lambda trials: evaluate_answer(answer, parameters, tuple(ranges), trials)[0], points[0]
    )
    return arrange_bars(values, ranges, limits)


def list_ends(point: np.ndarray, ranges: Ranges) -> np.ndarray:
    """List the point itself, then for each parameter both ends of its range, as rows.

    Raises
    ------
    ValueError
        If there is no range, or a range is not a low and a high value around the value of the
        point.
    """
    if not ranges:
        raise ValueError("ranges must not be empty: they name the parameters to vary")
    # All points are one batch for one program.
    points = np.tile(point, (1 + 2 * len(ranges), 1))
    for k, (name, limits) in enumerate(ranges.items()):
        if np.shape(as_real(f"ranges of {name}", limits)) != (2,):
            raise ValueError(f"ranges of {name} must be two numbers, got {describe(limits)}")
        # A value in float32, or computed from other values, may differ by rounding from the
        # number that was typed.
        rounding = 1e-6 * abs(point[k])
        low, high = limits
        if not low - rounding <= point[k] <= high + rounding:
            raise ValueError(
                f"ranges of {name} must be a low and a high value around {point[k]:g}, got"
                f" {low:g} and {high:g}"
            )
        points[2 * k + 1, k] = low
        points[2 * k + 2, k] = high
    return points


def arrange_bars(values: np.ndarray, ranges: Ranges, limits: Any = np.nan) -> TornadoBars:
    """Arrange answers at the points of `list_ends` as bars, the widest first.

    `limits` are the limits of finite answers along each parameter.
    """
    bounds = np.asarray(list(ranges.values()), float)
    answers = values[1:].reshape(-1, 2)
    # An end at which the block overturns has no answer: such a bar is the widest of all.
    # The sort is stable, so that equal bars keep the order in which they were asked for.
    width = np.nan_to_num(abs(np.diff(answers)[:, 0]), nan=np.inf)
    order = np.argsort(-width, kind="stable")
    names = tuple(list(ranges)[k] for k in order)
    columns = np.vstack([bounds.T, answers.T, np.broadcast_to(limits, (2, width.size))])
    return TornadoBars(names, *columns[:, order], value=float(values[0]))
