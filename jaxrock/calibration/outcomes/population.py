"""A population of blocks: how the blocks of a series of tests are distributed."""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...host import Printed
from ...validation import Reals

# The coordinates of a block, in which a population is Gaussian: the logarithms of the critical
# angle and of the frequency parameter, the logit of the restitution.
NAMES = ("critical_angle", "frequency_parameter", "restitution")
PAIRS = ((0, 1), (0, 2), (1, 2))  # of coordinates, in the order of `Population.correlations`
# Free numbers of a population in the order of `pack_population`, for tables.
FREE_NAMES = (
    *NAMES,
    *(f"{name}_deviation" for name in NAMES),
    *(f"correlation_{NAMES[k]}_{NAMES[m]}" for k, m in PAIRS),
    "lapse",
    "group_deviation",
    "peak_deviation",
)
# Nodes and weights of a Gauss-Hermite quadrature over the deviation that the tests of a group
# share: exact for polynomials up to degree 9.
_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
NODES = tuple(_NODES.tolist())
NODE_WEIGHTS = tuple((_NODE_WEIGHTS / _NODE_WEIGHTS.sum()).tolist())


class Population(Printed, eqx.Module):
    """The population from which each test of a series has a block of its own.

    The logarithms of alpha_c and p and the logit of C are jointly normal.

    Attributes
    ----------
    critical_angle, frequency_parameter, restitution : Array, shape ()
        Medians of alpha_c [rad], p [1/s] and C [-].
    deviations : Array, shape (3,)
        Standard deviations of ln(alpha_c), ln(p) and logit(C) from test to test [-].
    correlations : Array, shape (3,)
        Of ln(alpha_c) and ln(p), of ln(alpha_c) and logit(C), of ln(p) and logit(C) [-].
    lapse : Array, shape ()
        Probability that the outcome of a test does not depend on its block: overturning and
        standing are then equally likely [-].
    group_deviation : Array, shape ()
        Standard deviation of a change of ln(alpha_c) that all tests of a group share [-]; 0
        where the tests have no groups.
    peak_deviation : Array, shape ()
        Standard deviation of the logarithm of a measured over a computed peak rotation [-].
    """

    critical_angle: Reals
    frequency_parameter: Reals
    restitution: Reals
    deviations: Reals
    correlations: Reals
    lapse: Reals
    group_deviation: Reals
    peak_deviation: Reals

    def __str__(self) -> str:
        medians = (self.critical_angle, self.frequency_parameter, self.restitution)
        units = ("rad", "1/s", "")
        lines = [
            f"{name.replace('_', ' '):22}{float(median):.4g} {unit}".rstrip()
            for name, median, unit in zip(NAMES, medians, units, strict=True)
        ]
        deviations = ", ".join(f"{d:.3g}" for d in np.asarray(self.deviations).tolist())
        correlations = ", ".join(f"{r:.2f}" for r in np.asarray(self.correlations).tolist())
        lines += [
            f"{'deviations':22}{deviations}",
            f"{'correlations':22}{correlations}",
            f"{'lapse':22}{float(self.lapse):.3g}",
        ]
        if float(self.group_deviation):
            lines.append(f"{'deviation of groups':22}{float(self.group_deviation):.3g}")
        return "\n".join(lines)


class Normal(NamedTuple):
    """A normal distribution of coordinates.

    Attributes
    ----------
    mean : Array, shape (3,)
    factor : Array, shape (3, 3)
        Lower triangle of Cholesky of the covariance.
    """

    mean: Reals
    factor: Reals


def to_normal(population: Population) -> Normal:
    """Return the distribution of coordinates within a group that deviates by nothing."""
    restitution = population.restitution
    mean = jnp.stack(
        [
            jnp.log(population.critical_angle),
            jnp.log(population.frequency_parameter),
            jnp.log(restitution) - jnp.log1p(-restitution),
        ]
    )
    r21, r31, r32 = population.correlations
    # Cholesky's factor of a correlation matrix, written out: a factorization would give NaN
    # where rounding makes the matrix indefinite, as at a correlation of 1.
    low22 = jnp.sqrt(jnp.maximum(1 - r21**2, 0))
    low32 = (r32 - r21 * r31) / low22
    low33 = jnp.sqrt(jnp.maximum(1 - r31**2 - low32**2, 0))
    zero = jnp.zeros_like(r21)
    rows = [
        jnp.stack([zero + 1, zero, zero]),
        jnp.stack([r21, low22, zero]),
        jnp.stack([r31, low32, low33]),
    ]
    return Normal(mean, population.deviations[:, None] * jnp.stack(rows))


def pack_population(population: Population) -> np.ndarray:
    """Return the free numbers of a population, on which nothing bounds a search.

    They are the coordinates of the medians, logarithms of deviations, inverse hyperbolic
    tangents of partial correlations, the logit of the lapse, and the logarithms of the other
    two deviations.
    """
    host = jax.tree.map(lambda leaf: np.asarray(leaf, float), population)
    r21, r31, r32 = host.correlations
    partial = (r32 - r21 * r31) / math.sqrt((1 - r21**2) * (1 - r31**2))
    return np.concatenate(
        [
            np.log([host.critical_angle, host.frequency_parameter]),
            [math.log(host.restitution / (1 - host.restitution))],
            np.log(host.deviations),
            np.arctanh([r21, r31, partial]),
            [math.log(host.lapse / (1 - host.lapse))],
            np.log([host.group_deviation, host.peak_deviation]),
        ]
    )


def unpack_population(free: Reals) -> Population:
    """Return the population of free numbers, shape (12,); see `pack_population`."""
    r21, r31, partial = jnp.tanh(free[6:9])
    r32 = r21 * r31 + partial * jnp.sqrt((1 - r21**2) * (1 - r31**2))
    return Population(
        critical_angle=jnp.exp(free[0]),
        frequency_parameter=jnp.exp(free[1]),
        restitution=jax.nn.sigmoid(free[2]),
        deviations=jnp.exp(free[3:6]),
        correlations=jnp.stack([r21, r31, r32]),
        lapse=jax.nn.sigmoid(free[9]),
        group_deviation=jnp.exp(free[10]),
        peak_deviation=jnp.exp(free[11]),
    )


def drop_groups(population: Population) -> Population:
    """Return the population without a deviation of groups."""
    return eqx.tree_at(lambda p: p.group_deviation, population, replace_fn=jnp.zeros_like)
