"""Elasticities of the rate of overturning, at a point and over a change."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..block import Block
from ..driven import BatchResponse, respond_batch
from ..ground_motion import Suite
from ..host import Printed, format_table
from ..resonance import ModelLike, Nonlinear
from ..validation import Number, Numbers, Reals, as_real
from .hazard import Hazard
from .overturning_rate import OverturningRate, choose_levels, overturning_rate


class RateElasticities(Printed, eqx.Module):
    """Changes of the yearly rate in per cent for one per cent; see `rate_elasticities`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers of the block, and the restitution.
    slopes : Array, shape (names,)
        From the derivatives of the boundaries found [-].
    differences : Array, shape (names,)
        From the rates at both ends of the change [-].
    change : float
        Relative, to either side.
    found : OverturningRate
        The rate itself.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    slopes: Float[Array, " names"]
    differences: Float[Array, " names"]
    change: float = eqx.field(static=True)
    found: OverturningRate

    def __str__(self) -> str:
        over = {f"over_+-{100 * self.change:g}%": np.asarray(self.differences)}
        columns = {**over, "at_the_point": np.asarray(self.slopes)}
        return format_table("elasticities of the rate", self.names, **columns)


def rate_elasticities(
    block: Block,
    restitution: Number,
    suite: Suite,
    hazard: Hazard | Callable[..., Reals],
    measure: str = "pgv",
    levels: Numbers | None = None,
    *,
    change: float = 0.05,
    model: ModelLike = Nonlinear(),
) -> RateElasticities:
    """Compute how much the rate of overturning changes with each number, in two ways.

    The derivative of `overturning_rate` is exact for the boundaries found. Where a block rocks
    long before it overturns, many of these bound narrow windows and move fast, each its own
    way, and their sum is as irregular as they are: a small change says nothing about a larger
    one. The difference of the rates at both ends of a change averages over such windows. In
    these rates a boundary between two levels is where the line through their margins vanishes.
    Trust the slope where the two agree, and the difference where not.

    Parameters
    ----------
    block, restitution, suite, hazard, measure, levels, model
        As in `overturning_rate`.
    change : float
        Relative change to either side, greater than 0 and less than 0.5; no further than C = 1
        and kappa = 1.

    Returns
    -------
    RateElasticities
        NaN where the rate is 0.

    Raises
    ------
    ValueError
        As in `overturning_rate`, or if the change is out of range.
    """
    if not 0 < change < 0.5:
        raise ValueError(f"change must be greater than 0 and less than 0.5, got {change!r}")
    restitution = as_real("restitution", restitution)

    def compute_rate(block: Block, c: Reals) -> tuple[Reals, OverturningRate]:
        found = overturning_rate(block, c, suite, hazard, measure, levels, model=model)
        return found.rate, found

    slopes, found = jax.grad(compute_rate, argnums=(0, 1), has_aux=True)(block, restitution)
    names = (*vars(block), "restitution")
    at = np.array([float(value) for value in (*vars(block).values(), restitution)])
    slope = np.array([float(value) for value in (*vars(slopes[0]).values(), slopes[1])])
    # Every number in turn at both ends of its change.
    ends = np.stack([at * np.where(np.eye(at.size), 1 + s * change, 1) for s in (-1, 1)])
    least, most = (
        np.array(
            [{"inertia_ratio": one, "restitution": two}.get(name, three) for name in names]
        )
        for one, two, three in ((1, 0, 0), (np.inf, 1, np.inf))
    )
    # Not beyond the domains of the two numbers that have ends: kappa >= 1, 0 <= C <= 1.
    ends = np.clip(ends, least, most)
    # All blocks under all records at all levels, as one batch: a suite that is scaled to each
    # level, and blocks along an axis of their own.
    places = choose_levels(hazard, levels)
    *shape, c = (jnp.asarray(ends[..., k])[..., None] for k in range(at.size))
    scaled = suite.scaled(suite.factors(places, measure))
    response = respond_batch(Block(*shape), c, scaled, model=model)
    if not bool(response.complete.all()):
        raise ValueError("motion could not be followed to its end for every record and level")
    counted = _average_rates(hazard, np.asarray(places), response)
    spans = np.stack([np.diagonal(end) for end in ends])
    # A rate of 0 has no elasticity: NaN, without a warning.
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = (counted[1] - counted[0]) / (spans[1] - spans[0]) * at / float(found.rate)
        slope = slope * at / float(found.rate)
    return RateElasticities(names, jnp.asarray(slope), jnp.asarray(difference), change, found)


def _average_rates(
    hazard: Hazard | Callable[..., Reals], levels: np.ndarray, response: BatchResponse
) -> np.ndarray:
    """Average the rates of responses (records, ..., levels) over the records."""
    over = np.asarray(response.overturned)
    margin = np.asarray(response.margin)
    changes = over[..., 1:] != over[..., :-1]
    before = margin[..., :-1]
    after = margin[..., 1:]
    # A boundary is where the line through the two margins vanishes. Margins of blocks that
    # have toppled need not change their sign with the outcome: then it is taken in the middle.
    between = changes & (before * after < 0)
    share = np.where(between, before / np.where(between, before - after, 1), 0.5)
    boundaries = levels[:-1] ** (1 - share) * levels[1:] ** share
    signs = np.where(over[..., 1:], 1.0, -1.0)
    rates = np.asarray(hazard(np.where(changes, boundaries, levels[0])))
    rates = np.where(changes, signs * rates, 0).sum(axis=-1)
    rates += np.where(over[..., 0], float(hazard(levels[0])), 0)
    return rates.mean(axis=0)
