"""Probabilities of outcomes from a simulated sample of blocks, and the likelihood of tests.

Outcomes jump, populations do not: a block of the sample overturns or stands, but how much it
counts changes smoothly with the medians, deviations and correlations of the population. It is
importance sampling with weights that are normalized (Owen 2013, "Monte Carlo theory, methods
and examples", section 9.2).
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ...validation import Integers, Reals
from .population import NODE_WEIGHTS, NODES, Population, to_normal

# Peaks of unexplained tests are taken to be uniform in their logarithms over three decades.
_DENSITY_OF_LAPSE = 1 / math.log(1e3)


class Points(NamedTuple):
    """Blocks of a sample.

    Attributes
    ----------
    coordinates : Array, shape (blocks, 3)
        See `NAMES`.
    log_density : Array, shape (blocks,)
        Logarithm of the density with which they were drawn, up to a constant; infinite for
        those that do not count.
    """

    coordinates: Reals
    log_density: Reals


class TestData(NamedTuple):
    """Tests, and what each block of a sample does in them.

    Attributes
    ----------
    outcomes : Array, shape (tests, blocks)
        1 where a block overturns, else 0.
    overturned : Array, shape (tests,)
        1 where the block of the test did.
    group : Array of int, shape (tests,)
        Which group a test belongs to.
    log_peak : Array, shape (tests,), or None
        Logarithm of the measured peak rotation; NaN where none was measured. None where none
        was in any test.
    log_peaks : Array, shape (tests, blocks), or None
        Of the blocks of the sample.
    """

    outcomes: Reals
    overturned: Reals
    group: Integers
    log_peak: Reals | None = None
    log_peaks: Reals | None = None


def weigh_blocks(population: Population, points: Points, nodes: tuple[float, ...]) -> Reals:
    """Compute how much each block counts, for groups that deviate by each node.

    Returns
    -------
    Array, shape (blocks, nodes)
        Weights with a sum of 1 at each node.
    """
    normal = to_normal(population)
    centred = points.coordinates - normal.mean[None, :]

    def weigh(node: Reals) -> Reals:
        """Weigh the blocks at one node."""
        shift = jnp.zeros_like(normal.mean).at[0].set(population.group_deviation * node)
        standard = jax.scipy.linalg.solve_triangular(
            normal.factor, (centred - shift[None, :]).T, lower=True
        )
        log_weights = -0.5 * jnp.sum(standard**2, axis=0) - points.log_density
        return jax.nn.softmax(log_weights)

    return jax.vmap(weigh, out_axes=1)(jnp.asarray(nodes, normal.mean.dtype))


def average_weights(population: Population, points: Points) -> Reals:
    """Average the weights of blocks over groups, shape (blocks,)."""
    node_weights = jnp.asarray(NODE_WEIGHTS, points.coordinates.dtype)
    return weigh_blocks(population, points, NODES) @ node_weights


def compute_probability(population: Population, points: Points, outcomes: Reals) -> Reals:
    """Compute the probability of overturning in tests of groups that are not known.

    Parameters
    ----------
    population : Population
    points : Points
    outcomes : Array, shape (tests, blocks)

    Returns
    -------
    Array, shape (tests,)
    """
    weights = average_weights(population, points)
    return (1 - population.lapse) * (outcomes @ weights) + 0.5 * population.lapse


def compute_log_likelihood(
    population: Population, points: Points, data: TestData, counts: Reals, *, grouped: bool
) -> Reals:
    """Compute the logarithm of the likelihood of tests.

    Parameters
    ----------
    population : Population
    points : Points
    data : TestData
    counts : Array, shape (tests,)
        1 for tests that count, 0 for others.
    grouped : bool
        Whether the tests of a group share a deviation. If not, all tests are independent.

    Returns
    -------
    Array, shape ()
    """
    nodes = NODES if grouped else (0.0,)
    weights = weigh_blocks(population, points, nodes)
    stands = 1 - population.lapse
    overturns = stands * (data.outcomes @ weights) + 0.5 * population.lapse
    overturned = data.overturned[:, None] > 0
    likelihood = jnp.where(overturned, overturns, 1 - overturns)
    if data.log_peak is not None and data.log_peaks is not None:
        measured = ~jnp.isnan(data.log_peak)
        peak = jnp.where(measured, data.log_peak, 0)
        deviation = population.peak_deviation
        standard = (peak[:, None] - data.log_peaks) / deviation
        kernel = jnp.exp(-0.5 * standard**2) / (math.sqrt(2 * math.pi) * deviation)
        density = stands * (((1 - data.outcomes) * kernel) @ weights)
        density = density + 0.5 * population.lapse * _DENSITY_OF_LAPSE
        likelihood = jnp.where(measured[:, None] & ~overturned, density, likelihood)
    logarithms = counts[:, None] * jnp.log(likelihood)
    if not grouped:
        return jnp.sum(logarithms)
    # There are no more groups than tests. A group without tests has a likelihood of 1.
    of_groups = jax.ops.segment_sum(logarithms, data.group, len(data.group))
    log_node_weights = jnp.log(jnp.asarray(NODE_WEIGHTS, logarithms.dtype))
    return jnp.sum(jax.scipy.special.logsumexp(of_groups + log_node_weights[None, :], axis=1))
