"""Which numbers matter over whole ranges."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..host import table
from .parameters import Answer, Numbers, sampled, slopes_and_values_at


class DerivativeBasedMeasures(NamedTuple):
    """Derivative-based measures over ranges; see `derivative_based_measures`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers.
    mean_slope : ndarray, shape (numbers,)
        Mean magnitude of the slope to each.
    measure : ndarray, shape (numbers,)
        nu, the mean square of the slope.
    bound : ndarray, shape (numbers,)
        nu (high - low)^2 / (pi^2 variance): no less than Sobol's total index.
    mean, standard_deviation : float
        Of the answer over the ranges.
    left_out : float
        Share of samples without an answer, which are not counted.
    """

    names: tuple[str, ...]
    mean_slope: np.ndarray
    measure: np.ndarray
    bound: np.ndarray
    mean: float
    standard_deviation: float
    left_out: float

    def __str__(self) -> str:
        first = f"{self.mean:.6g} +- {self.standard_deviation:.6g}, left out {self.left_out:.3g}"
        columns = {name: getattr(self, name) for name in ("mean_slope", "measure", "bound")}
        return table(first, self.names, **columns)


def derivative_based_measures(
    answer: Answer,
    at: Any,
    ranges: Mapping[str, tuple[float, float]],
    samples: int = 4096,
    seed: int = 0,
) -> DerivativeBasedMeasures:
    """Which numbers matter over whole ranges, from slopes at random points.

    Derivative-based global measures; a number whose bound is near 0 need not be known well.

    Parameters
    ----------
    answer : callable
        From a pytree of numbers to one number.
    at : pytree
        Where to ask for what is not given a range.
    ranges : dict
        Low and high value by name; uniform between them.
    samples : int
        How many points.
    seed : int
        Of the random numbers.

    Returns
    -------
    DerivativeBasedMeasures

    Raises
    ------
    ValueError
        If a name is not one of `at`, or a range is empty.

    References
    ----------
    I. M. Sobol and S. Kucherenko, Derivative based global sensitivity measures and their link
    with global sensitivity indices, Math. Comput. Simul. 79 (2009) 3009-3017.
    """
    numbers = Numbers.of(at)
    places = np.asarray(numbers.chosen("ranges", ranges))
    ends = np.asarray([ranges[name] for name in ranges], float).reshape(-1, 2)
    if not (ends[:, 1] > ends[:, 0]).all():
        raise ValueError("ranges must go from a low value to a higher one")
    asked = numbers.asked(answer, places)
    share = np.random.default_rng(seed).random((samples, len(ranges)))
    points = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    found = sampled(slopes_and_values_at, asked, points)
    known = np.isfinite(found).all(axis=1)
    if not known.any():
        raise ValueError("answer is NaN everywhere in these ranges")
    slopes, values = found[known, :-1], found[known, -1]
    measure = (slopes**2).mean(axis=0)
    width = ends[:, 1] - ends[:, 0]
    variance = values.var()
    return DerivativeBasedMeasures(
        tuple(ranges),
        abs(slopes).mean(axis=0),
        measure,
        measure * width**2 / (np.pi**2 * variance) if variance else np.zeros(len(ranges)),
        float(values.mean()),
        float(values.std()),
        float(1 - known.mean()),
    )
