"""The search for the worst train: descents, and moves to other sequences of impacts.

Without limits on the times trains descend by gradient steps (`train_descent`), and what they
come to is polished. With limits, and to polish, a descent is SciPy's sequential quadratic
programming (SLSQP; Kraft 1988, report DFVLR-FB 88-28, and 1994, TOMS algorithm 733,
https://doi.org/10.1145/192115.192124). It takes the limits as constraints: on the times and,
where the smallest pulses are sought, that the block overturns. Fifty times as much computing,
but gradient steps with penalties stop at worse trains.
"""

import functools
import math
import warnings
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import jax
import numpy as np

from .pulse_train import Rocker
from .train_descent import Descended, Descents, descend_all
from .train_through_impacts import MAX_IMPACTS, Evaluation, Outcome, evaluate_with_slopes

Goal = Literal["smallest largest", "smallest total", "most rotation"]

MOST_IMPACTS = 3  # between two pulses, as long as they need not be apart
_STEPS = 50  # of a descent, far more than most take
_AT_ONCE = 16  # trains in a program: start and moves of a pulse
# Phases of a pulse early and late in its half-cycle. No descent begins closer to the ends,
# where the slope is 0: the energy depends on the cosine of pi times the phase.
_EARLY = 0.1
_LATE = 0.9
# Least size, over the bound, of a pulse that is moved: of one of size 0 the phase has no
# slope.
_LEAST = 0.1
_NO_GAIN = 1e-9  # improvements of the merit up to this are rounding
# Range of the logarithm of the bound. Over 0 even the first pulse overturns the block. The
# block is followed as if it came back nevertheless, so that a descent always has somewhere to
# begin from which the block overturns.
_RANGE = (-20.0, 5.0)


class TrainProblem(NamedTuple):
    """The problem that a search solves: the block, the goal and the limits.

    Attributes
    ----------
    rocker, rate
        The block, and its frequency parameter [rad/s].
    goal
        See `worst_train`.
    largest
        Bound on the pulses over `Rocker.unit` [-]; 1 unless given.
    fewest_impacts
        Fewest impacts between two pulses.
    spacing, latest
        Shortest time between two pulses, and latest time of the last [s].
    eps
        Relative rounding error of the precision.
    """

    rocker: Rocker
    goal: Goal
    largest: float
    fewest_impacts: int
    spacing: float
    latest: float
    rate: float
    eps: float

    @property
    def seeks_pulses(self) -> bool:
        """True if the smallest pulses are sought, not the highest peak."""
        return self.goal != "most rotation"

    @property
    def constrained(self) -> bool:
        """True if there are limits on the times of the pulses."""
        return self.spacing > 0 or self.latest < np.inf

    @property
    def most_impacts(self) -> int:
        """Most impacts between two pulses."""
        # Waiting for more impacts than these only loses energy, unless the spacing asks for
        # it.
        return MAX_IMPACTS if self.spacing > 0 else MOST_IMPACTS

    @property
    def accuracy(self) -> float:
        """Accuracy to which a descent goes on, and to which it keeps the constraints."""
        return max(1e-11, 50 * self.eps)

    @property
    def tolerance(self) -> float:
        """Violation that still counts as none; of times, this over the frequency parameter."""
        # Half of the digits, and a margin.
        return 10 * self.eps**0.5


class Candidate(NamedTuple):
    """A train, and how good it is.

    Attributes
    ----------
    numbers
        Phases, pulses over the bound, and the logarithm of the bound, (2 pulses + 1,): the
        numbers that a descent changes.
    impacts
        Impacts between a pulse and the one before, (pulses,): only moves change them.
    used
        Number of pulses of the train; the others are left out.
    loss, violation
        The number that is minimised, and the largest violation of a constraint.
    ended
        Whether the descent has ended by itself.
    path
        The objective in each step so far.
    """

    numbers: np.ndarray
    impacts: np.ndarray
    used: int
    loss: float = np.inf
    violation: float = np.inf
    ended: bool = False
    path: tuple[float, ...] = ()

    @property
    def phases(self) -> np.ndarray:
        """Phases of the pulses in their half-cycles, see `Train`."""
        return self.numbers[: self.impacts.size]

    @property
    def weights(self) -> np.ndarray:
        """The pulses over the bound, outward positive."""
        return self.numbers[self.impacts.size : -1]

    def compute_outcome(self, problem: TrainProblem, raised: float = 0.0) -> Outcome:
        """Compute the outcome if the pulses are raised by a factor exp(`raised`)."""
        numbers = np.append(self.numbers[:-1], self.numbers[-1] + raised)
        return _evaluate_candidate(self._replace(numbers=numbers), problem).outcome

    def is_feasible(self, problem: TrainProblem) -> bool:
        """Tell whether the train keeps the constraints."""
        return self.violation < problem.tolerance

    def identify(self, problem: TrainProblem) -> tuple[int, bytes, float]:
        """Return what two candidates share that have come to one train.

        It is the way through the impacts, and the loss.
        """
        return self.used, self.impacts.tobytes(), round(self.merit(problem), 6)

    def merit(self, problem: TrainProblem) -> float:
        """Compute the number by which candidates are compared; lower is better.

        Anything feasible is below anything that is not. Of equally good trains the earlier one
        counts as better: a pulse right before an impact does as much as one right after the
        impact before.
        """
        # Heavier than `_NO_GAIN`, or a move to the earlier train would not count as a gain.
        lateness = (np.sin(0.5 * np.pi * self.phases[1:]) ** 2).sum()
        merit = self.loss if self.is_feasible(problem) else 100 + self.violation
        return float(merit + 10 * _NO_GAIN * lateness)


class _Measurement(NamedTuple):
    """The loss and the constraints at one train, with derivatives.

    Attributes
    ----------
    loss, slope
        The number that is minimised, and its derivatives with respect to the numbers.
    log_x
        Logarithm of the velocity in the end over the critical one: from 0 on the block
        overturns.
    room, room_slopes
        Room within each constraint, negative if it is violated, and its derivatives.
    objective
        Size of the pulses if raised until they just overturn the block, nearly; or the
        velocity in the end over the critical one.
    """

    loss: float
    slope: np.ndarray
    log_x: float
    room: np.ndarray
    room_slopes: np.ndarray
    objective: float


def _evaluate_candidate(candidate: Candidate, problem: TrainProblem) -> Evaluation:
    """Compute outcome, limited values and their slopes; see `evaluate_with_slopes`."""
    numbers, impacts, used, *_ = candidate
    if problem.constrained:
        return evaluate_with_slopes(
            numbers, impacts, used, problem.rocker, problem.spacing, problem.most_impacts
        )
    # By the program that is there already.
    last = _run_descents([candidate], problem, steps=1).last
    return jax.tree.map(lambda part: part[0], last)


def _run_descents(
    candidates: Sequence[Candidate], problem: TrainProblem, steps: int
) -> Descended:
    """Let at most `_AT_ONCE` trains descend by gradient steps."""
    dtype = problem.rocker.restitution.dtype
    bounds = [_compute_bounds(candidate, problem) for candidate in candidates]
    descents = Descents(
        numbers=np.array([candidate.numbers for candidate in candidates], dtype),
        impacts=np.array([candidate.impacts for candidate in candidates]),
        lows=np.array([low for low, _ in bounds], dtype),
        highs=np.array([high for _, high in bounds], dtype),
        steps=np.full(len(candidates), steps),
    )
    # One program for any number of trains: the padding takes no step.
    spare = _AT_ONCE - len(candidates)
    padded = jax.tree.map(
        lambda part: np.pad(part, [(0, spare)] + [(0, 0)] * (part.ndim - 1)), descents
    )
    seeks = np.asarray(problem.seeks_pulses)
    total = np.asarray(problem.goal == "smallest total")
    return jax.device_get(
        descend_all(padded, problem.rocker, seeks, total, problem.most_impacts)
    )


def _measure_candidate(candidate: Candidate, problem: TrainProblem) -> _Measurement:
    """Compute the loss and the constraints of a problem at a train."""
    _, *limited = _evaluate_candidate(candidate, problem)
    values, slopes = (np.asarray(part, float) for part in limited)
    log_x = values[0]
    log_x_slope = slopes[0]

    # Times in units of 1 / rate are pure numbers, like the logarithm: one accuracy does for
    # all constraints.
    room = -problem.rate * values[1:]
    room_slopes = -problem.rate * slopes[1:]
    # Without a latest time the room must still be finite.
    room[-1] += min(problem.rate * problem.latest, 1e6)

    if not problem.seeks_pulses:
        return _Measurement(-log_x, -log_x_slope, log_x, room, room_slopes, np.exp(log_x))
    room = np.append(room, log_x)
    room_slopes = np.vstack([room_slopes, log_x_slope])

    # The objective is the size of the pulses once they just overturn: the velocity in the end
    # is nearly in proportion to them.
    slope = np.zeros_like(candidate.numbers)
    if problem.goal == "smallest largest":
        loss = candidate.numbers[-1]
        slope[-1] = 1
        return _Measurement(loss, slope, log_x, room, room_slopes, np.exp(loss - log_x))
    sizes = abs(candidate.weights[: candidate.used])
    first = candidate.impacts.size
    slope[first : first + sizes.size] = np.sign(candidate.weights[: sizes.size])
    bound = np.exp(candidate.numbers[-1])
    loss = bound * sizes.sum()
    return _Measurement(loss, bound * slope, log_x, room, room_slopes, loss * np.exp(-log_x))


def descend(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Find the best train through the same impacts, by SLSQP from a candidate."""
    from scipy.optimize import minimize  # which loads slowly

    lows, highs = _compute_bounds(candidate, problem)
    begin = _begin_descent(candidate, problem).numbers
    path = list(candidate.path)

    @functools.lru_cache(maxsize=2)
    def measure(numbers: bytes) -> _Measurement:
        """Measure the train of numbers, once for all that SciPy asks about them."""
        # SciPy may ask a rounding error beyond the bounds.
        within = np.clip(np.frombuffer(numbers), lows, highs)
        return _measure_candidate(candidate._replace(numbers=within), problem)

    with warnings.catch_warnings():
        # SciPy says so where its own rounding goes beyond the bounds.
        warnings.filterwarnings("ignore", "Values in x were outside bounds")
        found = minimize(
            lambda numbers: measure(numbers.tobytes()).loss,
            begin,
            jac=lambda numbers: measure(numbers.tobytes()).slope,
            method="SLSQP",
            bounds=np.column_stack([lows, highs]),
            constraints={
                "type": "ineq",
                "fun": lambda numbers: measure(numbers.tobytes()).room,
                "jac": lambda numbers: measure(numbers.tobytes()).room_slopes,
            },
            callback=lambda numbers: path.append(measure(numbers.tobytes()).objective),
            options={"maxiter": _STEPS, "ftol": problem.accuracy},
        )
    numbers = np.clip(found.x, lows, highs)
    end = measure(numbers.tobytes())
    if problem.seeks_pulses and abs(end.log_x) < problem.tolerance:
        # As exactly as can be told, not just to the accuracy of a descent: a step of Newton's
        # method in the logarithm of the bound.
        numbers[-1] -= end.log_x / end.room_slopes[-1, -1]
        end = _measure_candidate(candidate._replace(numbers=numbers), problem)
    return candidate._replace(
        numbers=numbers,
        loss=float(end.loss),
        violation=float(-end.room.min()),
        ended=found.status in (0, 8),  # converged, or rounding hides any descent
        path=tuple(path),
    )


def _begin_descent(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Bring a candidate within its bounds, and its pulses to where their phases matter."""
    numbers = np.clip(candidate.numbers, *_compute_bounds(candidate, problem))
    pulses = candidate.impacts.size
    numbers[:pulses] = np.clip(numbers[:pulses], _EARLY, _LATE)
    return candidate._replace(numbers=numbers)


def _compute_bounds(
    candidate: Candidate, problem: TrainProblem
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds on the numbers of a train; equal for a number that is given."""
    ones = np.ones(candidate.impacts.size)
    lows = -ones
    highs = ones.copy()
    if problem.goal == "smallest total":
        # With given signs: the sum of magnitudes has no slope at 0.
        lows, highs = np.where(candidate.weights < 0, (-ones, 0 * ones), (0 * ones, ones))
    # The first pulse starts the motion, to the positive side; at rest nothing has a slope.
    lows[0] = 1e-9
    highs[0] = 1
    least = np.log(problem.largest)
    most = least
    if problem.goal == "smallest largest":
        least, most = _RANGE
    return np.concatenate([0 * ones, lows, [least]]), np.concatenate([ones, highs, [most]])


def _descend_by_gradient(
    candidates: Sequence[Candidate], problem: TrainProblem
) -> list[Candidate]:
    """Find the best trains through the same impacts, without limits, by gradient steps."""
    ends = []
    for first in range(0, len(candidates), _AT_ONCE):
        starts = [
            _begin_descent(candidate, problem)
            for candidate in candidates[first : first + _AT_ONCE]
        ]
        descended = _run_descents(starts, problem, _STEPS)
        for number, start in enumerate(starts):
            numbers = descended.numbers[number].astype(float)
            loss = float(descended.loss[number])
            path = descended.path[number].astype(float)
            path = path[np.isfinite(path)]
            if problem.goal == "smallest total":
                # Only the pulses count, not how they are split into a bound and weights.
                numbers[start.impacts.size : -1] *= np.exp(numbers[-1])
                numbers[-1] = 0
                loss = math.exp(loss)
            objectives = np.exp(path if problem.seeks_pulses else -path)
            ends.append(
                start._replace(
                    numbers=numbers,
                    loss=loss,
                    violation=0.0,
                    path=start.path + tuple(objectives),
                )
            )
    return ends


def _descend_within_limits(
    candidates: Sequence[Candidate], problem: TrainProblem
) -> list[Candidate]:
    """Find the best trains with limits on the times, by SLSQP."""
    return [descend(_space_apart(candidate, problem), problem) for candidate in candidates]


def search(candidates: list[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Find the best train that each candidate leads to, by descents and moves between them."""
    improve = _descend_within_limits if problem.constrained else _descend_by_gradient
    # Different starts come to the same trains, whose moves need not be tried again.
    best_after_move: dict[tuple, Candidate] = {}

    def make_best_move(candidate: Candidate, k: int) -> Candidate:
        """Move pulse k to where it leads to the best train, if that is better."""
        merit = candidate.merit(problem)
        key = k, *candidate.identify(problem)
        if key not in best_after_move:
            ends = improve(list(_generate_moves(candidate, problem, k)), problem)
            best_after_move[key] = min(
                ends, key=lambda end: end.merit(problem), default=candidate
            )
        if best_after_move[key].merit(problem) >= merit - _NO_GAIN:
            return candidate
        return best_after_move[key]._replace(path=candidate.path + best_after_move[key].path)

    # state     | known                                      | next
    # start     | numbers and impacts, perhaps too close     | spaced apart, then a descent
    # descended | no train nearby, through the same impacts, | a pass: each pulse in turn makes
    #           | is better                                  | its best move, if that is better
    # improved  | the last pass has made it better           | another pass
    # settled   | the last pass has changed nothing          | ends, polished
    ends = []
    for candidate in improve(candidates, problem):
        before = np.inf
        while candidate.merit(problem) < before:
            before = candidate.merit(problem)
            for k in range(1, candidate.impacts.size):
                candidate = make_best_move(candidate, k)
        ends.append(candidate)
    return ends if problem.constrained else _polish(ends, problem)


def _polish(candidates: list[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Bring trains to the last digits by SLSQP, each only once."""
    polished: dict[tuple, Candidate] = {}
    ends = []
    for candidate in candidates:
        key = candidate.identify(problem)
        if key not in polished:
            polished[key] = descend(candidate._replace(path=()), problem)
        path = candidate.path + polished[key].path
        ends.append(polished[key]._replace(path=path))
    return ends


def _space_apart(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Put as many impacts between the pulses as these take to be far enough apart."""
    # What one pulse needs depends on those before.
    for _ in range(candidate.impacts.size if problem.spacing > 0 else 0):
        required = np.asarray(candidate.compute_outcome(problem).required)
        impacts = np.clip(required, candidate.impacts, problem.most_impacts)
        candidate = candidate._replace(impacts=impacts)
    return candidate


def _generate_moves(
    candidate: Candidate, problem: TrainProblem, k: int
) -> Iterator[Candidate]:
    """Yield trains with pulse k where no descent leads, since worse trains lie between.

    A pulse does most early in a half-cycle outward, or late inward.
    """
    candidate = candidate._replace(path=())
    impacts = candidate.impacts.tolist()

    # The same half-cycle, its neighbours, and the first two that the spacing allows.
    others = {impacts[k] - 1, impacts[k], impacts[k] + 1}
    if problem.spacing > 0:
        required = int(candidate.compute_outcome(problem).required[k])
        others |= {required, required + 1}
    for other in sorted({_clip_impacts(each, problem) for each in others}):
        for phase in (_EARLY, _LATE):
            yield _place_pulse(candidate, k, other, phase)

    # Two pulses at once.
    if problem.constrained and k < candidate.impacts.size - 1:
        # Each a half-cycle earlier or later: limits on the times tie the two together.
        for by in (-1, 1):
            one_moved = _place_pulse(
                candidate, k, _clip_impacts(impacts[k] + by, problem), _EARLY
            )
            for then in (-1, 1):
                after = _clip_impacts(impacts[k + 1] + then, problem)
                yield _place_pulse(one_moved, k + 1, after, _EARLY)

    # One pulse less. Without a latest time a single pulse is the same as two, one of them
    # weak: a descent finds that.
    if k == candidate.used - 1 and (
        problem.latest < np.inf or (problem.spacing > 0 and k > 1)
    ):
        # The others where they are, or as strong and as early as they may be.
        yield candidate._replace(used=k)
        strong = candidate.numbers.copy()
        strong[candidate.impacts.size : -1] = np.where(candidate.weights < 0, -1, 1)
        fewest = np.full_like(candidate.impacts, problem.fewest_impacts)
        yield candidate._replace(used=k, numbers=strong, impacts=fewest)


def _clip_impacts(impacts: int, problem: TrainProblem) -> int:
    """Bring a number of impacts between two pulses to one that is allowed."""
    return int(np.clip(impacts, problem.fewest_impacts, problem.most_impacts))


def _place_pulse(candidate: Candidate, k: int, impacts: int, phase: float) -> Candidate:
    """Put pulse k into another half-cycle, in the direction in which the block moves there."""
    numbers = candidate.numbers.copy()
    between = candidate.impacts.copy()
    size = max(abs(candidate.weights[k]), _LEAST)
    between[k] = impacts
    numbers[k] = phase
    numbers[between.size + k] = size if phase == _EARLY else -size
    return candidate._replace(numbers=numbers, impacts=between)
