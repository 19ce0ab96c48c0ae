"""The worst train of all sequences of impacts and pulses: moves between descents."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .train_optimization import LATE_PENALTY, ROUNDS, Problem, Search, outcomes, solve, tolerance
from .train_through_impacts import Outcome

_MAX_CANDIDATES = 8  # moves that are solved, of those that look good
_NO_GAIN = 1e-9  # relative improvement that is none


def searched(searches: Search, problem: Problem, fewest: int) -> tuple[Search, np.ndarray]:
    """The best that every start leads to, and the objective in each step on the way.

    `fewest` impacts lie between two pulses, at least.
    """
    if problem.constrained:
        searches = _in_time(searches, problem)
    searches, path = _solved(searches, problem)
    history = [path]
    for _ in range(8 * searches.angles.shape[1]):  # far more moves than searches take
        moved = _after_best_move(searches, problem, fewest, history)
        if moved is None:
            break
        searches = moved
    unit = float(problem.rocker.unit) if problem.seeks_bound else 1.0
    return searches, np.concatenate(history, axis=1) * unit


def _in_time(searches: Search, problem: Problem) -> Search:
    """With as many impacts between the pulses as these take to be far enough apart."""
    for _ in range(searches.angles.shape[1]):
        required = np.asarray(outcomes(searches, problem).required)
        impacts = np.clip(np.maximum(searches.impacts, required), None, problem.max_impacts)
        if (impacts == searches.impacts).all():
            break
        searches = searches._replace(impacts=impacts)
    return searches


def _solved(searches: Search, problem: Problem, rounds: int = ROUNDS) -> tuple[Search, np.ndarray]:
    solved, losses = jax.device_get(solve(searches, problem, jnp.asarray(rounds)))
    if not problem.seeks_bound:
        return solved, np.exp(-losses)
    # Nearly what a train needs: the velocity it leads to is almost proportional to its bound.
    with np.errstate(over="ignore"):
        return solved, np.exp(searches.log_bound[:, None] + losses)


def _after_best_move(
    searches: Search, problem: Problem, fewest: int, history: list[np.ndarray]
) -> Search | None:
    """The searches, each after a move that improves it; None if no move improves any."""
    feasible, each = searches.violation < tolerance(searches), np.arange(searches.loss.size)
    # As long as a start is not feasible, its multipliers only grow.
    begin = searches._replace(multipliers=np.where(feasible[:, None], searches.multipliers, 0))
    moves = [_solved(move, problem, 1)[0] for move in _moved(begin, fewest, problem)]
    if not moves:
        return None
    # All moves are compared at the same bound and multipliers; only the best are solved.
    losses = np.stack([np.nan_to_num(m.loss, nan=np.inf) + _lateness(m) for m in moves])
    least = np.where(feasible, searches.loss + _lateness(searches), np.inf)
    improved = np.zeros(each.size, bool)
    for choice in losses.argsort(axis=0)[:_MAX_CANDIDATES]:
        promising = ~improved & (losses[choice, each] < least - _NO_GAIN)
        if not promising.any():
            break
        picked = Search(*(np.stack(parts)[choice, each] for parts in zip(*moves, strict=True)))
        picked = picked._replace(log_bound=begin.log_bound, multipliers=begin.multipliers)
        solved, path = _solved(_where(promising, picked, searches), problem)
        gained = promising & (_merit(solved, problem) < _merit(searches, problem) - _NO_GAIN)
        searches, improved = _where(gained, solved, searches), improved | gained
        if gained.any():
            history.append(np.where(gained[:, None], path, history[-1][:, -1:]))
    return searches if improved.any() else None


def _merit(searches: Search, problem: Problem) -> Any:
    """What a search is compared by: anything feasible is lower than what is not."""
    reached = searches.log_bound if problem.seeks_bound else searches.loss
    feasible = searches.violation < tolerance(searches)
    merit = np.where(feasible, reached, 100 + searches.violation)
    return np.nan_to_num(merit, nan=np.inf) + _lateness(searches)


def _lateness(searches: Search) -> Any:
    """Of equally good trains, the earlier one counts as better.

    A pulse right before an impact does as much as one right after the impact before.
    """
    return 10 * _NO_GAIN * (np.sin(0.5 * searches.angles[:, 1:]) ** 2).sum(axis=1)


def _where(condition: np.ndarray, ones: Search, others: Search) -> Search:
    """Start by start."""

    def chosen(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.where(condition.reshape(-1, *(1,) * (one.ndim - 1)), one, other)

    return jax.tree.map(chosen, ones, others)


def _moved(searches: Search, fewest: int, problem: Problem) -> list[Search]:
    """Trains with a pulse where no descent leads, since there are valleys between."""
    early, late = 0.3, np.pi - 0.3  # in a half-cycle; at its very ends the gradient is 0
    last = searches.angles.shape[1] - 1

    def placed(trains: Search, k: int, impacts: Any, angle: float | None = None) -> Search:
        """Pulse k after so many impacts; early outward, or late inward."""
        impacts = np.clip(impacts, fewest, problem.max_impacts)
        trains = trains._replace(impacts=_with_column(trains.impacts, k, impacts))
        if angle is None:
            return trains
        sizes = abs(trains.sizes[:, k]) * (1 if angle == early else -1)
        return trains._replace(
            angles=_with_column(trains.angles, k, angle), sizes=_with_column(trains.sizes, k, sizes)
        )

    moves = []
    required = searches.impacts
    if problem.constrained:
        required = np.asarray(outcomes(searches, problem).required)
    for k in range(1, last + 1):
        impacts, angles = searches.impacts[:, k], searches.angles[:, k]
        reversed_ = searches._replace(sizes=_with_column(searches.sizes, k, -searches.sizes[:, k]))
        mirrored = reversed_._replace(angles=_with_column(searches.angles, k, np.pi - angles))
        moves += [reversed_, mirrored]
        moves += [placed(searches, k, impacts + by) for by in (1, -1)]
        if not problem.constrained:
            continue
        moves += [placed(searches, k, impacts + by, early) for by in (-1, 0, 1)]
        moves += [placed(searches, k, impacts + by, late) for by in (-1, 0)]
        # Right when the spacing allows, at the end of that half-cycle, and one impact later.
        for by, angle in ((0, early), (0, late), (1, early)):
            moves.append(placed(searches, k, required[:, k] + by, angle))
        if k < last:
            # What comes earlier after one pulse, comes later after the next, and so on.
            after = searches.impacts[:, k + 1]
            for by in (-1, 1):
                trains = placed(searches, k, impacts + by, early)
                moves += [placed(trains, k + 1, after + then, early) for then in (-1, 1)]
    if problem.constrained and last:
        moves.append(searches._replace(count=np.maximum(searches.count - 1, 1)))
    return moves


def _with_column(array: np.ndarray, k: int, values: Any) -> np.ndarray:
    array = np.array(array)
    array[:, k] = values
    return array


def evaluated(
    searches: Search, problem: Problem
) -> tuple[Outcome, np.ndarray, np.ndarray, np.ndarray]:
    """What the trains do, their pulses [m/s], objectives, and which keep the constraints."""
    outcome = jax.device_get(outcomes(searches, problem))
    rate = float(problem.rocker.block.frequency_parameter)
    feasible = outcome.lacking.max(axis=1) * rate < tolerance(searches)
    if problem.constrained:
        feasible &= outcome.times[:, -1] < float(problem.latest) + tolerance(searches)
    impulses = np.exp(searches.log_bound)[:, None] * outcome.weights * float(problem.rocker.unit)
    impulses[:, 0] = abs(impulses[:, 0])
    counted = np.arange(impulses.shape[1]) < searches.count[:, None]
    magnitudes = np.where(counted, abs(impulses), 0)
    objectives = outcome.x
    if problem.seeks_bound:
        largest = problem.goal == "smallest largest"
        objectives = magnitudes.max(axis=1) if largest else magnitudes.sum(axis=1)
    return outcome, impulses, objectives, feasible


def best_start(searches: Search, problem: Problem) -> int:
    """Which start led to the best train: of equally good ones, one whose search has ended.

    Objectives are equal if they differ by less than the tolerance of the constraints.
    """
    _, _, objectives, feasible = evaluated(searches, problem)
    losses = np.where(feasible, objectives if problem.seeks_bound else -objectives, np.inf)
    equal = losses <= losses.min() + tolerance(searches) * abs(losses.min())
    ended = equal & np.asarray(searches.ended)
    return int(np.argmin(np.where(ended, losses, np.inf) if ended.any() else losses))


def with_time_to_verify(searches: Search, problem: Problem) -> tuple[Search, Problem]:
    """The same searches, ended so early that the best train may be raised to verify it.

    The impacts of a raised train come later: by how much depends on the train, and any more
    time than that would make the pulses larger than need be.
    """
    latest, dtype = float(problem.latest), searches.angles.dtype
    shortest = (searches.angles.shape[1] - 1) * float(problem.spacing)
    raised = 1.01 * trial_of(dtype)  # 1 % for the margins around impacts
    # As exactly as the multipliers keep the limit.
    inexact = tolerance(searches) / (LATE_PENALTY * float(problem.rocker.block.frequency_parameter))
    for _ in range(3):
        best = best_start(searches, problem)
        end, raised_end = (
            np.asarray(outcomes(searches._replace(log_bound=bound), problem).times)[best, -1]
            for bound in (searches.log_bound, searches.log_bound + raised)
        )
        if raised_end <= latest:
            break
        earlier = max(latest - (raised_end - end) - inexact, shortest)
        problem = problem._replace(latest=jnp.asarray(earlier, dtype))
        searches, _ = _solved(searches, problem)
    return searches, problem


def trial_of(dtype: Any) -> float:
    """By how much a train is raised and lowered to verify it."""
    return max(1e-6, float(np.finfo(dtype).eps) ** 0.5)
