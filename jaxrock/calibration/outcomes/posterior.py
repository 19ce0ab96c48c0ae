"""The posterior of a population by importance sampling, for intervals of its numbers.

The curvature at the mode is that of a likelihood made from a finite sample of blocks, which is
rough at small scales: intervals by it alone are too narrow. Here populations are drawn around
the mode and weighed by their posterior density, then around what these say, and so on: adaptive
importance sampling with a mixture of all proposals (Cornuet, Marin, Mira and Robert 2012,
10.1111/j.1467-9469.2011.00756.x).
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import logsumexp

from ...sensitivity import draw_normal_numbers
from ...validation import Reals
from .likelihood import Points, TestData
from .prior import Prior
from .search import Searched, compute_loss

_ROUNDS = 4
_PER_ROUND = 256  # a power of 2
# Degrees of freedom of the proposals, whose tails have to be wider than those of the posterior,
# and the factor on standard deviations of the first one.
_FREEDOM = 5.0
_WIDER = 1.6
# A proposal is made from weights whose largest is cut to this.
_LARGEST_WEIGHT = 0.05
_AT_ONCE = 8  # populations whose weights of blocks are in memory together


class Posterior(NamedTuple):
    """Populations drawn from the posterior.

    Attributes
    ----------
    free : ndarray, shape (draws, 12)
        Free numbers; see `pack_population`.
    weights : ndarray, shape (draws,)
        With a sum of 1.
    """

    free: np.ndarray
    weights: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the free numbers, shape (12, 12)."""
        return _compute_moments(self.free, self.weights)[1]

    @property
    def effective_draws(self) -> float:
        """Number of draws of equal weight that say as much."""
        return float(1 / np.sum(self.weights**2))


def sample_posterior(
    searched: Searched,
    covariance: np.ndarray,
    prior: Prior,
    points: Points,
    data: TestData,
    counts: np.ndarray,
    seed: int,
    *,
    grouped: bool,
) -> Posterior:
    """Draw populations around the mode, and weigh them by the posterior.

    Parameters
    ----------
    searched, covariance : Searched, ndarray
        The mode, and the covariance by the curvature there.
    prior, points, data, counts, grouped
        As in `search_population`.
    seed : int
        Of the Sobol points.
    """
    dtype = points.coordinates.dtype
    arrays = Prior(*(jnp.asarray(numbers, dtype) for numbers in prior))
    weight = jnp.asarray(counts, dtype)
    mean = np.asarray(searched.free, float)
    factor = _WIDER * np.linalg.cholesky(covariance)
    proposals: list[tuple[np.ndarray, np.ndarray]] = []
    free = np.empty((0, mean.size))
    log_posterior = np.empty(0)
    weights = np.empty(0)
    for turn in range(_ROUNDS):
        proposals.append((mean, factor))
        drawn = _draw_students(mean, factor, seed + turn)
        losses = _compute_losses(
            jnp.asarray(drawn, dtype), arrays, points, data, weight, grouped
        )
        free = np.concatenate([free, drawn])
        log_posterior = np.append(log_posterior, -np.asarray(losses, float))
        # NaN, where a population leaves all blocks behind: nothing is known of it.
        log_posterior[np.isnan(log_posterior)] = -np.inf
        log_weights = log_posterior - _compute_log_mixture(free, proposals)
        weights = np.exp(log_weights - logsumexp(log_weights))
        cut = np.minimum(weights, _LARGEST_WEIGHT)
        mean, spread = _compute_moments(free, cut / cut.sum())
        # Some of the first, so that few draws of large weight do not make it singular.
        factor = np.linalg.cholesky(spread + 0.05 * covariance)
    return Posterior(free, weights)


def _draw_students(mean: np.ndarray, factor: np.ndarray, seed: int) -> np.ndarray:
    """Draw from a multivariate distribution of Student, shape (draws, numbers)."""
    from scipy.special import chdtri, ndtr

    normal = draw_normal_numbers(mean.size + 1, _PER_ROUND, seed)
    # The last dimension gives the sum of squares in the denominator.
    squares = chdtri(_FREEDOM, ndtr(normal[:, -1:]))
    return mean + (normal[:, :-1] / np.sqrt(squares / _FREEDOM)) @ factor.T


def _compute_log_mixture(
    free: np.ndarray, proposals: list[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Compute the logarithm of the mean density of proposals, up to a constant, (draws,)."""
    terms = []
    for mean, factor in proposals:
        standard = np.linalg.solve(factor, (free - mean).T)
        squares = np.sum(standard**2, axis=0)
        power = 0.5 * (_FREEDOM + mean.size)
        log_volume = np.log(np.diagonal(factor)).sum()
        terms.append(-power * np.log1p(squares / _FREEDOM) - log_volume)
    return np.asarray(logsumexp(terms, axis=0))


def _compute_moments(free: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the mean and the covariance of draws with weights."""
    mean = weights @ free
    centred = free - mean
    return mean, (weights[:, None] * centred).T @ centred


@functools.partial(jax.jit, static_argnames="grouped")
def _compute_losses(
    free: Reals, prior: Prior, points: Points, data: TestData, counts: Reals, grouped: bool
) -> Reals:
    """Compute minus the logarithms of the posterior of many populations."""

    def compute(numbers: Reals) -> Reals:
        """Compute that of one."""
        standard = (numbers - prior.mean) / prior.width
        return compute_loss(standard, prior, points, data, counts, grouped)

    return jax.lax.map(compute, free, batch_size=_AT_ONCE)
