"""The search for the worst train: descents, and moves to other sequences of impacts and pulses.

A descent minimises an augmented Lagrangian by BFGS, from many starts at once. That the block
overturns is a constraint like those on the times, where the smallest pulses are sought.
"""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .pulse_train import Rocker
from .train_through_impacts import Outcome, Train, shot

Goal = Literal["smallest largest", "smallest total", "most rotation"]

PENALTY = 100.0  # of what is violated, squared
_ROUNDS = 30  # descents at most, each followed by a correction of the multipliers
_STEPS = 40  # of BFGS in a descent
_STEP_LENGTHS = 3.0 * 0.35 ** np.arange(9)  # over Newton's
_MAX_CANDIDATES = 8  # moves that are solved, of those that look good
_NO_GAIN = 1e-9  # relative improvement that is none


class Search(NamedTuple):
    """One start: what is optimised, and how far that got."""

    free: Any  # (2 pulses + 1,) pi times the phases, sizes, logarithm of the bound on the pulses
    impacts: Any  # (pulses,) between a pulse and the one before
    count: Any  # pulses of the train, the others are left out
    multipliers: Any  # (pulses + 1,) of the constraints
    loss: Any
    violation: Any  # of the constraints, the largest
    ended: Any  # whether nothing is left to correct


class Problem(NamedTuple):
    """What all starts have in common."""

    rocker: Rocker
    goal: Goal
    max_impacts: int  # between two pulses
    constrained: bool  # whether the times of the pulses are
    spacing: Any  # [s]
    latest: Any  # [s]

    @property
    def seeks_bound(self) -> bool:
        """Whether the bound on the pulses is sought, not given."""
        return self.goal != "most rotation"

    def train(self, search: Search) -> Train:
        """The train of free variables; over the bound a pulse is at most 1, or all together.

        Through sines and squares, so that at a bound the derivative is 0.
        """
        parts = [search.impacts.size, search.free.size - 1]  # JAX 0.10 does not count backwards
        angles, sizes, log_bound = jnp.split(search.free, parts)
        weight = jnp.sin(sizes)
        if self.goal == "smallest total":
            counted = jnp.where(jnp.arange(sizes.size) < search.count, sizes, 0)
            weight = counted * abs(counted) / (counted**2).sum()
        bound = jnp.exp(log_bound if self.seeks_bound else jax.lax.stop_gradient(log_bound))
        return Train(angles / jnp.pi, bound * weight, search.impacts)

    def outcome(self, search: Search, *, timed: bool) -> Outcome:
        """What the train of a search does."""
        limits = {"spacing": self.spacing, "count": search.count, "max_impacts": self.max_impacts}
        return shot(self.rocker, self.train(search), timed=timed, **limits)

    def lagrangian(self, free: Any, search: Search) -> tuple[Any, tuple[Any, Any]]:
        """Augmented Lagrangian; how near the goal is, and what is violated where positive."""
        outcome = self.outcome(search._replace(free=free), timed=self.constrained)
        violations = jnp.full_like(search.multipliers, -1)
        if self.constrained:
            late = outcome.times[-1] - self.latest
            violations = jnp.append(outcome.lacking, late)
            violations = violations * self.rocker.block.frequency_parameter
        loss = distance = -jnp.log(jnp.maximum(outcome.x, 1e-30))
        if self.seeks_bound:
            violations = violations.at[0].set(distance)
            # What the train needs, nearly: its velocity is almost proportional to the bound.
            loss, distance = free[-1], free[-1] + distance
        pressed = jnp.maximum(search.multipliers + PENALTY * violations, 0)
        added = (pressed**2 - search.multipliers**2).sum() / (2 * PENALTY)
        return loss + added, (distance, violations)


class _Descent(NamedTuple):
    """A search by BFGS: what was found at the last point, and how far it got."""

    search: Search
    last: Any
    gradient: Any
    inverse: Any  # of the Hessian, estimated
    steps: Any
    stuck: Any  # times in turn that no length of step led lower
    rounds: Any
    path: Any  # (_STEPS,) distances from the goal in the first round


@eqx.filter_jit
def solve(searches: Search, problem: Problem, rounds: Any) -> tuple[Search, Any]:
    """All searches after so many rounds, and how near the first descent was in each step."""
    return jax.vmap(lambda search: _solved(search, problem, rounds))(searches)


def _solved(search: Search, problem: Problem, rounds: Any) -> tuple[Search, Any]:
    eps = jnp.finfo(search.free.dtype).eps
    eye = jnp.eye(search.free.size, dtype=search.free.dtype)

    def goes_on(state: _Descent) -> Any:
        return ~state.search.ended & (state.rounds < rounds)

    def step(state: _Descent) -> _Descent:
        search = state.search
        evaluated = jax.value_and_grad(problem.lagrangian, has_aux=True)(search.free, search)
        (loss, (distance, violations)), gradient = evaluated
        inverse, direction = _direction(state, gradient)
        lengths = jnp.asarray(_STEP_LENGTHS, eye.dtype)[:, None]
        points = search.free[None] + lengths * direction[None]
        losses = jax.vmap(lambda free: problem.lagrangian(free, search)[0])(points)
        losses = jnp.where(jnp.isfinite(losses), losses, jnp.inf)
        k = losses.argmin()
        lower = losses[k] < loss
        flat = abs(gradient).max() <= 8 * eps
        ends = flat | (~lower & (state.stuck > 0)) | (state.steps >= _STEPS)
        moved = search._replace(
            free=jnp.where(lower, points[k], search.free), loss=loss, violation=violations.max()
        )
        corrected = _corrected(moved._replace(free=search.free), problem, violations)
        path = jnp.where(jnp.arange(_STEPS) >= state.steps, distance, state.path)
        return _Descent(
            search=jax.tree.map(lambda one, other: jnp.where(ends, one, other), corrected, moved),
            last=search.free,
            gradient=gradient,
            # If stuck, the second time along the gradient.
            inverse=jnp.where(lower & ~ends, inverse, eye),
            steps=jnp.where(ends, 0, state.steps + 1),
            stuck=jnp.where(lower | ends, 0, state.stuck + 1),
            rounds=state.rounds + jnp.where(ends, 1, 0),
            path=jnp.where(state.rounds == 0, path, state.path),
        )

    search = search._replace(ended=jnp.zeros((), bool))
    none, flat = jnp.zeros((), int), jnp.zeros_like(search.free)
    begin = _Descent(search, search.free, flat, eye, none, none, none, jnp.zeros(_STEPS, eye.dtype))
    end = jax.lax.while_loop(goes_on, step, begin)
    return end.search, end.path


def _direction(state: _Descent, gradient: Any) -> tuple[Any, Any]:
    """The updated inverse Hessian, and the step that follows; along the gradient if uphill."""
    eps = jnp.finfo(gradient.dtype).eps
    eye = jnp.eye(gradient.size, dtype=gradient.dtype)
    moved, turned = state.search.free - state.last, gradient - state.gradient
    curvature = moved @ turned
    curved = curvature > eps * jnp.linalg.norm(moved) * jnp.linalg.norm(turned)
    scale = 1 / jnp.where(curved, curvature, 1)
    side = eye - scale * jnp.outer(moved, turned)
    updated = side @ state.inverse @ side.T + scale * jnp.outer(moved, moved)
    inverse = jnp.where(curved & (state.steps > 0), updated, state.inverse)
    direction = -inverse @ gradient
    descends = (direction @ gradient < 0) & jnp.isfinite(direction).all()
    direction = jnp.where(descends, direction, -gradient)
    # No further than a radian.
    direction = direction / jnp.maximum(abs(direction).max(), 1)
    return jnp.where(descends, inverse, eye), direction


def _corrected(search: Search, problem: Problem, violations: Any) -> Search:
    """Multipliers and bound after a descent, and whether that changes anything."""
    root_eps, size = jnp.finfo(search.free.dtype).eps ** 0.5, search.impacts.size
    multipliers = jnp.maximum(search.multipliers + PENALTY * violations, 0)
    ended = abs(multipliers - search.multipliers).max() < 10 * root_eps
    # Off the ends of the half-cycles: the gradient is 0 there, even if constraints are violated.
    angles = jnp.clip(jnp.arccos(jnp.cos(search.free[:size])), 0.1, jnp.pi - 0.1)
    pushed = search.free.at[:size].set(angles)
    free = jnp.where(search.violation > 1e-3, pushed, search.free)
    violation = search.violation
    if problem.seeks_bound:
        # The multiplier of a constraint is by how much the lowest bound changes with it.
        due = violations[0] * jnp.where(multipliers[0] > 0, multipliers[0], 0.1)
        free = free.at[-1].add(jnp.clip(due, -1, 1))
        violation = jnp.maximum(violations[1:].max(), abs(due))
        ended &= abs(due) < root_eps
    return search._replace(free=free, multipliers=multipliers, violation=violation, ended=ended)


@eqx.filter_jit
def outcomes(searches: Search, problem: Problem) -> tuple[Train, Outcome]:
    """The trains of all searches, and what they do, with their times."""
    return jax.vmap(lambda s: (problem.train(s), problem.outcome(s, timed=True)))(searches)


def solved(searches: Search, problem: Problem, rounds: int = _ROUNDS) -> tuple[Search, np.ndarray]:
    """All searches, on the host, and the objective in each step of the first descent."""
    searches, path = jax.device_get(solve(searches, problem, jnp.asarray(rounds)))
    return searches, np.exp(path if problem.seeks_bound else -path)


def searched(searches: Search, problem: Problem, fewest: int) -> tuple[Search, np.ndarray]:
    """The best that every start leads to, and the objective in each step on the way.

    `fewest` impacts lie between two pulses, at least.
    """
    pulses = searches.impacts.shape[1]
    for _ in range(pulses if problem.constrained else 0):
        # As many impacts between the pulses as these take to be far enough apart.
        impacts = np.clip(_required(searches, problem), searches.impacts, problem.max_impacts)
        searches = searches._replace(impacts=impacts)
    searches, path = solved(searches, problem)
    history = [path]
    for _ in range(8 * pulses):  # far more moves than searches take
        moved = _after_best_move(searches, problem, fewest, history)
        if moved is None:
            break
        searches = moved
    return searches, np.concatenate(history, axis=1)


def _required(searches: Search, problem: Problem) -> np.ndarray:
    return np.asarray(outcomes(searches, problem)[1].required)


def feasible(searches: Search) -> np.ndarray:
    """Which keep the constraints."""
    return np.asarray(searches.violation) < tolerance(searches)


def tolerance(searches: Search) -> float:
    """Of the constraints, of those on times over the frequency parameter."""
    return 10 * float(np.finfo(searches.free.dtype).eps) ** 0.5


def _after_best_move(
    searches: Search, problem: Problem, fewest: int, history: list[np.ndarray]
) -> Search | None:
    """The searches, each after a move that improves it; None if no move improves any."""
    keeps, each = feasible(searches), np.arange(searches.loss.size)
    # As long as a start is not feasible, its multipliers only grow.
    begin = searches._replace(multipliers=np.where(keeps[:, None], searches.multipliers, 0))
    moves = [solved(move, problem, 1)[0] for move in _moved(begin, fewest, problem)]
    if not moves:
        return None
    # All moves are compared at the same multipliers; only the best are solved.
    losses = np.stack([np.nan_to_num(m.loss, nan=np.inf) + _lateness(m) for m in moves])
    least = np.where(keeps, searches.loss + _lateness(searches), np.inf)
    improved = np.zeros(each.size, bool)
    for choice in losses.argsort(axis=0)[:_MAX_CANDIDATES]:
        promising = ~improved & (losses[choice, each] < least - _NO_GAIN)
        if not promising.any():
            break
        picked = Search(*(np.stack(parts)[choice, each] for parts in zip(*moves, strict=True)))
        picked = picked._replace(multipliers=begin.multipliers)
        tried, path = solved(_where(promising, picked, searches), problem)
        gained = promising & (_merit(tried) < _merit(searches) - _NO_GAIN)
        searches, improved = _where(gained, tried, searches), improved | gained
        if gained.any():
            history.append(np.where(gained[:, None], path, history[-1][:, -1:]))
    return searches if improved.any() else None


def _merit(searches: Search) -> np.ndarray:
    """What a search is compared by: anything feasible is lower than what is not."""
    merit = np.where(feasible(searches), searches.loss, 100 + searches.violation)
    return np.nan_to_num(merit, nan=np.inf) + _lateness(searches)


def _lateness(searches: Search) -> np.ndarray:
    """Of equally good trains, the earlier one counts as better.

    A pulse right before an impact does as much as one right after the impact before.
    """
    angles = searches.free[:, 1 : searches.impacts.shape[1]]
    return 10 * _NO_GAIN * (np.sin(0.5 * angles) ** 2).sum(axis=1)


def _where(condition: np.ndarray, ones: Search, others: Search) -> Search:
    """Start by start."""
    parts = zip(ones, others, strict=True)
    return Search(*(np.where(condition.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in parts))


def _moved(searches: Search, fewest: int, problem: Problem) -> list[Search]:
    """Trains with a pulse where no descent leads, since there are valleys between."""
    early, late = 0.3, np.pi - 0.3  # in a half-cycle; at its very ends the gradient is 0
    pulses = searches.impacts.shape[1]

    def placed(trains: Search, k: int, impacts: Any, angle: Any, sign: Any) -> Search:
        free, between = trains.free.copy(), trains.impacts.copy()
        between[:, k] = np.clip(impacts, fewest, problem.max_impacts)
        free[:, k], free[:, pulses + k] = angle, sign * free[:, pulses + k]
        return trains._replace(free=free, impacts=between)

    def at(trains: Search, k: int, impacts: Any, angle: float = early) -> Search:
        """Early in a half-cycle outward, late inward."""
        outward = np.sign(trains.free[:, pulses + k]) * (1 if angle == early else -1)
        return placed(trains, k, impacts, angle, outward)

    moves = []
    required = _required(searches, problem) if problem.constrained else searches.impacts
    for k in range(1, pulses):
        impacts, angles = searches.impacts[:, k], searches.free[:, k]
        moves += [placed(searches, k, impacts, angle, -1) for angle in (angles, np.pi - angles)]
        moves += [placed(searches, k, impacts + by, angles, 1) for by in (1, -1)]
        if not problem.constrained:
            continue
        moves += [at(searches, k, impacts + by) for by in (-1, 1)]
        # Right when the spacing allows, at the end of that half-cycle, and one impact later.
        moves += [
            at(searches, k, required[:, k] + by, angle)
            for by, angle in ((0, early), (0, late), (1, early))
        ]
        if k < pulses - 1:
            # What comes earlier after one pulse, comes later after the next, and so on.
            after = searches.impacts[:, k + 1]
            for by in (-1, 1):
                trains = at(searches, k, impacts + by)
                moves += [at(trains, k + 1, after + then) for then in (-1, 1)]
    if problem.constrained and pulses > 1:
        moves.append(searches._replace(count=np.maximum(searches.count - 1, 1)))
    return moves
