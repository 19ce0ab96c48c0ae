"""A search along a parameter for the values at which a rate crosses its target."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..block import SIZES_IN_WORDS
from ..host import count_work
from ..overturning import UNITS

# Distance of the values that are examined at first, in logarithms, at least and over the
# resolution; and the least number of them.
_FIRST_SPACING = 0.1
_FIRST_OVER_RESOLUTION = 8.0
_FIRST_NUMBER = 13
# The widest distance between levels, in logarithms, with which a search begins.
_COARSEST = 0.16
# So many standard errors away from the target a rate is on one side of it.
_DECIDED = 3.0


class RateEstimate(NamedTuple):
    """Rates at values, their standard errors [1/yr], and outcomes that are used again.

    All have an axis of values, the outcomes as their second one.
    """

    rate: np.ndarray
    error: np.ndarray
    overturned: np.ndarray


# Takes indices of objects and values of the parameter along one axis, a stage, and the
# outcomes of the stage before for each value; of the first stage there are none.
Estimate = Callable[[np.ndarray, np.ndarray, int, Sequence[np.ndarray]], RateEstimate]


class RateScan(NamedTuple):
    """Values of one object in increasing order, and the rates there."""

    values: np.ndarray
    rates: np.ndarray


def choose_strides(levels: np.ndarray) -> tuple[int, ...]:
    """Choose which part of the levels each stage uses: every so many of them, at last all."""
    widest = float(np.diff(np.log(levels)).max())
    # A power of two, so that each stage has the levels of the one before.
    halvings = max(0, math.floor(math.log2(_COARSEST / widest)))
    return tuple(sorted({2**halvings, 2 ** max(halvings - 1, 0), 1}, reverse=True))


class _Point:
    """A value of an object, and what is known of the rate there."""

    def __init__(self, object_index: int, value: float):
        self.object_index = object_index
        self.value = value
        self.stage = -1
        self.rate = math.nan
        self.error = math.nan
        self.overturned = np.empty(0, bool)


# Most values are far from where the rate crosses the target, and few levels tell on which side
# of it they are. A pass simulates all blocks that are asked for; then
#
#   a value        whose rate                                    what happens to it
#   -------------  --------------------------------------------  ---------------------------
#   is decided     is further from the target than its error     nothing more
#   is undecided   is closer, and there are more levels          estimated at more levels
#   is exact       was computed at all levels                    taken as it is
#   is an answer   is decided, beside a crossing                 computed at all levels
#
# and between decided neighbours a value is added in the middle if the rate crosses the target
# between them, or might, until they are as close as the resolution.
class ValueSearch(NamedTuple):
    """The kind of a search, for all objects.

    Attributes
    ----------
    estimate : callable
    motions : ndarray of int, shape (stages,)
        Number of motions that each stage of an estimate adds for a value.
    targets : ndarray, shape (objects,)
        [1/yr]
    resolution : float
        Relative distance of neighbouring values at a crossing.
    """

    estimate: Estimate
    motions: np.ndarray
    targets: np.ndarray
    resolution: float

    def scan(self, low: np.ndarray, high: np.ndarray) -> list[RateScan]:
        """Compute rates at values between the bounds of each object, many near its target."""
        points = [
            [
                _Point(k, float(value))
                for value in _choose_first(float(ends[0]), float(ends[1]), self.resolution)
            ]
            for k, ends in enumerate(zip(low, high, strict=True))
        ]
        with count_work("outcomes at values", 1) as work:
            while True:
                tasks = [p for row in points for p in row if not self._is_decided(p)]
                tasks = tasks or [p for row in points for p in self._list_answers(row)]
                if not tasks:
                    break
                work.expect(self._guess_motions(tasks, points))
                self._estimate_tasks(tasks)
                for row in points:
                    self._add_middles(row)
        return [
            RateScan(np.array([p.value for p in row]), np.array([p.rate for p in row]))
            for row in points
        ]

    def _is_exact(self, point: _Point) -> bool:
        """Return whether the rate was computed at all levels."""
        return point.stage == len(self.motions) - 1

    def _is_decided(self, point: _Point) -> bool:
        """Return whether it is known on which side of the target the rate is."""
        if point.stage < 0 or self._is_exact(point):
            return point.stage >= 0
        # Where the outcome is the same at all levels nothing is known of the error: once more.
        if point.error == 0:
            return point.stage > 0
        distance = abs(point.rate - self.targets[point.object_index])
        return bool(distance > _DECIDED * point.error)

    def _guess_motions(
        self, tasks: Sequence[_Point], points: Sequence[Sequence[_Point]]
    ) -> float:
        """Guess how many motions these tasks and those after them need."""
        number = float(sum(self.motions[point.stage + 1] for point in tasks))
        for row in points:
            target = self.targets[row[0].object_index]
            gaps = [
                after.value / before.value - 1 if before.value else 1.0
                for before, after in itertools.pairwise(row)
                # Before anything is known, a crossing is assumed between any two values.
                if (before.rate > target) != (after.rate > target) or row[0].stage < 0
            ]
            if gaps:
                # Halvings down to the resolution, then the rate at the answer.
                halvings = math.log2(max(min(gaps) / self.resolution, 1.0))
                number += (halvings + 1) * self.motions.sum()
        return number

    def _list_answers(self, row: Sequence[_Point]) -> list[_Point]:
        """List the values that may be answers, and whose rates are not exact yet."""
        target = self.targets[row[0].object_index]
        above = [point.rate > target for point in row]
        changes = [k for k in range(1, len(row)) if above[k] != above[k - 1]]
        beside = {k for change in changes for k in (change - 1, change)}
        return [row[k] for k in sorted(beside) if not self._is_exact(row[k])]

    def _estimate_tasks(self, tasks: Sequence[_Point]) -> None:
        """Estimate rates in the next stage of each value, one batch for each stage."""
        groups: dict[int, list[_Point]] = {}
        for point in tasks:
            groups.setdefault(point.stage + 1, []).append(point)
        for stage, group in groups.items():
            objects = np.array([point.object_index for point in group])
            values = np.array([point.value for point in group])
            known = [point.overturned for point in group] if stage else []
            estimate = self.estimate(objects, values, stage, known)
            for k, point in enumerate(group):
                point.rate = float(estimate.rate[k])
                point.error = float(estimate.error[k])
                point.overturned = estimate.overturned[:, k]
                point.stage = stage

    def _add_middles(self, row: list[_Point]) -> None:
        """Add the middles of intervals in which the rate crosses the target, or might."""
        target = self.targets[row[0].object_index]
        middles = []
        # Near 0, which a restitution may be, no interval would ever be narrow beside its end.
        least = 0.01 * row[-1].value
        for before, after in itertools.pairwise(row):
            if after.value - before.value <= self.resolution * max(after.value, least):
                continue
            if not (self._is_decided(before) and self._is_decided(after)):
                continue
            first = before.rate - target
            second = after.rate - target
            # It might cross the target and come back: if the nearer end is closer to the
            # target than half of what the ends are apart and two standard errors. A rate at
            # all levels has an error as well: between neighbouring values windows come and go.
            error = max(before.error, after.error)
            apart = 0.5 * abs(after.rate - before.rate) + 2 * error
            crosses = (first > 0) != (second > 0)
            if crosses or min(abs(first), abs(second)) <= apart:
                middle = 0.5 * (before.value + after.value)
                middles.append(_Point(before.object_index, middle))
        row += middles
        row.sort(key=lambda point: point.value)


def _choose_first(low: float, high: float, resolution: float) -> np.ndarray:
    """Choose the values that are examined at first."""
    # Evenly in logarithms, since a rate is about a power of the size; a restitution of 0 has
    # no logarithm.
    number = _FIRST_NUMBER
    if low > 0:
        spacing = max(_FIRST_SPACING, _FIRST_OVER_RESOLUTION * resolution)
        number = max(number, math.ceil(math.log(high / low) / spacing) + 1)
    fraction = np.linspace(0, 1, number)
    values = low * (high / low) ** fraction if low > 0 else low + (high - low) * fraction
    # The bounds as they are: rounded ones could lie outside of what is allowed.
    values[0] = low
    values[-1] = high
    return values


class ScanAnswer(NamedTuple):
    """An answer for one object."""

    value: float
    crossings: np.ndarray
    reason: str


def read_scan(scan: RateScan, target: float, along: str, side: str) -> ScanAnswer:
    """Read the value from a scan, and say why it is what it is."""
    values, rates = scan
    above = rates > target
    changes = np.flatnonzero(above[1:] != above[:-1])
    # On the safe side of each crossing, where the rate was computed to be below the target.
    crossings = np.where(above[changes], values[changes + 1], values[changes])
    upwards = side == "above"
    unsafe = np.flatnonzero(above)
    quantity = f"{UNITS.get(along, '')}, {SIZES_IN_WORDS.get(along, along)}".removeprefix(", ")
    end = -1 if upwards else 0
    if above[end]:
        bound = "upper" if upwards else "lower"
        missing = math.inf if upwards else -math.inf
        reason = (
            f"none: at the {bound} bound, {values[end]:.6g} {quantity}, the rate is still"
            f" about {rates[end]:.3g} 1/yr, above {target:g} 1/yr"
        )
        return ScanAnswer(missing, crossings, reason)
    if not unsafe.size:
        at = 0 if upwards else len(values) - 1
        reason = (
            f"{values[at]:.6g} {quantity}: the rate is below {target:g} 1/yr at all values"
            " examined"
        )
    else:
        at = unsafe[-1] + 1 if upwards else unsafe[0] - 1
        where = "from there on" if upwards else "up to there"
        reason = f"{values[at]:.6g} {quantity}: {where} the rate stays below {target:g} 1/yr"
        if len(crossings) > 1:
            reason += f", which it crosses {len(crossings)} times"
    return ScanAnswer(float(values[at]), crossings, reason)
