"""Outcomes of many objects in one batch, and the risk of each that is counted from them."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np

from ..block import Block, change_block
from ..ground_motion import Suite
from ..resonance import RockingModel
from ..sensitivity import Uncertain
from ..validation import AnyArray
from .counted_rate import Counting, count_rates, estimate_error_of_mean, find_outcomes
from .inventory import Inventory
from .lognormal import fit_lognormal
from .share_intervals import bound_shares
from .unseen import estimate_unseen_by_good_turing

# Numbers whose importance is told: what can be built or chosen for an object.
PARAMETERS = ("width", "height", "restitution")
CONFIDENCE = 0.95  # of the intervals of probabilities
_CHANGE = 0.1  # relative, to either side, for elasticities

# Takes blocks and restitutions along one axis; returns which overturn, of the shape (records,
# blocks, levels).
_Follow = Callable[[Block, AnyArray], np.ndarray]


class ObjectRisk(NamedTuple):
    """Answers for one object; see `assess_inventory` for what they are."""

    median: float
    dispersion: float
    probability: np.ndarray
    probability_low: np.ndarray
    probability_high: np.ndarray
    rate: float
    standard_error: float
    counting_error: float
    unseen: float
    elasticity: np.ndarray
    elasticity_error: np.ndarray
    remark: str


class _Outcomes(NamedTuple):
    """Outcomes of one object, with an axis of records first and one of levels last.

    Attributes
    ----------
    median : ndarray of bool, shape (records, levels)
    ends : ndarray of bool, shape (records, 2 * parameters, levels)
        The lower and the upper end of the first parameter, of the second one, and so on.
    spans : ndarray, shape (parameters,)
        Distance of both ends, over the parameter.
    drawn : ndarray of bool, shape (records, samples, levels)
        The medians alone where nothing is uncertain.
    """

    median: np.ndarray
    ends: np.ndarray
    spans: np.ndarray
    drawn: np.ndarray


def follow_rows(
    suite: Suite,
    strengths: np.ndarray,
    levels: np.ndarray,
    model: RockingModel,
    block: Block,
    restitution: AnyArray,
) -> np.ndarray:
    """Find which of many blocks overturn at all levels, (records, blocks, levels), at once."""
    leaves, form = jax.tree.flatten((block, restitution))
    dtype = np.asarray(restitution).dtype
    repeated = [np.repeat(np.asarray(leaf, dtype), levels.size) for leaf in leaves]
    block, restitution = jax.tree.unflatten(form, repeated)
    everywhere = np.tile(levels.astype(dtype), repeated[-1].size // levels.size)
    outcomes = find_outcomes(block, restitution, everywhere, suite, strengths, model)
    return outcomes.reshape(len(suite), -1, levels.size)


def follow_objects(
    inventory: Inventory, follow: _Follow, counting: Counting, samples: int, seed: int
) -> list[ObjectRisk]:
    """Follow all objects, their changes and their samples in one batch, and count."""
    certain, spans = _list_rows(inventory)
    number = len(inventory)
    rows = len(certain)
    # The rows of an object lie side by side: its medians and the ends of its changes.
    gathered = jax.tree.map(lambda *leaves: np.stack(leaves, axis=1).ravel(), *certain)
    uncertain = np.flatnonzero(np.asarray(inventory.restitution_scatter)).tolist()
    drawn = [_draw_object(inventory, k, samples, seed) for k in uncertain]
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves), gathered, *drawn)
    outcomes = follow(*whole)
    found = []
    for k in range(number):
        own = outcomes[:, k * rows : (k + 1) * rows]
        of_samples = own[:, :1]
        if k in uncertain:
            first = number * rows + uncertain.index(k) * samples
            of_samples = outcomes[:, first : first + samples]
        one = _Outcomes(own[:, 0], own[:, 1:], spans[k], of_samples)
        found.append(_summarize_object(one, counting))
    return found


def _list_rows(inventory: Inventory) -> tuple[list[tuple[Block, np.ndarray]], np.ndarray]:
    """List the objects, then with each parameter at both ends of its change; and the spans."""
    block = jax.tree.map(np.asarray, inventory.block)
    restitution = np.asarray(inventory.restitution)
    width = 2 * block.half_width
    values = (width, width * block.slenderness, restitution)
    rows = [(block, restitution)]
    spans = []
    for name, value in zip(PARAMETERS, values, strict=True):
        ends = [(value * (1 + sign * _CHANGE)).astype(value.dtype) for sign in (-1, 1)]
        if name == "restitution":
            # Not to 1: a block that loses no energy bounces on without end.
            ends[1] = np.minimum(ends[1], 0.5 * (value + 1)).astype(value.dtype)
            rows += [(block, end) for end in ends]
        else:
            rows += [(change_block(block, name, end), restitution) for end in ends]
        # A restitution of 0 has no elasticity: NaN, without a warning.
        with np.errstate(invalid="ignore"):
            spans.append((ends[1] - ends[0]) / value)
    return rows, np.stack(spans, axis=1)


def _draw_object(
    inventory: Inventory, number: int, samples: int, seed: int
) -> tuple[Block, np.ndarray]:
    """Draw samples of an object whose restitution is uncertain."""
    block, c = jax.tree.map(
        lambda leaf: leaf[number], (inventory.block, inventory.restitution)
    )
    scatter = {"restitution": float(inventory.restitution_scatter[number])}
    drawn = Uncertain(scatter, samples=samples, seed=seed).draw(block, c)
    dtype = np.asarray(inventory.restitution).dtype
    return jax.tree.map(lambda leaf: np.asarray(leaf, dtype), drawn[:2])


def _summarize_object(outcomes: _Outcomes, counting: Counting) -> ObjectRisk:
    """Count the rate of an object, its probabilities and its elasticities."""
    # Levels at which probabilities are told stand behind those that are counted.
    number = counting.levels.size
    overturned = outcomes.drawn[..., :number]
    records = len(overturned)
    counted = count_rates(overturned, counting)
    contributions = counted.contributions.mean(axis=1)
    rate = float(contributions.mean())
    scatter = contributions.std(ddof=1) if records > 1 else np.nan
    # A record counts by the share of its samples.
    shares = overturned.mean(axis=1).sum(axis=0)
    fit = fit_lognormal(counting.levels, shares, records)
    remarks = [f"lognormal curve: {fit.remark}"] if fit.remark else []
    if overturned[..., 0].any():
        remarks.append(
            "overturns at the lowest level of the hazard, so that the rate may be more"
        )
    probability = outcomes.drawn[..., number:].mean(axis=1).sum(axis=0)
    low, high = bound_shares(probability, records, CONFIDENCE)
    elasticity, error = _compute_elasticities(outcomes, counting)
    unseen = estimate_unseen_by_good_turing(overturned.reshape(-1, number), counting.rates)
    return ObjectRisk(
        median=fit.median,
        dispersion=fit.dispersion,
        probability=probability / records,
        probability_low=low,
        probability_high=high,
        rate=rate,
        standard_error=float(scatter / np.sqrt(records)),
        counting_error=float(estimate_error_of_mean(overturned, counting)),
        unseen=float(unseen),
        elasticity=elasticity,
        elasticity_error=error,
        remark="; ".join(remarks),
    )


def _compute_elasticities(
    outcomes: _Outcomes, counting: Counting
) -> tuple[np.ndarray, np.ndarray]:
    """Compute elasticities of the rate over a change, and their errors by the levels."""
    number = counting.levels.size
    rate = count_rates(outcomes.median[..., :number], counting).rate
    ends = count_rates(outcomes.ends[..., :number], counting)
    differences = ends.rate[1::2] - ends.rate[::2]
    errors = np.hypot(ends.error[1::2], ends.error[::2])
    # A rate of 0 has no elasticity: NaN, without a warning.
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = 1 / (rate * outcomes.spans)
        scale = np.where(np.isfinite(scale), scale, np.nan)
        return differences * scale, errors * scale
