"""Every sign change of a margin in a range: found by halving where one might hide, refined.

On arrays of cases, as fast as the margins are computed. Outside of a transformation NumPy
does the bookkeeping, and only what is needed is computed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

_TOGETHER = 2**18  # values tried at once
# Values tried in the time of one, by two cores of 64 lanes each. The same number on every machine,
# so that all find the same boundaries to the last bit.
_LANES = 128
_ITERATIONS = 200

# Of the cases with given indices, at given values: margins, and modes of the motion.
Followed = Callable[[Any, Any], tuple[Any, Any]]


class Brackets(NamedTuple):
    """Pairs of neighbouring values between which the sign of the margin changes."""

    case: Any  # of each pair
    column: Any  # its number among the pairs of its case
    there: Any  # if not, the pair only fills the list
    ends: tuple[Any, Any]
    margins: tuple[Any, Any]
    count: Any  # of each case
    negative_first: Any
    complete: Any


def brackets(followed: Followed, tried: Any, halvings: int) -> Brackets:
    """All pairs, for increasing values of shape (cases, values).

    Intervals are halved so many times where a change of sign might hide.
    """
    cases = len(tried)
    rows = max(1, _TOGETHER // tried.shape[1])
    parts = [
        _part(followed, tried[start : start + rows], start, halvings)
        for start in range(0, max(cases, 1), rows)
    ]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


class _Points(NamedTuple):
    """What is known, case by case in the order of the values."""

    case: Any
    place: Any  # in the finest division
    value: Any
    margin: Any
    mode: Any


def _part(followed: Followed, tried: Any, first: int, halvings: int) -> Brackets:
    cases, places = tried.shape
    case = np.repeat(np.arange(cases), places)
    value = tried.reshape(-1)
    place = np.tile(np.arange(places) << halvings, cases)
    points = _Points(case, place, value, *followed(first + case, value))
    for level in reversed(range(halvings)):
        left = _suspicious(points, 2 << level)
        case, place = points.case[left], points.place[left] + (1 << level)
        value = 0.5 * (points.value[left] + points.value[left + 1])
        new = _Points(case, place, value, *followed(first + case, value))
        whole = zip(points, new, strict=True)
        points = _Points(*(np.insert(old, left + 1, more) for old, more in whole))
    case, margin = points.case, points.margin
    complete = np.bincount(case, np.isnan(margin), cases) == 0
    change = (case[1:] == case[:-1]) & ((margin[1:] < 0) != (margin[:-1] < 0))
    left = np.flatnonzero(change & complete[case[:-1]])
    count = np.bincount(case[left], minlength=cases)
    return Brackets(
        case=first + case[left],
        column=np.arange(left.size) - (np.cumsum(count) - count)[case[left]],
        there=np.ones(left.size, bool),
        ends=(points.value[left], points.value[left + 1]),
        margins=(margin[left], margin[left + 1]),
        count=count,
        negative_first=margin[points.place == 0] < 0,
        complete=complete,
    )


def _suspicious(points: _Points, width: int) -> Any:
    """After which points there is an interval so wide in which a change of sign might hide.

    Where sign or mode change, and on either side of a change of mode; and where the margin
    would reach 0 if it went on twice as fast as it does here or next to it.
    """
    case, place, value, margin, mode = points
    joined = case[1:] == case[:-1]
    rise = np.where(joined, np.diff(margin), 0.0)
    slope = rise / np.where(joined, np.diff(value), 1)
    before, after = np.roll(slope, 1), np.roll(slope, -1)
    before[:1] = after[-1:] = 0
    inside = abs(slope)
    # Where the margin goes straight on, only what it does next to here counts.
    low, high = np.minimum(before * slope, after * slope), np.maximum(abs(before), abs(after))
    straight = (low > slope**2 / 2) & (high < 2 * inside)
    straight[1:] &= joined[:-1]
    straight[:-1] &= joined[1:]
    first, second = margin[:-1], margin[1:]
    bent = np.where(straight, 0, inside)
    falls = np.maximum(bent, np.where(before * first < 0, abs(before), 0))
    comes = np.maximum(bent, np.where(after * second > 0, abs(after), 0))
    reach = 2 * np.diff(value)
    changes = joined & (mode[1:] != mode[:-1])
    across = (first < 0) != (second < 0)
    found = (falls * reach > abs(first)) | (comes * reach > abs(second))
    found = changes | (found & ~(straight & across))
    found[1:] |= changes[:-1]
    found[:-1] |= changes[1:]
    return np.flatnonzero(found & joined & (np.diff(place) == width))


def brackets_traced(followed: Followed, tried: Any, halvings: int, most: int) -> Brackets:
    """The first `most` pairs of each case, in a transformation: all halvings are made."""
    share = jnp.arange(1 << halvings, dtype=tried.dtype) / (1 << halvings)
    inner = tried[:, :-1, None] + (tried[:, 1:, None] - tried[:, :-1, None]) * share[None, None]
    value = jnp.concatenate([inner.reshape(len(tried), -1), tried[:, -1:]], axis=1)
    cases, places = value.shape
    index = jnp.broadcast_to(jnp.arange(cases)[:, None], value.shape)
    margin = followed(index.reshape(-1), value.reshape(-1))[0].reshape(value.shape)
    complete = ~jnp.isnan(margin).any(axis=1)
    negative = margin < 0
    change = (negative[:, 1:] != negative[:, :-1]) & complete[:, None]
    numbers = jnp.where(change, jnp.arange(places - 1)[None, :], places - 1)
    numbers = jnp.pad(numbers, ((0, 0), (0, most)), constant_values=places - 1)
    first = jnp.sort(numbers, axis=1)[:, :most].reshape(-1)
    there = first < places - 1
    case, place = jnp.repeat(jnp.arange(cases), most), jnp.where(there, first, 0)
    # Where there is none, a bracket of no width.
    other = jnp.where(there, place + 1, place)
    return Brackets(
        case=case,
        column=jnp.tile(jnp.arange(most), cases),
        there=there,
        ends=(value[case, place], value[case, other]),
        margins=(margin[case, place], margin[case, other]),
        count=change.sum(axis=1),
        negative_first=negative[:, 0],
        complete=complete,
    )


class _Progress(NamedTuple):
    """The last three values tried; the sign changes between the first two."""

    x: tuple[Any, Any, Any]
    f: tuple[Any, Any, Any]
    width: Any  # between which the change is known well enough

    def narrow(self) -> Any:
        return abs(self.x[1] - self.x[0]) <= self.width


def located(
    margin: Callable[[Any, Any], Any], found: Brackets, traced: bool
) -> tuple[Any, Any, Any]:
    """Both sides of each change, to rounding: not negative, negative; the margin on the first.

    By Chandrupatla's method, which is inverse quadratic interpolation where that is safe and
    bisection where it is not, as at a jump. NaN is the margin where that fails.
    """
    library: Any = jnp if traced else np
    ends, margins = found.ends, found.margins
    eps = float(jnp.finfo(ends[0].dtype).eps)
    width = 4 * eps * library.maximum(abs(ends[0]), abs(ends[1]))
    progress = _Progress((*ends, ends[1] + 0), (*margins, margins[1] + 0), width)

    def step(progress: _Progress, case: Any) -> _Progress:
        (x1, x2, x3), (f1, f2, f3), width = progress
        with np.errstate(all="ignore"):
            xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
            inner = f1 / (f2 - f1) * f3 / (f2 - f3)
            outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
            least = width / (2 * abs(x2 - x1))
        smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        share = library.where(smooth, inner + outer, 0.5)
        share = library.clip(share, least, 1 - least)
        done = progress.narrow()
        x = library.where(done, x1, x1 + share * (x2 - x1))
        f = margin(case, x)
        same = (f < 0) == (f1 < 0)
        kept = [library.where(same, *pair) for pair in ((x2, x1), (x1, x2), (f2, f1), (f1, f2))]
        new = _Progress((x, *kept[:2]), (f, *kept[2:]), width)
        return jax.tree.map(lambda old, new: library.where(done, old, new), progress, new)

    def divided(progress: _Progress, case: Any, parts: int) -> _Progress:
        """Between the first two of so many values, even ones and some near a guess, that differ."""
        (x1, x2, _), (f1, f2, _), width = progress
        span = x2 - x1
        with np.errstate(all="ignore"):
            guess, least = f1 / (f1 - f2), width / (4 * abs(span))
        guess = np.where(np.isfinite(guess), guess, 0.5)
        even = (np.arange(parts // 2) + 1) / (parts // 2 + 1)
        # Ever closer to the guess, as far as numbers differ.
        near = least[:, None] ** (1 - np.arange(parts // 4) / (parts // 4))[None]
        near = np.concatenate([guess[:, None] - near, guess[:, None] + near], axis=1)
        share = np.concatenate([np.broadcast_to(even, (len(x1), even.size)), near], axis=1)
        share = np.sort(np.clip(share, least[:, None], 1 - least[:, None]), axis=1)
        x = (x1[:, None] + share * span[:, None]).astype(x1.dtype)
        f = margin(np.repeat(case, x.shape[1]), x.reshape(-1)).reshape(x.shape)
        x = np.concatenate([x1[:, None], x, x2[:, None]], axis=1)
        f = np.concatenate([f1[:, None], f, f2[:, None]], axis=1)
        place = ((f[:, 1:] < 0) != (f[:, :-1] < 0)).argmax(axis=1)
        rows = np.arange(len(x1))
        further = np.where(place > 0, place - 1, place + 2)

        def chosen(part: Any) -> tuple[Any, Any, Any]:
            return part[rows, place], part[rows, place + 1], part[rows, further]

        return _Progress(chosen(x), chosen(f), width)

    if traced:
        _, progress = jax.lax.while_loop(
            lambda state: (state[0] < _ITERATIONS) & ~state[1].narrow().all(),
            lambda state: (state[0] + 1, step(state[1], found.case)),
            (0, progress),
        )
    else:
        for _ in range(_ITERATIONS):
            wide = np.flatnonzero(~progress.narrow())
            if not wide.size:
                break
            whole, form = jax.tree.flatten(progress)
            rest = jax.tree.unflatten(form, [part[wide] for part in whole])
            # Few cost as much time as many: the lanes of a batch.
            parts = _LANES // wide.size // 4 * 4
            better = (
                divided(rest, found.case[wide], parts) if parts else step(rest, found.case[wide])
            )
            for part, new in zip(whole, jax.tree.leaves(better), strict=True):
                part[wide] = new
    (x1, x2, _), (f1, f2, _) = progress.x, progress.f
    first = f1 >= 0
    known = progress.narrow() & library.isfinite(f1 + f2)
    stands, falls = library.where(first, x1, x2), library.where(first, x2, x1)
    return stands, falls, library.where(known, library.where(first, f1, f2), library.nan)
