"""Levels at which a response to a record begins or ceases to exceed a threshold."""

from collections.abc import Callable

import jax
import numpy as np

from ..block import Block
from ..driven import RecordVariants
from ..ground_motion import Record, Suite
from ..overturning import uplift_factor
from ..resonance import RockingModel
from ..validation import AnyArray
from .lognormal import sum_powers

# Relative width of the interval in which a boundary is located, times the root of the number
# of samples, over which errors cancel. Over 20 records, the median of a curve is then known
# to 3e-4, and two rounds do for the levels that are chosen by default.
_WIDTH = 4e-3
# Parts into which an interval is divided at once, powers of 2. Without samples boundaries are
# few, and a batch takes as long for a few blocks as for some hundreds.
_PARTS = 8
_PARTS_WITH_SAMPLES = 2
# Blocks whose uplift is computed at once, so that one program does for any number of blocks.
# A single block, the usual case, has a program of its own.
_TOGETHER = 32


def sum_boundaries(
    exceeded: np.ndarray,
    levels: np.ndarray,
    evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray],
    samples: int,
) -> np.ndarray:
    """Locate the boundaries between levels, and sum powers of ln(level) over them.

    Parameters
    ----------
    exceeded : ndarray of bool, shape (cases, thresholds, levels)
    levels : ndarray, shape (levels,)
    evaluate : callable
        Takes indices of cases, of shape (n, 1), and levels for each, of shape (n, m); returns
        which thresholds are exceeded, of shape (n, m, thresholds).
    samples : int
        Number of samples of each object.

    Returns
    -------
    ndarray, shape (cases, thresholds, 3)
        See `BoundarySums`. It does not depend on the other cases.
    """
    cases, thresholds, places = np.nonzero(exceeded[..., 1:] != exceeded[..., :-1])
    begins = exceeded[cases, thresholds, places + 1]
    low = levels[places]
    high = levels[places + 1]
    width = _WIDTH * samples**0.5
    parts = _PARTS if samples == 1 else _PARTS_WITH_SAMPLES
    while True:
        (wide,) = np.nonzero(high > low * (1 + width))
        if not wide.size:
            break
        # One simulation answers for all thresholds with a boundary in the same interval.
        keys = np.stack([cases[wide], low[wide], high[wide]], axis=1)
        _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        row = wide[first]
        points = np.geomspace(low[row], high[row], parts + 1, axis=-1)
        outcomes = evaluate(cases[row, None], points[:, 1:-1])
        # Bisection, as `locate_crossings` does it: of several boundaries both find the same.
        of_crossing = which.reshape(-1)
        is_beyond = outcomes[of_crossing, :, thresholds[wide]] == begins[wide, None]
        below = np.zeros(wide.size, int)
        above = np.full(wide.size, parts)
        for _ in range(parts.bit_length() - 1):
            middle = (below + above) // 2
            beyond = is_beyond[np.arange(wide.size), middle - 1]
            above = np.where(beyond, middle, above)
            below = np.where(beyond, below, middle)
        low[wide] = points[of_crossing, below]
        high[wide] = points[of_crossing, above]
    terms = sum_powers(np.sqrt(low * high)[:, None], np.where(begins, 1.0, -1.0)[:, None])
    sums = np.zeros((*exceeded.shape[:2], 3))
    # One after the other along the levels.
    np.add.at(sums, (cases, thresholds), terms)
    return sums


def find_uplift_levels(
    block: Block,
    motions: Suite | RecordVariants,
    intensities: AnyArray,
    model: RockingModel,
) -> np.ndarray:
    """Find the level from which on each record lifts each block, in closed form.

    Parameters
    ----------
    block : Block, shape (blocks,)
    motions : Suite or RecordVariants
        As they are; the variants are those of the blocks.
    intensities : array_like, shape (records,) or (records, blocks)
        Their measure.
    model : Nonlinear or Linearized

    Returns
    -------
    ndarray, shape (records, blocks)
        Infinite where a record lifts a block with no factor.
    """
    records = motions.records
    number = len(np.asarray(block.half_width))
    factors = np.empty((len(records), number))
    if isinstance(motions, RecordVariants):
        which = np.ravel(motions.which)
        for variant in map(int, np.unique(which)):
            (places,) = np.nonzero(which == variant)
            some = _select_blocks(block, places)
            for k, record in enumerate(records):
                single = _select_variant(record, variant)
                factors[k, places] = _find_uplift_factors(some, single, model)
    else:
        for k, record in enumerate(records):
            factors[k] = _find_uplift_factors(block, record, model)
    return factors * np.asarray(intensities).reshape(len(records), -1)


def _find_uplift_factors(block: Block, record: Record, model: RockingModel) -> np.ndarray:
    """Find the factor on a record from which on it lifts each of some blocks."""
    number = len(np.asarray(block.half_width))
    together = 1 if number == 1 else _TOGETHER
    groups = []
    for start in range(0, number, together):
        # The last group is filled up with the last block.
        places = np.minimum(np.arange(start, start + together), number - 1)
        group = _select_blocks(block, places)
        groups.append(np.asarray(uplift_factor(group, record, model=model)))
    return np.concatenate(groups)[:number]


def _select_blocks(block: Block, places: np.ndarray) -> Block:
    """Select some blocks of an array."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[places], block)


def _select_variant(record: Record, variant: int) -> Record:
    """Select a variant of a record, whose samples have a leading axis of variants."""
    return jax.tree.map(
        lambda leaf: leaf if np.ndim(leaf) < 2 else np.asarray(leaf)[variant], record
    )
