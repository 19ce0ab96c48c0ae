"""The search for the worst train: descents, and moves to other sequences of impacts and pulses.

A descent is SciPy's sequential quadratic programming (SLSQP; Kraft 1988, TOMS algorithm 733,
https://doi.org/10.1145/192115.192124), which takes the limits as constraints: those on the
times and, where the smallest pulses are sought, that the block overturns.
"""

import functools
import warnings
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from .pulse_train import Rocker
from .train_through_impacts import MAX_IMPACTS, Outcome, evaluate

Goal = Literal["smallest largest", "smallest total", "most rotation"]

MOST_IMPACTS = 3  # between two pulses, as long as they need not be apart
_STEPS = 50  # of a descent, far more than most take
# phases; no descent begins closer to the ends, where the slope is 0
_EARLY = 0.1
_LATE = 0.9
_LEAST = 0.1  # over the bound, of a pulse that is moved
_NO_GAIN = 1e-9  # improvement that is none
# Of the logarithm of the bound. Over 0 even the first pulse overturns the block; as if it came
# back nevertheless, a descent always has somewhere to begin from which the block overturns.
_RANGE = (-20.0, 5.0)


class TrainProblem(NamedTuple):
    """What all trains have in common."""

    rocker: Rocker
    goal: Goal
    largest: float  # bound on the pulses over `Rocker.unit`, if that is given
    fewest_impacts: int  # between two pulses
    spacing: float  # [s]
    latest: float  # [s]
    rate: float  # frequency parameter [rad/s]
    eps: float  # of the precision

    @property
    def seeks_pulses(self) -> bool:
        """True if the smallest pulses are sought, not the highest peak."""
        return self.goal != "most rotation"

    @property
    def constrained(self) -> bool:
        """True if the times of the pulses are."""
        return self.spacing > 0 or self.latest < np.inf

    @property
    def most_impacts(self) -> int:
        """Between two pulses."""
        return MAX_IMPACTS if self.spacing > 0 else MOST_IMPACTS

    @property
    def accuracy(self) -> float:
        """To which a descent goes on, and to which it keeps the constraints."""
        return max(1e-11, 50 * self.eps)

    @property
    def tolerance(self) -> float:
        """Of the constraints, of those on times over the frequency parameter."""
        return 10 * self.eps**0.5


class Candidate(NamedTuple):
    """A train, and how good it is."""

    # (2 pulses + 1,): phases, pulses over the bound, logarithm of the bound.
    numbers: np.ndarray
    impacts: np.ndarray  # (pulses,) between a pulse and the one before
    used: int  # pulses of the train, the others are left out
    loss: float = np.inf
    violation: float = np.inf  # of the constraints, the largest
    ended: bool = False  # whether the descent has
    path: tuple[float, ...] = ()  # the objective in each step so far

    @property
    def phases(self) -> np.ndarray:
        """See `Train`."""
        return self.numbers[: self.impacts.size]

    @property
    def weights(self) -> np.ndarray:
        """The pulses over the bound, outward positive."""
        return self.numbers[self.impacts.size : -1]

    def outcome(self, problem: TrainProblem, raised: float = 0.0) -> Outcome:
        """Compute what the train does if its pulses are raised in proportion."""
        numbers = np.append(self.numbers[:-1], self.numbers[-1] + raised)
        return _evaluate(self._replace(numbers=numbers), problem)[0]

    def feasible(self, problem: TrainProblem) -> bool:
        """Tell whether it keeps the constraints."""
        return self.violation < problem.tolerance

    def merit(self, problem: TrainProblem) -> float:
        """Compute what candidates are compared by: anything feasible is below what is not.

        Of equally good trains the earlier one counts as better: a pulse right before an impact
        does as much as one right after the impact before.
        """
        lateness = (np.sin(0.5 * np.pi * self.phases[1:]) ** 2).sum()
        merit = self.loss if self.feasible(problem) else 100 + self.violation
        return float(merit + 10 * _NO_GAIN * lateness)


class _Measured(NamedTuple):
    """What a descent goes by."""

    loss: float
    slope: np.ndarray
    log_x: float  # 0 or more if the block overturns
    room: np.ndarray  # within each constraint, negative if it is violated
    room_slopes: np.ndarray
    objective: float  # what the train needs, nearly, or how far it leads


def _evaluate(
    candidate: Candidate, problem: TrainProblem
) -> tuple[Outcome, np.ndarray, np.ndarray]:
    numbers, impacts, used, *_ = candidate
    outcome, *limited = evaluate(numbers, impacts, used, problem.rocker, problem.spacing)
    values, slopes = (np.asarray(part, float) for part in limited)
    return outcome, values, slopes


def _measure(candidate: Candidate, problem: TrainProblem) -> _Measured:
    _, values, slopes = _evaluate(candidate, problem)
    log_x = values[0]
    log_x_slope = slopes[0]
    room = -problem.rate * values[1:]
    room_slopes = -problem.rate * slopes[1:]
    # What a constraint that is not there leaves must not be infinite.
    room[-1] += min(problem.rate * problem.latest, 1e6)
    if not problem.seeks_pulses:
        return _Measured(-log_x, -log_x_slope, log_x, room, room_slopes, np.exp(log_x))
    room = np.append(room, log_x)
    room_slopes = np.vstack([room_slopes, log_x_slope])
    slope = np.zeros_like(candidate.numbers)
    if problem.goal == "smallest largest":
        loss = candidate.numbers[-1]
        slope[-1] = 1
        return _Measured(loss, slope, log_x, room, room_slopes, np.exp(loss - log_x))
    sizes = abs(candidate.weights[: candidate.used])
    first = candidate.impacts.size
    slope[first : first + sizes.size] = np.sign(candidate.weights[: sizes.size])
    bound = np.exp(candidate.numbers[-1])
    loss = bound * sizes.sum()
    return _Measured(loss, bound * slope, log_x, room, room_slopes, loss * np.exp(-log_x))


def descend(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Find the best train through the same impacts, from one on."""
    from scipy.optimize import minimize  # which loads slowly

    lows, highs = _bounds(candidate, problem)
    pulses = candidate.impacts.size
    begin = np.clip(candidate.numbers, lows, highs)
    begin[:pulses] = np.clip(begin[:pulses], _EARLY, _LATE)
    path = list(candidate.path)

    @functools.lru_cache(maxsize=2)
    def measured(numbers: bytes) -> _Measured:
        # SciPy may ask a rounding error beyond the bounds.
        within = np.clip(np.frombuffer(numbers), lows, highs)
        return _measure(candidate._replace(numbers=within), problem)

    with warnings.catch_warnings():
        # SciPy says so where its own rounding goes beyond the bounds.
        warnings.filterwarnings("ignore", "Values in x were outside bounds")
        found = minimize(
            lambda numbers: measured(numbers.tobytes()).loss,
            begin,
            jac=lambda numbers: measured(numbers.tobytes()).slope,
            method="SLSQP",
            bounds=np.column_stack([lows, highs]),
            constraints={
                "type": "ineq",
                "fun": lambda numbers: measured(numbers.tobytes()).room,
                "jac": lambda numbers: measured(numbers.tobytes()).room_slopes,
            },
            callback=lambda numbers: path.append(measured(numbers.tobytes()).objective),
            options={"maxiter": _STEPS, "ftol": problem.accuracy},
        )
    numbers = np.clip(found.x, lows, highs)
    end = measured(numbers.tobytes())
    if problem.seeks_pulses and abs(end.log_x) < problem.tolerance:
        # As exactly as can be told, not just to the accuracy of a descent.
        numbers[-1] -= end.log_x / end.room_slopes[-1, -1]
        end = _measure(candidate._replace(numbers=numbers), problem)
    return candidate._replace(
        numbers=numbers,
        loss=float(end.loss),
        violation=float(-end.room.min()),
        ended=found.status in (0, 8),  # converged, or no step that rounding lets lead lower
        path=tuple(path),
    )


def _bounds(candidate: Candidate, problem: TrainProblem) -> tuple[np.ndarray, np.ndarray]:
    """Of the numbers of a train; equal if one is given."""
    ones = np.ones(candidate.impacts.size)
    lows = -ones
    highs = ones.copy()
    if problem.goal == "smallest total":
        # With given signs: the sum of magnitudes has no slope at 0.
        lows, highs = np.where(candidate.weights < 0, (-ones, 0 * ones), (0 * ones, ones))
    lows[0] = 1e-9  # the first pulse starts the motion; at rest nothing has a slope
    highs[0] = 1
    least, most = [np.log(problem.largest)] * 2
    if problem.goal == "smallest largest":
        least, most = _RANGE
    return np.concatenate([0 * ones, lows, [least]]), np.concatenate([ones, highs, [most]])


def search(candidates: list[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Find the best train that each leads to, by descents and moves between them."""
    moved: dict[tuple, Candidate] = {}

    def after_best_move(candidate: Candidate, k: int) -> Candidate:
        """Find what the best move of pulse k leads to, if it improves; once for each train."""
        # Through the same impacts to the same loss: two starts have come to one train.
        merit = candidate.merit(problem)
        key = k, candidate.used, candidate.impacts.tobytes(), round(merit, 6)
        if key not in moved:
            tried = (
                descend(_apart(move, problem), problem)
                for move in _moves(candidate, problem, k)
            )
            moved[key] = min(tried, key=lambda each: each.merit(problem), default=candidate)
        if moved[key].merit(problem) >= merit - _NO_GAIN:
            return candidate
        return moved[key]._replace(path=candidate.path + moved[key].path)

    found = []
    for start in candidates:
        candidate = descend(_apart(start, problem), problem)
        before = np.inf
        while candidate.merit(problem) < before:
            before = candidate.merit(problem)
            for k in range(1, start.used):
                candidate = after_best_move(candidate, k)
        found.append(candidate)
    return found


def _apart(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """With as many impacts between the pulses as these take to be far enough apart."""
    # What one pulse needs depends on those before.
    for _ in range(candidate.impacts.size if problem.spacing > 0 else 0):
        required = np.asarray(candidate.outcome(problem).required)
        impacts = np.clip(required, candidate.impacts, problem.most_impacts)
        candidate = candidate._replace(impacts=impacts)
    return candidate


def _moves(candidate: Candidate, problem: TrainProblem, k: int) -> Iterator[Candidate]:
    """Yield trains with pulse k where no descent leads, since there are valleys between.

    A pulse does most early in a half-cycle outward, or late inward.
    """
    candidate = candidate._replace(path=())
    impacts = candidate.impacts.tolist()
    others = {impacts[k] - 1, impacts[k], impacts[k] + 1}
    if problem.spacing > 0:
        required = int(candidate.outcome(problem).required[k])
        others |= {required, required + 1}
    for other in sorted({_allowed(each, problem) for each in others}):
        for phase in (_EARLY, _LATE):
            yield _placed(candidate, k, other, phase)
    if problem.constrained and k < candidate.impacts.size - 1:
        # What comes earlier after one pulse, comes later after the next, and so on.
        for by in (-1, 1):
            moved = _placed(candidate, k, _allowed(impacts[k] + by, problem), _EARLY)
            for then in (-1, 1):
                after = _allowed(impacts[k + 1] + then, problem)
                yield _placed(moved, k + 1, after, _EARLY)
    # Without a latest time a single pulse is two of which one is weak.
    if k == candidate.used - 1 and (
        problem.latest < np.inf or (problem.spacing > 0 and k > 1)
    ):
        # One pulse less; the others where they are, or as strong and as early as they may be.
        yield candidate._replace(used=k)
        strong = candidate.numbers.copy()
        strong[candidate.impacts.size : -1] = np.where(candidate.weights < 0, -1, 1)
        fewest = np.full_like(candidate.impacts, problem.fewest_impacts)
        yield candidate._replace(used=k, numbers=strong, impacts=fewest)


def _allowed(impacts: int, problem: TrainProblem) -> int:
    return int(np.clip(impacts, problem.fewest_impacts, problem.most_impacts))


def _placed(candidate: Candidate, k: int, impacts: int, phase: float) -> Candidate:
    """With pulse k in another half-cycle, in the direction in which the block moves there."""
    numbers = candidate.numbers.copy()
    between = candidate.impacts.copy()
    size = max(abs(candidate.weights[k]), _LEAST)
    between[k] = impacts
    numbers[k] = phase
    numbers[between.size + k] = size if phase == _EARLY else -size
    return candidate._replace(numbers=numbers, impacts=between)
