"""Brackets of all sign changes of a margin along a range.

The margin is sampled, and intervals in which a sign change might hide are halved. The cases of
an array are searched together. Outside of a transformation NumPy does the bookkeeping, and the
margin is computed only where it is needed.
"""

import functools
from collections.abc import Callable
from types import ModuleType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..validation import AnyArray

_CALL_SIZE = 2**18  # values at which the margins are computed in one call, at most


class EvaluatedMargin(NamedTuple):
    """A margin at a value, and what else a search needs there; arrays of one shape."""

    margin: AnyArray
    mode: AnyArray  # an integer that changes where the margin may have a kink or a jump
    note: AnyArray  # a real number that plays no role in the search; both ends keep theirs


# From indices of cases and values to evaluations there.
Evaluate = Callable[[AnyArray, AnyArray], EvaluatedMargin]


class Brackets(NamedTuple):
    """Pairs of neighbouring values between which the margin changes its sign.

    Of `ends` and `evaluations` the first two belong to the pair. The third is a neighbour
    outside of it, or one of the two once more where there is none.
    """

    case: AnyArray  # index of the case that a pair belongs to
    column: AnyArray  # index among the pairs of that case
    valid: AnyArray  # False if a pair only fills the list, which has a fixed length if traced
    ends: tuple[AnyArray, ...]
    evaluations: tuple[EvaluatedMargin, ...]
    sign_changes: AnyArray  # number of sign changes of each case
    negative_first: AnyArray  # whether the margin of each case is negative at its first value
    complete: AnyArray  # False for a case with a margin that is NaN, in which none is listed


class _Samples(NamedTuple):
    """Samples, sorted by case and value."""

    case: AnyArray
    place: AnyArray  # index in the finest division
    value: AnyArray
    evaluation: EvaluatedMargin


def find_brackets(evaluate: Evaluate, values: np.ndarray, levels: int) -> Brackets:
    """Find all sign changes along increasing values of shape (cases, values).

    An interval is halved up to `levels` times where a sign change might hide in it.
    """
    cases, places = values.shape

    def sample(case: AnyArray, place: AnyArray, value: AnyArray) -> _Samples:
        # At least one call, even for no values: nothing at all cannot be joined.
        starts = range(0, max(len(value), 1), _CALL_SIZE)
        parts = [evaluate(case[k : k + _CALL_SIZE], value[k : k + _CALL_SIZE]) for k in starts]
        evaluation = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
        return _Samples(case, place, value, evaluation)

    place = np.tile(np.arange(places) << levels, cases)
    samples = sample(np.repeat(np.arange(cases), places), place, values.reshape(-1))
    for level in reversed(range(levels)):
        # Only intervals that the level before has made: one that looked harmless stays whole.
        left = _find_suspicious(samples, 2 << level)
        place = samples.place[left] + (1 << level)
        value = 0.5 * (samples.value[left] + samples.value[left + 1])
        between = sample(samples.case[left], place, value)
        samples = jax.tree.map(
            lambda old, new, left=left: np.insert(old, left + 1, new), samples, between
        )

    case, place, value, evaluation = samples
    negative = evaluation.margin < 0
    # A case with a gap lists nothing: a sign change in the gap would not be detected.
    complete = np.bincount(case, np.isnan(evaluation.margin), cases) == 0
    change = (case[1:] == case[:-1]) & (negative[1:] != negative[:-1])
    left = np.flatnonzero(change & complete[case[:-1]])
    count = np.bincount(case[left], minlength=cases)
    column = np.arange(left.size) - (np.cumsum(count) - count)[case[left]]
    by_case = (count, negative[place == 0], complete)
    return _list_pairs(samples, left, column, left >= 0, by_case, np)


def _find_suspicious(samples: _Samples, width: int) -> np.ndarray:
    """Find the intervals, `width` places wide, in which a sign change might hide.

    Returns the indices of their left samples.
    """
    # Intervals in which the mode changes, with those on either side; and those in which the
    # margin would reach 0 from an end at twice the steepest slope that counts: the interval's
    # own, unless it is straight with its neighbours, and a neighbour's that heads for 0. A
    # line through 0 that is straight with its neighbours has no other zero.
    #
    #    o         o        o              o---o---o---o          o
    #     \       /          \                                     \
    #      o     o            o                                     o
    #       `   '              \                               - - - \ - - - 0
    #   - - -` '- - 0     - - - o - - 0     - - - - - - - 0            o
    #                                                                   \
    #   neighbours head   steep, with one    level and far      straight through 0:
    #   for 0: look       end near 0: look   from 0: do not     do not
    case, place, value, (margin, mode, _) = samples
    same_case = case[1:] == case[:-1]

    # Where an interval lies between two cases its slope is 0, which reaches nothing.
    rise = np.where(same_case, np.diff(margin), 0.0)
    slope = rise / np.where(same_case, np.diff(value), 1)
    before = np.roll(slope, 1)
    after = np.roll(slope, -1)
    before[:1] = after[-1:] = 0
    steepness = abs(slope)

    # Straight: the slopes on either side are between half and twice this one.
    low = np.minimum(before * slope, after * slope)
    high = np.maximum(abs(before), abs(after))
    straight = (low > slope**2 / 2) & (high < 2 * steepness)
    straight[1:] &= same_case[:-1]
    straight[:-1] &= same_case[1:]

    # The steepest slope that may lead from each end to 0. The slope of a neighbour counts only
    # where it heads for 0, seen from this end.
    first = margin[:-1]
    second = margin[1:]
    counted = np.where(straight, 0, steepness)
    from_first = np.maximum(counted, np.where(before * first < 0, abs(before), 0))
    from_second = np.maximum(counted, np.where(after * second > 0, abs(after), 0))
    reach = 2 * np.diff(value)
    reached = (from_first * reach > abs(first)) | (from_second * reach > abs(second))

    crosses = (first < 0) != (second < 0)
    new_mode = same_case & (mode[1:] != mode[:-1])
    suspicious = new_mode | (reached & ~(straight & crosses))
    suspicious[1:] |= new_mode[:-1]
    suspicious[:-1] |= new_mode[1:]
    return np.flatnonzero(suspicious & same_case & (np.diff(place) == width))


def _list_pairs(
    samples: _Samples,
    left: AnyArray,
    column: AnyArray,
    valid: AnyArray,
    by_case: tuple[AnyArray, AnyArray, AnyArray],
    library: ModuleType,
) -> Brackets:
    """List pairs of neighbouring samples by the left ones, and a neighbour of each.

    The ends are swapped where the neighbour lies behind the right one, so that the three are
    in a row, as Chandrupatla's method leaves them. Where there is none it is the left end.
    """
    case, _, value, evaluation = samples

    def exists(at: AnyArray) -> AnyArray:
        """Return whether the samples go on with the same case."""
        return library.append(case, -1)[at.clip(-1, case.size)] == case[left]

    before = exists(left - 1)
    beyond = library.where(exists(left + 2), left + 2, left)
    first = library.where(before, left, left + 1)
    second = library.where(before, left + 1, left)
    third = library.where(before, left - 1, beyond)
    # A bracket of no width where there is none.
    ends = [library.where(valid, at, left) for at in (first, second, third)]
    evaluations = (jax.tree.map(lambda leaf, at=at: leaf[at], evaluation) for at in ends)
    values = tuple(value[at] for at in ends)
    return Brackets(case[left], column, valid, values, tuple(evaluations), *by_case)


def find_brackets_traced(
    evaluate: Evaluate, values: jax.Array, levels: int, max_boundaries: int
) -> Brackets:
    """Find the first sign changes of each case in a transformation.

    Shapes must not depend on margins: every interval is halved `levels` times, and each case
    has `max_boundaries` pairs, some of which only fill the list.
    """
    # From the left end, so that the given values themselves keep all bits.
    fraction = jnp.arange(1 << levels, dtype=values.dtype) / (1 << levels)
    widths = values[:, 1:, None] - values[:, :-1, None]
    inner = values[:, :-1, None] + widths * fraction[None, None]
    value = jnp.concatenate([inner.reshape(len(values), -1), values[:, -1:]], axis=1)
    cases, places = value.shape
    case = jnp.repeat(jnp.arange(cases), places)
    place = jnp.tile(jnp.arange(places), cases)
    value = value.reshape(-1)
    samples = _Samples(case, place, value, evaluate(case, value))
    margin = samples.evaluation.margin.reshape(cases, places)
    complete = ~jnp.isnan(margin).any(axis=1)
    negative = margin < 0
    change = (negative[:, 1:] != negative[:, :-1]) & complete[:, None]
    # The places of the changes first, then one that stands for none.
    none = places - 1
    list_changes = functools.partial(jnp.flatnonzero, size=max_boundaries, fill_value=none)
    left = jax.vmap(list_changes)(change)
    valid = left < none
    # The first sample of the case where there is no pair.
    left = jnp.where(valid, left, 0) + places * jnp.arange(cases)[:, None]
    column = jnp.tile(jnp.arange(max_boundaries), cases)
    by_case = (change.sum(axis=1), negative[:, 0], complete)
    return _list_pairs(samples, left.reshape(-1), column, valid.reshape(-1), by_case, jnp)
