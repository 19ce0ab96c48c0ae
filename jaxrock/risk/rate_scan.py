"""A scan of values of a quantity for those at which a rate crosses its target."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..block import SIZES_IN_WORDS
from ..host import show_clock
from ..overturning import UNITS
from .counted_rate import Counting, count_rates

# Distance of the values that are examined at first, in logarithms, and the least number of them.
_FIRST_SPACING = 0.1
_FIRST_NUMBER = 17
# The widest distance between levels, in logarithms, at which a count begins.
_COARSEST = 0.16
# So many standard errors away from the target a count is on one side of it.
_DECIDED = 3.0

# Takes the numbers of objects, values of the quantity and levels of the measure, all along one
# axis; returns which overturn, (records, values).
Follow = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class RateScan(NamedTuple):
    """Values of one object in increasing order, the rates counted there, and their errors."""

    values: np.ndarray
    rates: np.ndarray
    errors: np.ndarray


class Depths(NamedTuple):
    """Counts at more and more levels; each has the levels of the one before among its own.

    Attributes
    ----------
    places : sequence of ndarray
        For each depth, where its levels are among all levels.
    countings : sequence of Counting
    """

    places: Sequence[np.ndarray]
    countings: Sequence[Counting]


def plan_depths(plan: Callable[[np.ndarray], Counting], levels: np.ndarray) -> Depths:
    """Plan counts from few levels to all of them."""
    widest = float(np.diff(np.log(levels)).max(initial=0.0))
    halvings = 0
    if widest > 0:
        halvings = max(0, math.floor(math.log2(_COARSEST / widest)))
    strides = [2**k for k in range(halvings, -1, -1)]
    # The last level stands for all beyond, so that it is never left out.
    last = len(levels) - 1
    places = [np.unique(np.append(np.arange(0, last, stride), last)) for stride in strides]
    return Depths(places, [plan(levels[place]) for place in places])


class _Point:
    """A value of an object, and the outcomes that are known there."""

    def __init__(self, value: float, records: int, levels: int):
        self.value = value
        self.depth = -1  # of the outcomes that are known
        self.overturned = np.zeros((records, levels), bool)
        self.rate = math.nan
        self.error = math.nan


# Most values are far from where the rate crosses the target, and a count at few levels tells on
# which side of it they are. A pass follows all blocks that are asked for, in one batch; then
#
#   a value        whose count                                   what happens to it
#   -------------  --------------------------------------------  ---------------------------------
#   is decided     is further from the target than its error     nothing more
#   is undecided   is closer, and there are more levels          counted again at twice as many
#   is at the end  is closer, at all levels                      taken as it is
#
# and between decided neighbours, or those at the end, a value is added in the middle if the
# rate crosses the target between them, or might, until they are as close as the resolution.
@show_clock("required values")
def scan_values(
    follow: Follow,
    depths: Depths,
    records: int,
    low: np.ndarray,
    high: np.ndarray,
    targets: np.ndarray,
    resolution: float,
) -> list[RateScan]:
    """Count rates at values between the bounds of each object, many near its target."""
    levels = len(depths.places[-1])
    points = [
        [_Point(float(value), records, levels) for value in _choose_first(float(a), float(b))]
        for a, b in zip(low, high, strict=True)
    ]
    while tasks := _list_tasks(points, depths, targets) or _list_answers(
        points, depths, targets
    ):
        _follow_tasks(follow, depths, tasks)
        for of_object, target in zip(points, targets, strict=True):
            _add_middles(of_object, float(target), depths, resolution)
    return [
        RateScan(*np.array([(p.value, p.rate, p.error) for p in of_object]).T)
        for of_object in points
    ]


def _choose_first(low: float, high: float) -> np.ndarray:
    """Choose the values that are examined at first."""
    # Evenly in logarithms, since a rate is about a power of the size; a restitution of 0 has
    # no logarithm.
    number = _FIRST_NUMBER
    if low > 0:
        number = max(number, math.ceil(math.log(high / low) / _FIRST_SPACING) + 1)
    share = np.linspace(0, 1, number)
    values = low * (high / low) ** share if low > 0 else low + (high - low) * share
    # The bounds as they are: rounded ones could lie outside of what is allowed.
    values[0] = low
    values[-1] = high
    return values


def _is_decided(point: _Point, target: float, depths: Depths) -> bool:
    """Tell whether no further count is needed to know the side of the target."""
    if point.depth < 0:
        return False
    if point.depth == len(depths.places) - 1:
        return True
    # Where the outcome is the same at all levels nothing is known of the error: once more.
    if point.error == 0:
        return point.depth > 0
    return abs(point.rate - target) > _DECIDED * point.error


def _list_tasks(
    points: Sequence[Sequence[_Point]], depths: Depths, targets: np.ndarray
) -> list[tuple[int, _Point]]:
    """List the values to be counted next, each with the number of its object."""
    return [
        (number, point)
        for number, (of_object, target) in enumerate(zip(points, targets, strict=True))
        for point in of_object
        if not _is_decided(point, float(target), depths)
    ]


def _list_answers(
    points: Sequence[Sequence[_Point]], depths: Depths, targets: np.ndarray
) -> list[tuple[int, _Point]]:
    """List the values that may be answers and were not counted at all levels yet."""
    deepest = len(depths.places) - 1
    tasks = []
    for number, (of_object, target) in enumerate(zip(points, targets, strict=True)):
        above = [point.rate > target for point in of_object]
        for k, point in enumerate(of_object):
            at_end = k in (0, len(of_object) - 1)
            # Those on both sides of a crossing.
            beside = not at_end and (above[k - 1] != above[k] or above[k] != above[k + 1])
            if point.depth < deepest and (at_end or beside):
                tasks.append((number, point))
    return tasks


def _follow_tasks(follow: Follow, depths: Depths, tasks: Sequence[tuple[int, _Point]]) -> None:
    """Count each value at the next depth, all of them in one batch."""
    all_levels = depths.countings[-1].levels
    new = []
    for _, point in tasks:
        known = depths.places[point.depth] if point.depth >= 0 else np.empty(0, int)
        new.append(np.setdiff1d(depths.places[point.depth + 1], known, assume_unique=True))
    sizes = [places.size for places in new]
    outcomes = follow(
        np.repeat([number for number, _ in tasks], sizes),
        np.repeat([point.value for _, point in tasks], sizes),
        all_levels[np.concatenate(new)],
    )
    parts = np.split(outcomes, np.cumsum(sizes)[:-1], axis=1)
    for (_, point), places, part in zip(tasks, new, parts, strict=True):
        point.overturned[:, places] = part
        point.depth += 1
        known = point.overturned[:, depths.places[point.depth]]
        counted = count_rates(known, depths.countings[point.depth])
        point.rate = float(counted.rate)
        point.error = float(counted.error)


def _add_middles(
    points: list[_Point], target: float, depths: Depths, resolution: float
) -> None:
    """Add the middles of intervals in which the rate crosses the target, or might."""
    added = []
    # Near 0, which a restitution may be, no interval would ever be narrow beside its end.
    least = 0.01 * points[-1].value
    for before, after in itertools.pairwise(points):
        if after.value - before.value <= resolution * max(after.value, least):
            continue
        if not (_is_decided(before, target, depths) and _is_decided(after, target, depths)):
            continue
        first = before.rate - target
        second = after.rate - target
        # It might cross the target and come back: if the nearer end is closer to the target
        # than the ends are apart, or than both counts may be off.
        apart = abs(after.rate - before.rate) + 2 * max(before.error, after.error)
        if (first > 0) != (second > 0) or min(abs(first), abs(second)) <= apart:
            middle = 0.5 * (before.value + after.value)
            added.append(_Point(middle, *before.overturned.shape))
    points += added
    points.sort(key=lambda point: point.value)


class ScanAnswer(NamedTuple):
    """An answer for one object."""

    value: float
    crossings: np.ndarray
    reason: str


def read_scan(scan: RateScan, target: float, along: str, side: str) -> ScanAnswer:
    """Read the value from a scan, and say why it is what it is."""
    values, rates, _ = scan
    above = rates > target
    changes = np.flatnonzero(above[1:] != above[:-1])
    # On the safe side of each crossing, where the rate was counted to be below the target.
    crossings = np.where(above[changes], values[changes + 1], values[changes])
    upwards = side == "above"
    unsafe = np.flatnonzero(above)
    what = f"{UNITS.get(along, '')}, {SIZES_IN_WORDS.get(along, along)}".lstrip(", ")
    end = -1 if upwards else 0
    if above[end]:
        bound = "upper" if upwards else "lower"
        missing = math.inf if upwards else -math.inf
        reason = (
            f"none: at the {bound} bound, {values[end]:.6g} {what}, it is still"
            f" {rates[end]:.4g}, above {target:g}"
        )
        return ScanAnswer(missing, crossings, reason)
    if not unsafe.size:
        at = 0 if upwards else len(values) - 1
        reason = (
            f"{values[at]:.6g} {what}: the rate is below {target:g} at all values examined"
        )
    else:
        at = unsafe[-1] + 1 if upwards else unsafe[0] - 1
        where = "from there on" if upwards else "up to there"
        reason = f"{values[at]:.6g} {what}: {where} the rate stays below {target:g}"
        if len(crossings) > 1:
            reason += f", which it crosses {len(crossings)} times"
    return ScanAnswer(float(values[at]), crossings, reason)
