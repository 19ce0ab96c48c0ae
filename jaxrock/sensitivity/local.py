"""Derivatives, elasticities and tornado diagrams around one point."""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..host import table
from .parameters import Answer, Ranges, evaluated, expansion, parametric, sampled


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of an answer y with respect to all its parameters x; see `sensitivities`.

    Attributes
    ----------
    names : tuple of str
    at : ndarray, shape (parameters,)
    value : float
    gradient, elasticity : ndarray, shape (parameters,)
        ``dy / dx``, and relative, ``(x / y) dy / dx`` [-].
    hessian : ndarray, shape (parameters, parameters)
    """

    names: tuple[str, ...]
    at: np.ndarray
    value: float
    gradient: np.ndarray
    elasticity: np.ndarray
    hessian: np.ndarray

    def __str__(self) -> str:
        columns = {"at": self.at, "slope": self.gradient, "elasticity": self.elasticity}
        return table(f"{self.value:.6g}", self.names, **columns)


@dataclass(frozen=True)
class TornadoBars:
    """How far each parameter moves an answer within its range; see `tornado`.

    Attributes
    ----------
    names : tuple of str
        The parameter with the widest bar first.
    low, high : ndarray, shape (parameters,)
        The ranges.
    at_low, at_high : ndarray, shape (parameters,)
        The answer there, the other parameters unchanged.
    value : float
        The answer with all parameters unchanged.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    at_low: np.ndarray
    at_high: np.ndarray
    value: float

    def __str__(self) -> str:
        columns = {name: getattr(self, name) for name in ("low", "high", "at_low", "at_high")}
        return table(f"{self.value:.6g}", self.names, **columns)


def sensitivities(answer: Answer, at: Any) -> Sensitivities:
    """Value, gradient, elasticities and second derivatives of an answer.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        The numbers at which to differentiate.

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
                                    at         slope    elasticity
    half_width                     0.4     -0.329681      -1.07027
    slenderness                      5     0.0280581       1.13859
    gravity                       9.81    -0.0134427      -1.07027
    restitution                    0.7       0.87915       4.99457
    intensity                     0.15        1.7583       2.14053
    """
    function = parametric(answer, at)
    x = np.asarray(function.values)
    value, gradient, hessian = evaluated(expansion, function, function.values)
    gradient, hessian = np.asarray(gradient), np.asarray(hessian)
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = gradient * x / np.asarray(value)
    return Sensitivities(function.names, x, float(value), gradient, elasticity, hessian)


def tornado(answer: Answer, at: Any, ranges: Ranges) -> TornadoBars:
    """How far each parameter moves an answer within its range, one at a time.

    Parameters
    ----------
    answer, at
        As in `sensitivities`.
    ranges : dict
        Low and high value of each parameter to vary, by name.

    Returns
    -------
    TornadoBars

    Raises
    ------
    ValueError
        If a name is not one of `at`.

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
    function = parametric(answer, at, "ranges", ranges)
    ends = np.asarray(list(ranges.values()), float).reshape(-1, 2)
    points = np.tile(np.asarray(function.values)[list(function.varied)], (1 + ends.size, 1))
    for k, pair in enumerate(ends):
        points[1 + 2 * k : 3 + 2 * k, k] = pair
    values = sampled(jax.vmap, function, points)
    answers = values[1:].reshape(-1, 2)
    width = np.nan_to_num(abs(np.diff(answers)[:, 0]), nan=np.inf)
    order = np.argsort(-width, kind="stable")
    names = tuple(list(ranges)[k] for k in order)
    (low, high), (at_low, at_high) = ends[order].T, answers[order].T
    return TornadoBars(names, low, high, at_low, at_high, float(values[0]))
