"""The population that fits tests best: the mode of its posterior, and the curvature there."""

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...validation import Booleans, Integers, Reals
from .likelihood import Points, TestData, average_weights, compute_log_likelihood
from .population import to_normal, unpack_population
from .prior import Prior
from .sample import NormalComponent

_MOST_STEPS = 200
# Length of the gradient, in standard deviations of the prior, at which a search has arrived: a
# posterior deviation of 1 is then wrong by this.
_ARRIVED = 1e-3
# Powers of the likelihood that weigh single blocks, for the medians at which searches start. The
# high one picks the best blocks, the low one the middle of all that are good.
_START_POWERS = (0.3, 1.0)
# A test that a single block does not explain has this likelihood there.
_UNEXPLAINED = 0.05
# A proposal is so much wider than the population, and than the uncertainty of its medians.
_WIDER = 2.0


class Searched(NamedTuple):
    """The end of a search for a population.

    Attributes
    ----------
    free : Array, shape (12,)
        Free numbers of the population; see `pack_population`.
    loss : Array, shape ()
        Minus the logarithm of the posterior density, up to a constant.
    converged : Array of bool, shape ()
        Whether the gradient vanished.
    steps : Array of int, shape ()
        Steps that it took.
    """

    free: Reals
    loss: Reals
    converged: Booleans
    steps: Integers


class _SearchState(NamedTuple):
    """A search under way; `length` is that of the gradient."""

    standard: Reals
    optimizer: Any
    length: Reals
    steps: Integers


def compute_loss(
    standard: Reals,
    prior: Prior,
    points: Points,
    data: TestData,
    counts: Reals,
    grouped: bool,
) -> Reals:
    """Compute minus the logarithm of the posterior, of numbers in deviations of the prior."""
    population = unpack_population(jnp.asarray(prior.mean + prior.width * standard))
    fit = compute_log_likelihood(population, points, data, counts, grouped=grouped)
    return 0.5 * jnp.sum(standard**2) - fit


@functools.partial(jax.jit, static_argnames="grouped")
def _search(
    start: Reals, prior: Prior, points: Points, data: TestData, counts: Reals, grouped: bool
) -> Searched:
    """Search from a start by the quasi-Newton method of limited memory.

    See Liu and Nocedal (1989, 10.1007/BF01589116).
    """
    import optax  # which only this needs

    def compute_value(standard: Reals) -> Reals:
        return compute_loss(standard, prior, points, data, counts, grouped)

    optimizer = optax.lbfgs()
    compute_both = optax.value_and_grad_from_state(compute_value)

    def advance(state: _SearchState) -> _SearchState:
        """Go one step."""
        value, gradient = compute_both(state.standard, state=state.optimizer)
        # optax mixes types and ranks, which users may have forbidden.
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            update, optimizer_state = optimizer.update(
                gradient,
                state.optimizer,
                state.standard,
                value=value,
                grad=gradient,
                value_fn=compute_value,
            )
        length = jnp.linalg.norm(jnp.asarray(gradient))
        # A search stays where it has arrived: after one more step the gradient may be larger.
        after = jnp.asarray(optax.apply_updates(state.standard, update))
        standard = jnp.where(length > _ARRIVED, after, state.standard)
        return _SearchState(standard, optimizer_state, length, state.steps + 1)

    def goes_on(state: _SearchState) -> Booleans:
        """Return whether the search has not arrived."""
        return (state.length > _ARRIVED) & (state.steps < _MOST_STEPS)

    standard = (start - prior.mean) / prior.width
    infinite = jnp.asarray(jnp.inf, standard.dtype)
    first = _SearchState(standard, optimizer.init(standard), infinite, jnp.asarray(0))
    last = jax.lax.while_loop(goes_on, advance, first)
    return Searched(
        free=jnp.asarray(prior.mean + prior.width * last.standard),
        loss=compute_value(last.standard),
        converged=last.length <= _ARRIVED,
        steps=last.steps,
    )


@functools.partial(jax.jit, static_argnames="grouped")
def _compute_curvature(
    free: Reals, prior: Prior, points: Points, data: TestData, counts: Reals, grouped: bool
) -> Reals:
    """Compute second derivatives of the loss, of numbers in deviations of the prior."""
    standard = (free - prior.mean) / prior.width
    return jax.hessian(compute_loss)(standard, prior, points, data, counts, grouped)


def search_population(
    prior: Prior,
    points: Points,
    data: TestData,
    counts: np.ndarray,
    *,
    grouped: bool,
    start: Reals | None = None,
) -> Searched:
    """Search the population that fits the tests that count best.

    Parameters
    ----------
    prior : Prior
    points : Points
    data : TestData
    counts : ndarray, shape (tests,)
        1 for tests that count, 0 for others.
    grouped : bool
        Whether the tests of a group share a deviation.
    start : Array, shape (12,), optional
        Free numbers at which to start, instead of those of blocks that explain most tests.
    """
    prior, weight = _convert(prior, counts, points)
    starts = [start] if start is not None else _choose_starts(prior, points, data, weight)
    ends = [_search(start, prior, points, data, weight, grouped) for start in starts]
    # NaN, as of a search that left all blocks behind, is never the best.
    losses = np.nan_to_num([float(end.loss) for end in ends], nan=math.inf)
    return ends[int(np.argmin(losses))]


def compute_covariance(
    searched: Searched,
    prior: Prior,
    points: Points,
    data: TestData,
    counts: np.ndarray,
    *,
    grouped: bool,
) -> np.ndarray:
    """Compute the covariance of free numbers, shape (12, 12), by the curvature at the mode."""
    prior, weight = _convert(prior, counts, points)
    curvature = _compute_curvature(searched.free, prior, points, data, weight, grouped)
    # The prior alone has a curvature of 1: less is where the likelihood has no peak, of which
    # the prior then says all.
    values, vectors = np.linalg.eigh(np.asarray(curvature, float))
    standard = (vectors / np.maximum(values, 1.0)) @ vectors.T
    width = np.asarray(prior.width, float)
    return standard * width * width[:, None]


def _convert(prior: Prior, counts: np.ndarray, points: Points) -> tuple[Prior, Reals]:
    """Convert to the type of the points."""
    dtype = points.coordinates.dtype
    converted = Prior(*(jnp.asarray(numbers, dtype) for numbers in prior))
    return converted, jnp.asarray(counts, dtype)


def count_effective_blocks(searched: Searched, points: Points) -> float:
    """Count the blocks on which probabilities rest: 1 over the sum of squared weights."""
    weights = average_weights(unpack_population(searched.free), points)
    return float(1 / jnp.sum(weights**2))


def _choose_starts(
    prior: Prior, points: Points, data: TestData, counts: Reals
) -> Sequence[Reals]:
    """Choose populations from which to search: around the blocks that explain most tests."""
    agrees = data.outcomes == data.overturned[:, None]
    likelihood = jnp.where(agrees, 1 - _UNEXPLAINED, _UNEXPLAINED)
    of_blocks = counts @ jnp.log(likelihood)
    centred = points.coordinates - prior.mean[None, :3]
    standard = centred / prior.width[None, :3]
    log_prior = -0.5 * jnp.sum(standard**2, axis=1) - points.log_density
    starts = []
    mean = jnp.asarray(prior.mean)
    for power in _START_POWERS:
        weights = jax.nn.softmax(power * of_blocks + log_prior)
        starts.append(mean.at[:3].set(weights @ points.coordinates))
    return starts


def propose_blocks(searched: Searched, covariance: np.ndarray) -> NormalComponent:
    """Propose where to draw the blocks that a population needs, and its neighbours."""
    free = np.asarray(searched.free, float)
    population = unpack_population(searched.free)
    factor = np.asarray(to_normal(population).factor, float)
    proposed = factor @ factor.T + covariance[:3, :3]
    proposed[0, 0] += float(population.group_deviation) ** 2
    return NormalComponent(free[:3], np.linalg.cholesky(_WIDER**2 * proposed), 0.0)
