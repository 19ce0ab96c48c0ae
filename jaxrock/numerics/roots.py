"""All sign changes of a margin along a range: intervals are halved where one might hide.

The cases of an array are searched together. Outside of a transformation NumPy does the
bookkeeping, and the margin is computed only where it is needed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

_TOGETHER = 2**18  # values at which the margins are computed in one call, at most
# As many values as take the time of one: 64 SIMD lanes on each of two cores. A fixed number,
# so that every machine finds the same sign changes to the last bit.
_LANES = 128
_MOST_LEVELS = 5  # of bisections at once
_ITERATIONS = 200  # bisection alone needs fewer from any bracket of two floating-point numbers

# From indices of cases and values: the margins there, and the modes of the motion.
MarginAndMode = Callable[[Any, Any], tuple[Any, Any]]


class Brackets(NamedTuple):
    """Pairs of neighbouring values between which the margin changes its sign."""

    case: Any  # index of the case that a pair belongs to
    column: Any  # index among the pairs of that case
    valid: Any  # False if a pair only fills the list, which has a fixed length when traced
    ends: tuple[Any, ...]  # and a value beyond the first of them, or the second once more
    margins: tuple[Any, ...]
    count: Any  # number of sign changes of each case
    negative_first: Any
    complete: Any


class _Samples(NamedTuple):
    """Samples of the margins, sorted by case and value."""

    case: Any
    place: Any  # index in the finest division
    value: Any
    margin: Any
    mode: Any


def brackets(margin_and_mode: MarginAndMode, values: Any, levels: int) -> Brackets:
    """All sign changes for increasing values of shape (cases, values).

    An interval is halved up to `levels` times where a sign change might hide in it.
    """
    cases, places = values.shape

    def sampled(case: Any, place: Any, value: Any) -> _Samples:
        starts = range(0, max(len(value), 1), _TOGETHER)
        parts = [
            margin_and_mode(*(x[k : k + _TOGETHER] for x in (case, value))) for k in starts
        ]
        return _Samples(case, place, value, *map(np.concatenate, zip(*parts, strict=True)))

    place = np.tile(np.arange(places) << levels, cases)
    samples = sampled(np.repeat(np.arange(cases), places), place, values.reshape(-1))
    for level in reversed(range(levels)):
        left = _suspicious(samples, 2 << level)
        place = samples.place[left] + (1 << level)
        value = 0.5 * (samples.value[left] + samples.value[left + 1])
        columns = zip(samples, sampled(samples.case[left], place, value), strict=True)
        samples = _Samples(*(np.insert(old, left + 1, new) for old, new in columns))
    case = samples.case
    margin = samples.margin
    complete = np.bincount(case, np.isnan(margin), cases) == 0
    change = (case[1:] == case[:-1]) & ((margin[1:] < 0) != (margin[:-1] < 0))
    left = np.flatnonzero(change & complete[case[:-1]])
    count = np.bincount(case[left], minlength=cases)
    ends = _with_neighbour(
        left, lambda at: np.append(case, -1)[at.clip(-1, case.size)] == case[left], np
    )
    return Brackets(
        case=case[left],
        column=np.arange(left.size) - (np.cumsum(count) - count)[case[left]],
        valid=np.ones(left.size, bool),
        ends=tuple(samples.value[at] for at in ends),
        margins=tuple(margin[at] for at in ends),
        count=count,
        negative_first=margin[samples.place == 0] < 0,
        complete=complete,
    )


def _suspicious(samples: _Samples, width: int) -> Any:
    """Left samples of the intervals, `width` places wide, in which a sign change might hide."""
    # Intervals in which the mode changes, with those on either side; and those in which the
    # margin would reach 0 from an end at twice the slope of the interval or, if that heads for
    # 0, of the interval next to it. A line through 0 that is straight with its neighbours has
    # no other zero.
    #
    #    o         o        o              o---o---o---o          o
    #     \       /          \                                     \
    #      o     o            o                                     o
    #       `   '              \                               - - - \ - - - 0
    #   - - -` '- - 0     - - - o - - 0     - - - - - - - 0            o
    #                                                                   \
    #   neighbours head   steep, with one    level and far      straight through 0:
    #   for 0: look       end near 0: look   from 0: do not     do not
    case, place, value, margin, mode = samples
    same_case = case[1:] == case[:-1]
    rise = np.where(same_case, np.diff(margin), 0.0)
    slope = rise / np.where(same_case, np.diff(value), 1)
    before = np.roll(slope, 1)
    after = np.roll(slope, -1)
    before[:1] = after[-1:] = 0
    own = abs(slope)
    # Straight: the slopes on either side are between half and twice this one.
    low = np.minimum(before * slope, after * slope)
    high = np.maximum(abs(before), abs(after))
    straight = (low > slope**2 / 2) & (high < 2 * own)
    straight[1:] &= same_case[:-1]
    straight[:-1] &= same_case[1:]
    first = margin[:-1]
    second = margin[1:]
    own = np.where(straight, 0, own)
    from_first = np.maximum(own, np.where(before * first < 0, abs(before), 0))
    from_second = np.maximum(own, np.where(after * second > 0, abs(after), 0))
    reach = 2 * np.diff(value)
    reached = (from_first * reach > abs(first)) | (from_second * reach > abs(second))
    crosses = (first < 0) != (second < 0)
    new_mode = same_case & (mode[1:] != mode[:-1])
    suspicious = new_mode | (reached & ~(straight & crosses))
    suspicious[1:] |= new_mode[:-1]
    suspicious[:-1] |= new_mode[1:]
    return np.flatnonzero(suspicious & same_case & (np.diff(place) == width))


def _with_neighbour(
    left: Any, exists: Callable[[Any], Any], library: Any
) -> tuple[Any, Any, Any]:
    """Places of both ends of intervals, and of a neighbour beyond the first of the two."""
    before = (left > 0) & exists(left - 1)
    behind = exists(left + 2)
    beyond = library.where(behind, left + 2, left)
    first = library.where(before, left, left + 1)
    second = library.where(before, left + 1, left)
    return first, second, library.where(before, left - 1, beyond)


def brackets_traced(
    margin_and_mode: MarginAndMode, values: Any, levels: int, max_boundaries: int
) -> Brackets:
    """Find the first sign changes of each case, by halving every interval, in a transformation."""
    share = jnp.arange(1 << levels, dtype=values.dtype) / (1 << levels)
    inner = (
        values[:, :-1, None] + (values[:, 1:, None] - values[:, :-1, None]) * share[None, None]
    )
    value = jnp.concatenate([inner.reshape(len(values), -1), values[:, -1:]], axis=1)
    cases, places = value.shape
    index = jnp.broadcast_to(jnp.arange(cases)[:, None], value.shape)
    margin = margin_and_mode(index.reshape(-1), value.reshape(-1))[0].reshape(value.shape)
    complete = ~jnp.isnan(margin).any(axis=1)
    negative = margin < 0
    change = (negative[:, 1:] != negative[:, :-1]) & complete[:, None]
    # The places of the changes first, then a number that stands for none.
    none = places - 1
    numbers = jnp.where(change, jnp.arange(none)[None, :], none)
    numbers = jnp.pad(numbers, ((0, 0), (0, max_boundaries)), constant_values=none)
    left = jnp.sort(numbers, axis=1)[:, :max_boundaries].reshape(-1)
    valid = left < none
    case = jnp.repeat(jnp.arange(cases), max_boundaries)
    left = jnp.where(valid, left, 0)
    ends = _with_neighbour(left, lambda at: at < places, jnp)
    # A bracket of no width where there is none.
    ends = [jnp.where(valid, at, left) for at in ends]
    return Brackets(
        case=case,
        column=jnp.tile(jnp.arange(max_boundaries), cases),
        valid=valid,
        ends=tuple(value[case, at] for at in ends),
        margins=tuple(margin[case, at] for at in ends),
        count=change.sum(axis=1),
        negative_first=negative[:, 0],
        complete=complete,
    )


class _Iterate(NamedTuple):
    """Three values and their margins; the sign changes between the first two."""

    x: tuple[Any, ...]
    f: tuple[Any, ...]
    tolerance: Any

    def converged(self) -> Any:
        return abs(self.x[1] - self.x[0]) <= self.tolerance


def located(
    margin: Callable[[Any, Any], Any], pairs: Brackets, traced: bool, alone: bool = False
) -> tuple[Any, Any, Any]:
    """Locate the values on both sides of each sign change, to rounding.

    Concrete ones are sought in the way that is fastest for so many; to be found as if each
    were `alone`, by one method whatever their number.

    Returns the value where the margin is not negative, that where it is, and the margin at the
    first: NaN where the search failed.
    """
    library: Any = jnp if traced else np
    ends = pairs.ends
    margins = pairs.margins
    eps = float(jnp.finfo(ends[0].dtype).eps)
    tolerance = 4 * eps * library.maximum(abs(ends[0]), abs(ends[1]))
    iterate = _Iterate(ends, margins, tolerance)
    if traced:
        _, iterate = jax.lax.while_loop(
            lambda state: (state[0] < _ITERATIONS) & ~state[1].converged().all(),
            lambda state: (state[0] + 1, _chandrupatla(margin, state[1], pairs.case, jnp)),
            (0, iterate),
        )
    else:
        iterate = jax.tree.map(np.array, iterate)  # which is then changed in place
        for _ in range(_ITERATIONS):
            wide = np.flatnonzero(~iterate.converged())
            if not wide.size:
                break
            leaves, structure = jax.tree.flatten(iterate)
            selected = jax.tree.unflatten(structure, [leaf[wide] for leaf in leaves])
            # Few values take as long as a batch of them, so that all of it is used.
            parts = _LANES // wide.size
            if alone:
                levels = max((parts + 1).bit_length() - 1, 1)
                better = _ahead(margin, selected, pairs.case[wide], min(levels, _MOST_LEVELS))
            elif parts >= 4:
                better = _multisection(margin, selected, pairs.case[wide], parts // 4 * 4)
            else:
                better = _chandrupatla(margin, selected, pairs.case[wide], np)
            for leaf, new in zip(leaves, jax.tree.leaves(better), strict=True):
                leaf[wide] = new
    x1, x2, _ = iterate.x
    f1, f2, _ = iterate.f
    first = f1 >= 0
    success = iterate.converged() & library.isfinite(f1 + f2)
    stands = library.where(first, x1, x2)
    falls = library.where(first, x2, x1)
    return stands, falls, library.where(success, library.where(first, f1, f2), library.nan)


def _chandrupatla(margin: Any, iterate: _Iterate, case: Any, library: Any) -> _Iterate:
    """Take a step of Chandrupatla's method."""
    x = _proposed(iterate, library)
    return _with_margin(iterate, x, margin(case, x), library)


def _proposed(iterate: _Iterate, library: Any) -> Any:
    """Propose where to look next, by Chandrupatla's method.

    By inverse quadratic interpolation where that is safe, bisection where not, as at a jump.
    """
    (x1, x2, x3), (f1, f2, f3), tolerance = iterate
    with np.errstate(all="ignore"):
        xi = (x1 - x2) / (x3 - x2)
        phi = (f1 - f2) / (f3 - f2)
        inner = f1 / (f2 - f1) * f3 / (f2 - f3)
        outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        least = tolerance / (2 * abs(x2 - x1))
        smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        share = library.where(smooth, inner + outer, 0.5)
    share = library.clip(share, least, 1 - least)
    return library.where(iterate.converged(), x1, x1 + share * (x2 - x1))


def _with_margin(iterate: _Iterate, x: Any, f: Any, library: Any) -> _Iterate:
    """Shrink the interval of the sign change to one that ends at a value inside."""
    (x1, x2, _), (f1, f2, _), tolerance = iterate
    same = (f < 0) == (f1 < 0)
    others = [library.where(same, *pair) for pair in ((x2, x1), (x1, x2), (f2, f1), (f1, f2))]
    new = _Iterate((x, *others[:2]), (f, *others[2:]), tolerance)
    done = iterate.converged()
    return jax.tree.map(lambda old, new: library.where(done, old, new), iterate, new)


def _ahead(margin: Any, iterate: _Iterate, case: Any, levels: int) -> _Iterate:
    """Up to so many steps of Chandrupatla's method at once, to the same bits.

    At a jump nearly all of them are bisections: margins are computed where these would look,
    and the method is followed as far as they go.
    """
    (x1, x2, _), _, _ = iterate
    x = _proposed(iterate, np)
    tried = [x]
    halves = [(x, x2), (x, x1)]
    for _ in range(levels - 1):
        middles = [near + 0.5 * (far - near) for near, far in halves]
        tried += middles
        halves = [
            (middle, end)
            for middle, ends in zip(middles, halves, strict=True)
            for end in reversed(ends)
        ]
    at = np.stack(tried, axis=1)
    margins = margin(np.repeat(case, at.shape[1]), at.reshape(-1)).reshape(at.shape)
    rows = np.arange(len(at))
    for _ in range(levels):
        x = _proposed(iterate, np)
        found = at == x[:, None]
        known = found.any(axis=1)
        better = _with_margin(iterate, x, margins[rows, found.argmax(axis=1)], np)
        iterate = jax.tree.map(
            lambda old, new, k=known: np.where(k, new, old), iterate, better
        )
    return iterate


def _multisection(margin: Any, iterate: _Iterate, case: Any, parts: int) -> _Iterate:
    """Choose the best of `parts` intervals between the first two values.

    Half of the values are equidistant, the others approach the secant's root from both sides.
    """
    (x1, x2, _), (f1, f2, _), tolerance = iterate
    span = x2 - x1
    with np.errstate(all="ignore"):
        guess = f1 / (f1 - f2)
        least = tolerance / (4 * abs(span))
    guess = np.where(np.isfinite(guess), guess, 0.5)
    even = (np.arange(parts // 2) + 1) / (parts // 2 + 1)
    # In a geometric sequence, down to where floating-point numbers no longer differ.
    near = least[:, None] ** (1 - np.arange(parts // 4) / (parts // 4))[None]
    near = np.concatenate([guess[:, None] - near, guess[:, None] + near], axis=1)
    share = np.concatenate([np.broadcast_to(even, (len(x1), even.size)), near], axis=1)
    share = np.sort(np.clip(share, least[:, None], 1 - least[:, None]), axis=1)
    x = (x1[:, None] + share * span[:, None]).astype(x1.dtype)
    f = margin(np.repeat(case, x.shape[1]), x.reshape(-1)).reshape(x.shape)
    x = np.concatenate([x1[:, None], x, x2[:, None]], axis=1)
    f = np.concatenate([f1[:, None], f, f2[:, None]], axis=1)
    left = ((f[:, 1:] < 0) != (f[:, :-1] < 0)).argmax(axis=1)
    third = np.where(left > 0, left - 1, left + 2)
    rows = np.arange(len(x1))
    x, f = (tuple(part[rows, at] for at in (left, left + 1, third)) for part in (x, f))
    return _Iterate(x, f, tolerance)
