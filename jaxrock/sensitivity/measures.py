"""The parameters that matter: derivatives and ranges around a point, and over ranges."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..host import Printed, Shown, format_table
from ..tables import UNITS
from ..validation import COUNT, check
from .parameters import Answer, Ranges, check_ranges, label_sides, make_parametric


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
    sides : tuple of str
        Which of them are sides of a block, each changed while the other one stays.
    """

    names: tuple[str, ...]
    at: np.ndarray
    value: float
    gradient: np.ndarray
    elasticity: np.ndarray
    hessian: np.ndarray
    sides: tuple[str, ...] = ()

    def table(self) -> dict[str, list[Any]]:
        """List values, derivatives and elasticities, a row for each parameter.

        Returns
        -------
        dict of list
        """
        columns = {"value": self.at, "derivative": self.gradient}
        columns["elasticity"] = self.elasticity
        units = [UNITS.get(name, "-") for name in self.names]
        values = {name: column.tolist() for name, column in columns.items()}
        return {"quantity": list(self.names), "unit": units, **values}

    def __str__(self) -> str:
        columns = {"at": self.at, "derivative": self.gradient, "elasticity": self.elasticity}
        return format_table(
            f"{self.value:.6g}", label_sides(self.names, self.sides), **columns
        )


def sensitivities(answer: Answer, at: Any, *, sides: bool = False) -> Sensitivities:
    """Compute value, gradient, elasticities and second derivatives of an answer.

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

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> print(jr.sensitivities(jr.rotation_ratio, wall))
    0.123215
                                    at    derivative    elasticity
    half_width                     0.4     -0.329681      -1.07027
    slenderness                      5     0.0280581       1.13859
    gravity                       9.81    -0.0134427      -1.07027
    inertia_ratio              1.33333    -0.0989044      -1.07027
    restitution                    0.7       0.87915       4.99457
    intensity                     0.15        1.7583       2.14053
    """
    function = make_parametric(answer, at, sides=sides)
    x = np.asarray(function.values)
    y, gradient, hessian = function.evaluate(x, 2)
    # An answer of 0, such as one below uplift, has no elasticity: NaN or inf, without a
    # warning.
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = gradient * x / y
    return Sensitivities(
        function.names,
        x,
        float(y),
        gradient,
        elasticity,
        hessian,
        function.get_size_names("sides"),
    )


@dataclass(frozen=True, repr=False)
class TornadoBars(Shown):
    """Changes of an answer within the range of each parameter; see `tornado`.

    Attributes
    ----------
    names : tuple of str
        The parameter with the widest bar first.
    low, high, at_low, at_high : ndarray, shape (parameters,)
        The ranges, and the answer at their ends, the other parameters unchanged.
    value : float
        The answer with all parameters unchanged. NaN stands for a block that overturns.
    sides : tuple of str
        Which of them are sides of a block, each changed while the other one stays.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    at_low: np.ndarray
    at_high: np.ndarray
    value: float
    sides: tuple[str, ...] = ()

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
        ends = np.concatenate([self.at_low, self.at_high])
        if not np.isfinite([self.value, *ends]).any():
            return "has no value: the block overturns, also at both ends of every range"
        if (ends == self.value).all():
            return f"is {self.value:.6g}, also at both ends of every range"
        return ""

    def __str__(self) -> str:
        if self.reason_without_bars:
            return self.reason_without_bars
        columns = {name: getattr(self, name) for name in ("low", "high", "at_low", "at_high")}
        head = f"{self.value:.6g}"
        if not np.isfinite(self.value):
            head = "has no value: the block overturns with all parameters unchanged"
        text = format_table(head, label_sides(self.names, self.sides), **columns)
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
                                   low          high        at low       at high
    restitution                    0.6           0.8     0.0673033      0.307402
    slenderness                      4             6     0.0954255       0.15161
    """
    function = make_parametric(answer, at, "ranges", ranges)
    ends = list_ends(np.asarray(function.values)[list(function.varied)], ranges)
    (values,) = function.evaluate(ends)
    return arrange_bars(values, ranges, function.get_size_names("sides"))


def list_ends(point: np.ndarray, ranges: Ranges) -> np.ndarray:
    """List the point itself, then for each parameter both ends of its range, as rows.

    Raises
    ------
    ValueError
        If a range is not a low and a high value with that of the point between them.
    """
    check_ranges(ranges)
    # One batch for one program.
    ends = np.asarray(list(ranges.values()), float).reshape(-1, 2)
    for name, value, (low, high) in zip(ranges, point, ends, strict=True):
        # A value in float32, or computed from others, is hardly the number that was typed.
        rounding = 1e-6 * abs(value)
        if not low - rounding <= value <= high + rounding:
            raise ValueError(
                f"ranges of {name} must be a low and a high value around {value:g}, got"
                f" {low:g} and {high:g}"
            )
    points = np.tile(point, (1 + ends.size, 1))
    end = np.arange(ends.size)
    points[1 + end, end // 2] = ends.ravel()
    return points


def arrange_bars(values: np.ndarray, ranges: Ranges, sides: tuple[str, ...]) -> TornadoBars:
    """Arrange answers at the points of `list_ends` as bars, the widest first."""
    ends = np.asarray(list(ranges.values()), float).reshape(-1, 2)
    answers = values[1:].reshape(-1, 2)
    # An end at which the block overturns has no answer: such a bar is the widest of all.
    # Stable, so that equal bars keep the order in which they were asked for.
    width = np.nan_to_num(abs(np.diff(answers)[:, 0]), nan=np.inf)
    order = np.argsort(-width, kind="stable")
    names = tuple(list(ranges)[k] for k in order)
    value = float(values[0])
    return TornadoBars(names, *ends[order].T, *answers[order].T, value=value, sides=sides)


@dataclass(frozen=True, repr=False)
class DerivativeBasedMeasures(Printed):
    """Derivative-based measures over ranges; see `derivative_based_measures`.

    Attributes
    ----------
    names : tuple of str
    mean_slope, measure, bound : ndarray, shape (parameters,)
        Mean magnitude of the partial derivative; nu, its mean square; and nu (high - low)^2 /
        (pi^2 variance), an upper bound on Sobol's total index [-].
    mean, standard_deviation, left_out : float
        Mean and standard deviation of the answer over the ranges; and the fraction of samples
        without an answer, which do not count.
    """

    names: tuple[str, ...]
    mean_slope: np.ndarray
    measure: np.ndarray
    bound: np.ndarray
    mean: float
    standard_deviation: float
    left_out: float

    def __str__(self) -> str:
        first = (
            f"{self.mean:.6g} +- {self.standard_deviation:.6g}, left out {self.left_out:.3g}"
        )
        columns = {name: getattr(self, name) for name in ("mean_slope", "measure", "bound")}
        return format_table(first, self.names, **columns)


def derivative_based_measures(
    answer: Answer, at: Any, ranges: Ranges, samples: int = 4096, seed: int = 0
) -> DerivativeBasedMeasures:
    """Measure which parameters matter over whole ranges, from gradients at random points.

    A parameter whose `bound` is near 0 need not be known well (I. M. Sobol and S. Kucherenko,
    Derivative based global sensitivity measures and their link with global sensitivity
    indices, Math. Comput. Simul. 79 (2009) 3009-3017, doi:10.1016/j.matcom.2009.01.023).

    Parameters
    ----------
    answer, at, ranges : callable, pytree, dict
        As in `tornado`; each parameter is uniform in its range, others stay as they are.
    samples, seed : int
        Number of points, and the seed that they are drawn with.

    Returns
    -------
    DerivativeBasedMeasures

    Raises
    ------
    ValueError
        If a name is not one of `at`, or a range is empty.
    """
    function = make_parametric(answer, at, "ranges", ranges)
    low, high = np.asarray(list(ranges.values()), float).reshape(-1, 2).T
    if not (high > low).all():
        name, ends = next(item for item in ranges.items() if not item[1][1] > item[1][0])
        raise ValueError(f"ranges of {name} must be a low and a higher value, got {ends}")
    check("samples", samples, COUNT)
    points = low + np.random.default_rng(seed).random((samples, low.size)) * (high - low)
    values, gradients = function.evaluate(points, 1)
    # Samples without an answer, where the block overturns, are left out and their fraction
    # is returned. The measures are then those of the ranges as far as there is an answer.
    finite = np.isfinite(values) & np.isfinite(gradients).all(axis=1)
    if not finite.any():
        raise ValueError("answer is NaN everywhere in these ranges")
    values = values[finite]
    gradients = gradients[finite]
    slope = abs(gradients).mean(axis=0)
    measure = (gradients**2).mean(axis=0)
    variance = values.var()
    # The bound follows from Poincare's inequality for a uniform variable, whose constant is
    # (high - low)^2 / pi^2. An answer that does not vary has no variance to divide.
    bound = measure * (high - low) ** 2 / (np.pi**2 * variance) if variance else 0 * measure
    moments = float(values.mean()), float(values.std()), float(1 - finite.mean())
    return DerivativeBasedMeasures(tuple(ranges), slope, measure, bound, *moments)
