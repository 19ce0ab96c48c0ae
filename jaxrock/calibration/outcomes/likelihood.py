"""Probabilities of outcomes from a simulated sample of blocks, and the likelihood of tests.

The outcome of a block jumps, but its weight changes smoothly with the medians, deviations and
correlations of the population. The method is importance sampling with normalized weights (Owen
2013, "Monte Carlo theory, methods and examples", section 9.2).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ...validation import Integers, Reals
from .population import Population


class Points(NamedTuple):
    """Blocks of a sample, and a quadrature over the deviation that tests of a group share.

    Attributes
    ----------
    coordinates : Array, shape (blocks, 3)
        ln(alpha_c), ln(p) and logit(C).
    log_density : Array, shape (blocks,)
        Logarithm of the density with which they were drawn, up to a constant; infinite for
        those that do not count.
    nodes, node_weights : Array, shape (nodes,)
        Deviations in units of their standard deviation, and weights with a sum of 1.
    """

    coordinates: Reals
    log_density: Reals
    nodes: Reals
    node_weights: Reals


class TestData(NamedTuple):
    """Tests, and the outcomes of each block of a sample in them.

    Attributes
    ----------
    outcomes : Array, shape (tests, blocks)
        1 where a block overturns, else 0.
    overturned : Array, shape (tests,)
        1 where the block of the test did.
    group : Array of int, shape (tests,)
        Which group a test belongs to.
    """

    outcomes: Reals
    overturned: Reals
    group: Integers


def weigh_blocks(population: Population, points: Points) -> Reals:
    """Compute the weight of each block, for groups that deviate by each node.

    Returns
    -------
    Array, shape (blocks, nodes)
        Weights with a sum of 1 at each node.
    """
    centred = points.coordinates.T - population.mean[:, None]
    # All blocks, and a shift by the deviation of groups, which is a deviation of ln(alpha_c).
    shift = jnp.zeros_like(centred[:, :1]).at[0].set(population.group_deviation)
    columns = jnp.concatenate([centred, shift], axis=1)
    # The inverse has shape (3, 3): in a batch of populations it is faster than solving for all
    # columns.
    unit = jnp.eye(3, dtype=columns.dtype)
    inverse = jax.scipy.linalg.solve_triangular(population.factor, unit, lower=True)
    standard = inverse @ columns
    shifted = standard[:, :-1, None] - standard[:, -1:, None] * points.nodes[None, None, :]
    log_weights = -0.5 * jnp.sum(shifted**2, axis=0) - points.log_density[:, None]
    return jax.nn.softmax(log_weights, axis=0)


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
    weights = weigh_blocks(population, points) @ points.node_weights
    return (1 - population.lapse) * (outcomes @ weights) + 0.5 * population.lapse


def compute_log_likelihood(
    population: Population, points: Points, data: TestData, counts: Reals
) -> Reals:
    """Compute the logarithm of the likelihood of tests.

    Parameters
    ----------
    population : Population
    points : Points
    data : TestData
    counts : Array, shape (tests,)
        1 for tests that count, 0 for others.

    Returns
    -------
    Array, shape ()
    """
    weights = weigh_blocks(population, points)
    probability = (1 - population.lapse) * (data.outcomes @ weights) + 0.5 * population.lapse
    likelihood = jnp.where(data.overturned[:, None] > 0, probability, 1 - probability)
    logarithms = counts[:, None] * jnp.log(likelihood)
    # There are no more groups than tests. A group without tests has a likelihood of 1.
    grouped = jax.ops.segment_sum(logarithms, data.group, len(data.group))
    log_weights = jnp.log(points.node_weights)
    return jnp.sum(jax.scipy.special.logsumexp(grouped + log_weights[None, :], axis=1))
