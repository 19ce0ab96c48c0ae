"""Elasticities of the rate of overturning, at a point and over a change."""

from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..block import SIZES_IN_WORDS, Block
from ..driven import BatchResponse, respond_batch
from ..ground_motion import Suite
from ..host import Printed, format_fields, format_table
from ..resonance import ModelLike, Nonlinear
from ..validation import AnyArray, Number, Numbers, Reals
from .counted_rate import AT_ONCE
from .hazard import Hazard
from .objects import Objects, gather_objects
from .overturning_rate import OverturningRate, choose_levels, overturning_rate


class RateElasticities(Printed, eqx.Module):
    """Changes of the yearly rate in per cent for one per cent; see `rate_elasticities`.

    Attributes
    ----------
    names : tuple of str
        Of the numbers of the block, and the restitution.
    slopes : Array, shape (names, ...)
        From the derivatives of the boundaries found [-].
    differences : Array, shape (names, ...)
        From the rates at both ends of the change [-].
    change : float
        Relative, to either side.
    found : OverturningRate
        The rate itself.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    slopes: Float[Array, " names ..."]
    differences: Float[Array, " names ..."]
    change: float = eqx.field(static=True)
    found: OverturningRate

    def __str__(self) -> str:
        if np.ndim(self.found.rate):
            return format_fields(self, slopes="", differences="")
        over = {f"over_+-{100 * self.change:g}%": np.asarray(self.differences)}
        columns = {**over, "at_the_point": np.asarray(self.slopes)}
        labels = [SIZES_IN_WORDS.get(name, name) for name in self.names]
        return format_table("elasticities of the rate", labels, **columns)


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
    sides: bool = False,
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
        Relative change to either side, greater than 0 and less than 0.5; no further than
        kappa = 1, and halfway to C = 1.
    sides : bool
        Whether the numbers are the width at this height and the height at this width, instead
        of the half-width at this slenderness and the slenderness.

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
    objects = gather_objects(block, restitution)
    numbers = _list_numbers(objects, sides)

    def sum_rates(numbers: Mapping[str, Reals]) -> tuple[Reals, OverturningRate]:
        found = overturning_rate(
            *_make_blocks(numbers), suite, hazard, measure, levels, model=model
        )
        # Each rate depends on the numbers of its own object only.
        return found.rate.sum(), found

    slopes, found = jax.grad(sum_rates, has_aux=True)(numbers)
    names = tuple(numbers)
    at = np.stack([np.asarray(value, float) for value in numbers.values()])
    slope = np.stack([np.asarray(slopes[name], float) for name in names])
    ends = _change_in_turn(names, at, change)
    counted = _count_at_ends(ends, names, suite, hazard, measure, levels, model)
    spans = np.stack([ends[1, k, k] - ends[0, k, k] for k in range(len(names))])
    rate = np.asarray(found.rate)
    # Between two levels the line through the margins is no more than a guess, which shifts all
    # rates alike: hence their own mean, and not the rate summed over boundaries. A rate of 0
    # has no elasticity: NaN, without a warning.
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = (counted[1] - counted[0]) / spans * at / counted.mean(axis=0)
        slope = slope * at / rate
    missing = rate == 0
    difference = np.where(missing, np.nan, difference)
    dtype = found.rate.dtype
    return RateElasticities(
        names,
        jax.device_put(slope.astype(dtype)),
        jax.device_put(difference.astype(dtype)),
        change,
        found,
    )


def _list_numbers(objects: Objects, sides: bool) -> dict[str, AnyArray]:
    """List the numbers of the objects by their names."""
    block = objects.block
    size = {"half_width": block.half_width, "slenderness": block.slenderness}
    if sides:
        width = 2 * np.asarray(block.half_width)
        size = {"width": width, "height": width * np.asarray(block.slenderness)}
    rest = {"gravity": block.gravity, "inertia_ratio": block.inertia_ratio}
    numbers = {**size, **rest, "restitution": objects.restitution}
    return {name: jnp.asarray(value) for name, value in numbers.items()}


def _make_blocks(numbers: Mapping[str, AnyArray]) -> tuple[Block, AnyArray]:
    """Make the blocks of such numbers, and their restitutions."""
    if "width" in numbers:
        half_width = numbers["width"] / 2
        slenderness = numbers["height"] / numbers["width"]
    else:
        half_width = numbers["half_width"]
        slenderness = numbers["slenderness"]
    block = Block(half_width, slenderness, numbers["gravity"], numbers["inertia_ratio"])
    return block, numbers["restitution"]


def _change_in_turn(names: Sequence[str], at: np.ndarray, change: float) -> np.ndarray:
    """Change every number in turn to both ends: shape (2, changed, numbers, ...)."""
    # Not beyond the domains of the two numbers that have ends: kappa >= 1, 0 <= C <= 1. With
    # C = 1 exactly a block would bounce without end, so that C goes halfway there at most.
    least = {"inertia_ratio": 1.0, "restitution": 0.0}
    ends = np.tile(at, (2, len(names), *(1 for _ in at.shape)))
    for k, name in enumerate(names):
        most = 0.5 * (1 + at[k]) if name == "restitution" else np.inf
        for end, sign in enumerate((-1, 1)):
            changed = at[k] * (1 + sign * change)
            ends[end, k, k] = np.clip(changed, least.get(name, 0.0), most)
    return ends


def _count_at_ends(
    ends: np.ndarray,
    names: Sequence[str],
    suite: Suite,
    hazard: Hazard | Callable[..., Reals],
    measure: str,
    levels: Numbers | None,
    model: ModelLike,
) -> np.ndarray:
    """Count the rates at both ends of every change: shape (2, changed, ...)."""
    places = choose_levels(hazard, levels)
    scaled = suite.scaled(suite.factors(places, measure))
    shape = ends.shape[3:]
    flat = ends.reshape(*ends.shape[:3], -1)
    together = max(1, AT_ONCE // (flat.shape[0] * flat.shape[1] * len(suite) * len(places)))

    def count_group(start: int) -> np.ndarray:
        # All blocks under all records at all levels, as one batch: a suite that is scaled to
        # each level, and blocks along axes of their own.
        group = flat[..., start : start + together]
        numbers = {n: jnp.asarray(group[:, :, k])[..., None] for k, n in enumerate(names)}
        block, restitution = _make_blocks(numbers)
        response = respond_batch(block, restitution, scaled, model=model)
        if not bool(response.complete.all()):
            raise ValueError(
                "motion could not be followed to its end for every record and level"
            )
        return _average_rates(hazard, np.asarray(places), response)

    parts = [count_group(start) for start in range(0, flat.shape[-1], together)]
    return np.concatenate(parts, axis=-1).reshape(*ends.shape[:2], *shape)


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
