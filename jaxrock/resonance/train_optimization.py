"""The search for the worst train: descents, and moves to other sequences of impacts.

Without limits on the times trains descend by gradient steps (`train_descent`), and what they
come to is polished. With limits, and to polish, a descent is SciPy's sequential quadratic
programming (SLSQP; Kraft 1988, report DFVLR-FB 88-28, and 1994, TOMS algorithm 733,
https://doi.org/10.1145/192115.192124). It takes the limits as constraints: on the times and,
where the smallest pulses are sought, that the block overturns. It takes fifty times as much
computation, but gradient steps with penalties stop at worse trains.
"""

import functools
import math
import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from .train_candidates import (
    AT_ONCE,
    NO_GAIN,
    Candidate,
    Measurement,
    TrainProblem,
    compute_bounds,
    measure_candidate,
    run_descents,
)

_STEPS = 50  # of a descent, far more than most take
# Phases of a pulse early and late in its half-cycle. No descent begins closer to the ends,
# where the slope is 0: the energy depends on the cosine of pi times the phase.
_EARLY = 0.1
_LATE = 0.9
# Least size, over the bound, of a pulse that is moved: of one of size 0 the phase has no
# slope.
_LEAST = 0.1


def descend(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Find the best train through the same impacts, by SLSQP from a candidate."""
    from scipy.optimize import minimize  # which loads slowly

    lows, highs = compute_bounds(candidate, problem)
    begin = _begin_descent(candidate, problem).numbers
    path = list(candidate.path)

    @functools.lru_cache(maxsize=2)
    def measure(numbers: bytes) -> Measurement:
        """Measure the train of numbers, once for all that SciPy asks about them."""
        # SciPy may ask a rounding error beyond the bounds.
        within = np.clip(np.frombuffer(numbers), lows, highs)
        return measure_candidate(candidate._replace(numbers=within), problem)

    with warnings.catch_warnings():
        # SciPy says so where its own rounding goes beyond the bounds.
        warnings.filterwarnings("ignore", "Values in x were outside bounds")
        minimum = minimize(
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
    numbers = np.clip(minimum.x, lows, highs)
    end = measure(numbers.tobytes())
    if problem.seeks_pulses and abs(end.log_x) < problem.tolerance:
        # As exactly as can be told, not just to the accuracy of a descent: a step of Newton's
        # method in the logarithm of the bound.
        numbers[-1] -= end.log_x / end.room_slopes[-1, -1]
        end = measure_candidate(candidate._replace(numbers=numbers), problem)
    return candidate._replace(
        numbers=numbers,
        loss=float(end.loss),
        violation=float(-end.room.min()),
        ended=minimum.status in (0, 8),  # converged, or rounding hides any descent
        path=tuple(path),
    )


def _begin_descent(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Bring a candidate within its bounds, and its pulses to where their phases matter."""
    numbers = np.clip(candidate.numbers, *compute_bounds(candidate, problem))
    pulses = candidate.impacts.size
    numbers[:pulses] = np.clip(numbers[:pulses], _EARLY, _LATE)
    return candidate._replace(numbers=numbers)


def _descend_by_gradient(
    candidates: Sequence[Candidate], problem: TrainProblem
) -> list[Candidate]:
    """Find the best trains through the same impacts, without limits, by gradient steps."""
    ends = []
    for first in range(0, len(candidates), AT_ONCE):
        starts = [
            _begin_descent(candidate, problem)
            for candidate in candidates[first : first + AT_ONCE]
        ]
        descended = run_descents(starts, problem, _STEPS)
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
        if best_after_move[key].merit(problem) >= merit - NO_GAIN:
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
    half_cycles = {impacts[k] - 1, impacts[k], impacts[k] + 1}
    if problem.spacing > 0:
        required = int(candidate.compute_outcome(problem).required[k])
        half_cycles |= {required, required + 1}
    for other in sorted({_clip_impacts(half_cycle, problem) for half_cycle in half_cycles}):
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
