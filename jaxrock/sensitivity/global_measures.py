"""Derivative-based measures: which parameters matter over whole ranges."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..host import table
from .parameters import Answer, Ranges, parametric, sampled


@dataclass(frozen=True)
class DerivativeBasedMeasures:
    """Derivative-based measures over ranges; see `derivative_based_measures`.

    Attributes
    ----------
    names : tuple of str
    mean_slope, measure : ndarray, shape (parameters,)
        Mean magnitude of the partial derivative, and nu, its mean square.
    bound : ndarray, shape (parameters,)
        nu (high - low)^2 / (pi^2 variance), no less than Sobol's total index [-].
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
    answer: Answer, at: Any, ranges: Ranges, samples: int = 4096, seed: int = 0
) -> DerivativeBasedMeasures:
    """Which parameters matter over whole ranges, from gradients at random points.

    A parameter whose `bound` is near 0 need not be known well.

    Parameters
    ----------
    answer, at
        As in `sensitivities`; parameters without a range stay as they are.
    ranges : dict
        Low and high value by name; uniform between them.
    samples, seed : int
        Number of points, and the seed that they are drawn with.

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
    function = parametric(answer, at, "ranges", ranges)
    low, high = np.asarray(list(ranges.values()), float).reshape(-1, 2).T
    if not (high > low).all():
        raise ValueError("ranges must go from a low value to a higher one")
    points = low + np.random.default_rng(seed).random((samples, low.size)) * (high - low)
    results = sampled(_gradients_and_values, function, points)
    finite = np.isfinite(results).all(axis=1)
    if not finite.any():
        raise ValueError("answer is NaN everywhere in these ranges")
    gradients, values = results[finite, :-1], results[finite, -1]
    mean_slope, measure = abs(gradients).mean(axis=0), (gradients**2).mean(axis=0)
    variance = values.var()
    bound = measure * (high - low) ** 2 / (np.pi**2 * variance) if variance else 0 * measure
    moments = float(values.mean()), float(values.std())
    left_out = float(1 - finite.mean())
    return DerivativeBasedMeasures(
        tuple(ranges), mean_slope, measure, bound, *moments, left_out=left_out
    )


def _gradients_and_values(answer: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """At many points, the values in the last column."""
    return jax.vmap(lambda point: jnp.append(jax.jacfwd(answer)(point), answer(point)))
