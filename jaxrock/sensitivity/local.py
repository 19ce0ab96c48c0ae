"""Slopes, elasticities and tornado diagrams around one point."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..host import table
from .parameters import Answer, Numbers, expanded, sampled, values_at


class Sensitivities(NamedTuple):
    """An answer's derivatives to every number it depends on; see `sensitivities`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers.
    at : ndarray, shape (numbers,)
        Where the derivatives are taken, each in its unit.
    value : float
        The answer there, in the unit of the answer.
    gradient : ndarray, shape (numbers,)
        Slope to each number.
    elasticity : ndarray, shape (numbers,)
        Relative change of the answer over that of the number, ``(x / y) dy / dx``.
    hessian : ndarray, shape (numbers, numbers)
        Second derivatives.
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


class TornadoBars(NamedTuple):
    """What each number can do to an answer within its range; see `tornado`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers, the one with the widest swing first.
    low, high : ndarray, shape (numbers,)
        The range of each.
    at_low, at_high : ndarray, shape (numbers,)
        The answer there, all others as they are.
    value : float
        The answer where none has been changed.
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
    """Value, slopes, elasticities and second derivatives of an answer.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Where to ask.

    Returns
    -------
    Sensitivities

    Raises
    ------
    ValueError
        If `at` is not made of single numbers, or `answer` not one.

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
    numbers = Numbers.of(at)
    value, slope, curvature = expanded(numbers.asked(answer), numbers.values)
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = np.asarray(slope) * np.asarray(numbers.values) / np.asarray(value)
    return Sensitivities(
        numbers.names,
        np.asarray(numbers.values),
        float(value),
        np.asarray(slope),
        elasticity,
        np.asarray(curvature),
    )


def tornado(answer: Answer, at: Any, ranges: Mapping[str, tuple[float, float]]) -> TornadoBars:
    """What each number can do to an answer within its range, the others left as they are.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Where to ask.
    ranges : dict
        Low and high value by name, for the numbers to change.

    Returns
    -------
    TornadoBars
        Sorted, the widest first.

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
    numbers = Numbers.of(at)
    places = numbers.chosen("ranges", ranges)
    ends = np.asarray([ranges[name] for name in ranges], float).reshape(-1, 2)
    points = np.repeat(np.asarray(numbers.values)[None], 1 + ends.size, axis=0)
    for row, place in enumerate(places):
        points[1 + 2 * row : 3 + 2 * row, place] = ends[row]
    values = sampled(values_at, numbers.asked(answer), points)
    pairs = values[1:].reshape(-1, 2)
    width = np.nan_to_num(abs(pairs[:, 1] - pairs[:, 0]), nan=np.inf)
    order = np.argsort(-width, kind="stable")
    names = tuple(list(ranges)[k] for k in order)
    (low, high), (at_low, at_high) = ends[order].T, pairs[order].T
    return TornadoBars(names, low, high, at_low, at_high, float(values[0]))
