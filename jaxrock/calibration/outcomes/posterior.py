"""The posterior of a population: its mode, and samples by importance.

The likelihood comes from a finite sample of blocks, and is rough at small scales. So its
curvature at the mode is computed by differences of the gradient. It gives the distribution
(Laplace's approximation) from which populations are drawn. Each is weighted by its posterior
density (importance sampling; Owen 2013, "Monte Carlo theory, methods and examples", section
9.2).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy.special import logsumexp

from ...host import Status
from ...sensitivity import draw_normal_numbers
from ...validation import Reals, as_array
from .likelihood import Points, TestData, compute_log_likelihood
from .population import NAMES, Population, make_population
from .prior import Prior

# Lengths of the gradient, in standard deviations of the prior, at which a search ends, and
# below which its result counts as a mode. For a posterior deviation of 1 the length is the
# error of the mode.
_ARRIVED = 1e-3
_CONVERGED = 1e-2
_STEP = 0.1  # step of the differences, in standard deviations of the prior
# Blocks are drawn from a distribution wider by this factor than a population and the
# uncertainty of its medians together.
_WIDER_BLOCKS = 2.0
_DRAWS = 2048  # a power of 2
_AT_ONCE = 8  # populations whose weights of blocks are in memory together
# The distribution of draws needs wider tails than the posterior: degrees of freedom of
# Student's distribution, and a factor on Laplace's standard deviations.
_FREEDOM = 5.0
_WIDER = 1.2


class Evidence(NamedTuple):
    """The evidence on a population: prior, sample of blocks, and tests."""

    prior: Prior
    points: Points
    data: TestData


class Mode(NamedTuple):
    """Where the posterior is greatest, in standard deviations of the prior, shape (11,)."""

    standard: np.ndarray
    status: Status


class Posterior(NamedTuple):
    """Populations drawn from the posterior.

    Attributes
    ----------
    standard : ndarray, shape (draws, 11)
        Unbounded parameters, in standard deviations of the prior from its mean.
    weights : ndarray, shape (draws,)
        Their sum is 1.
    """

    standard: np.ndarray
    weights: np.ndarray

    @property
    def variances(self) -> np.ndarray:
        """Variances of the unbounded parameters, over the prior variances, shape (11,)."""
        centred = self.standard - self.weights @ self.standard
        return self.weights @ centred**2


@jax.jit
def scale_to_prior(standard: Reals, prior: Prior) -> Population:
    """Make the population whose parameters are so many standard deviations from the prior's."""
    _, unravel = ravel_pytree(prior.mean)
    unbounded = jax.tree.map(
        lambda mean, width, value: mean + width * value, *prior, unravel(standard)
    )
    return make_population(unbounded)


def compute_loss(standard: Reals, evidence: Evidence, counts: Reals) -> Reals:
    """Compute minus the logarithm of the posterior density, up to a constant."""
    prior, points, data = evidence
    fit = compute_log_likelihood(scale_to_prior(standard, prior), points, data, counts)
    return 0.5 * jnp.sum(standard**2) - fit


_compute_loss_and_gradient = jax.jit(jax.value_and_grad(compute_loss))


@jax.jit
def _compute_losses(standard: Reals, evidence: Evidence, counts: Reals) -> Reals:
    """Compute the losses of many populations, shape (draws,)."""
    return jax.lax.map(
        lambda row: compute_loss(row, evidence, counts), standard, batch_size=_AT_ONCE
    )


def differentiate(
    standard: np.ndarray, evidence: Evidence, counts: np.ndarray
) -> tuple[float, np.ndarray]:
    """Compute the loss and its gradient on the host."""
    loss, gradient = _compute_loss_and_gradient(as_array(standard), evidence, as_array(counts))
    return float(loss), np.asarray(gradient, float)


def search_mode(evidence: Evidence, counts: np.ndarray, start: np.ndarray) -> Mode:
    """Search the mode of the posterior by a quasi-Newton method, for the tests that count."""
    from scipy.optimize import minimize

    result = minimize(
        differentiate, start, (evidence, counts), "BFGS", jac=True, options={"gtol": _ARRIVED}
    )
    converged = np.linalg.norm(result.jac) <= _CONVERGED
    return Mode(result.x, Status.COMPLETE if converged else Status.NOT_CONVERGED)


def compute_covariance(mode: Mode, evidence: Evidence, counts: np.ndarray) -> np.ndarray:
    """Compute the covariance by the curvature at the mode, shape (11, 11)."""

    def compute_gradient(step: np.ndarray) -> np.ndarray:
        return differentiate(mode.standard + step, evidence, counts)[1]

    steps = _STEP * np.eye(mode.standard.size)
    curvature = [(compute_gradient(h) - compute_gradient(-h)) / (2 * _STEP) for h in steps]
    values, vectors = np.linalg.eigh(0.5 * (np.array(curvature) + np.transpose(curvature)))
    # The prior alone has a curvature of 1. A smaller value means that the likelihood has no
    # peak in this direction: then the prior decides alone.
    return (vectors / np.maximum(values, 1.0)) @ vectors.T


def propose_blocks(
    mode: Mode, covariance: np.ndarray, prior: Prior
) -> tuple[np.ndarray, np.ndarray]:
    """Propose a normal distribution of blocks for a population and its neighbours.

    Parameters
    ----------
    mode : Mode
    covariance : ndarray, shape (11, 11)
        Of the posterior, in standard deviations of the prior.
    prior : Prior

    Returns
    -------
    mean, factor : ndarray, shape (3,), (3, 3)
        Of ln(alpha_c), ln(p) and logit(C): mean, and Cholesky factor of the covariance.
    """
    mean, block_covariance = _compute_moments(as_array(mode.standard), prior)
    fields = list(vars(prior.width))
    medians = [fields.index(name) for name in NAMES]
    width = np.array([float(getattr(prior.width, name)) for name in NAMES])
    median_covariance = covariance[np.ix_(medians, medians)] * width * width[:, None]
    factor = np.linalg.cholesky(np.asarray(block_covariance, float) + median_covariance)
    return np.asarray(mean, float), _WIDER_BLOCKS * factor


@jax.jit
def _compute_moments(standard: Reals, prior: Prior) -> tuple[Reals, Reals]:
    """Compute mean and covariance of the coordinates of a population, in all groups."""
    population = scale_to_prior(standard, prior)
    covariance = population.factor @ population.factor.T
    return population.mean, covariance.at[0, 0].add(population.group_deviation**2)


def sample_posterior(
    mode: Mode, covariance: np.ndarray, evidence: Evidence, counts: np.ndarray, seed: int
) -> Posterior:
    """Draw populations around the mode, and weigh them by the posterior.

    Parameters
    ----------
    mode, covariance, evidence, counts
        As in `compute_covariance`.
    seed : int
        Of the Sobol points.
    """
    from scipy.special import chdtri, ndtr

    normal = draw_normal_numbers(mode.standard.size + 1, _DRAWS, seed)
    # The last dimension gives the sum of squares in the denominator of Student's variable.
    scale = np.sqrt(_FREEDOM / chdtri(_FREEDOM, ndtr(normal[:, -1:])))
    student = normal[:, :-1] * scale
    standard = mode.standard + _WIDER * student @ np.linalg.cholesky(covariance).T
    losses = _compute_losses(as_array(standard), evidence, as_array(counts))
    power = 0.5 * (_FREEDOM + mode.standard.size)
    log_density = -power * np.log1p(np.sum(student**2, axis=1) / _FREEDOM)
    # A density is NaN where a population is far from all blocks: its weight is 0.
    log_weights = np.nan_to_num(-np.asarray(losses, float) - log_density, nan=-np.inf)
    weights = np.exp(log_weights - logsumexp(log_weights))
    # Weights are truncated, so that no draw dominates (truncated importance sampling, Ionides
    # 2008, 10.1198/106186008X320456).
    truncated = np.minimum(weights, _DRAWS**-0.5)
    return Posterior(standard, truncated / truncated.sum())
