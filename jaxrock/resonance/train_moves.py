"""The worst train of all sequences of impacts and pulses: moves between descents."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .timed_train import Outcome
from .train_descent import (
    PRESSURE,
    ROUNDS,
    STEPS,
    Goal,
    Question,
    Search,
    outcomes,
    solve,
    tolerance,
    train_of,
)

_TURNS = 8  # of moves that are tried, of those that look good
_ENOUGH = 1e-9  # relative improvement that is none


def _moved(searches: Search, fewest: int, question: Question) -> list[Search]:
    """Each pulse put to where descent does not lead: there are valleys between."""
    parts = (searches.angles, searches.sizes, searches.skips)
    start, end = 0.3, np.pi - 0.3  # of a half-cycle; at its very ends nothing has a slope

    def skipping(k: int, by: int, angle: float | None = None) -> Any:
        def change(angles: Any, sizes: Any, skips: Any) -> None:
            skips[:, k] = np.clip(skips[:, k] + by, fewest, question.most)
            if angle is not None:
                angles[:, k] = angle
                sizes[:, k] = abs(sizes[:, k]) * (1 if angle < 0.5 * np.pi else -1)

        return change

    def soon(k: int, by: int, angle: float) -> Any:
        def change(angles: Any, sizes: Any, skips: Any) -> None:
            # The first that the spacing allows, or the one after that.
            skips[:, k] = np.clip(required[:, k] + by, fewest, question.most)
            angles[:, k] = angle
            sizes[:, k] = abs(sizes[:, k]) * (1 if angle == start else -1)

        return change

    def other_way(k: int, mirrored: bool) -> Any:
        def change(angles: Any, sizes: Any, skips: Any) -> None:
            sizes[:, k] *= -1
            if mirrored:
                angles[:, k] = np.pi - angles[:, k]

        return change

    changes: list[list[Any]] = []
    last = searches.angles.shape[1] - 1
    limited = question.limits is not None
    required = np.asarray(outcomes(searches, question).required) if limited else searches.skips
    for k in range(1, last + 1):
        changes += [
            [other_way(k, False)],
            [other_way(k, True)],
            [skipping(k, 1)],
            [skipping(k, -1)],
        ]
        if limited:
            changes += [[skipping(k, by, start)] for by in (-1, 0, 1)]
            changes += [[skipping(k, by, end)] for by in (-1, 0)]
            changes += [[soon(k, by, angle)] for by, angle in ((0, start), (0, end), (1, start))]
        if limited and k < last:
            # What comes earlier after one pulse, comes later after the next, and so on.
            changes += [
                [skipping(k, this, start), skipping(k + 1, next, start)]
                for this in (-1, 1)
                for next in (-1, 1)
            ]
    found = []
    for each in changes:
        new = [np.array(part) for part in parts]
        for change in each:
            change(*new)
        found.append(searches._replace(**dict(zip(("angles", "sizes", "skips"), new, strict=True))))
    if limited and last:
        found.append(searches._replace(length=np.maximum(searches.length - 1, 1)))
    return found


def searched(searches: Search, question: Question, fewest: int) -> tuple[Search, np.ndarray]:
    """The best that every start leads to, and the objective on the way."""
    seeks = question.goal != "most rotation"
    unit, count = float(question.rocker.unit), searches.angles.shape[1]
    history: list[np.ndarray] = []

    def solved(option: Search, rounds: int = ROUNDS) -> tuple[Search, np.ndarray, np.ndarray]:
        found, broken, losses = jax.device_get(
            solve(option, question, *(jnp.asarray(n) for n in (rounds, STEPS)))
        )
        # Nearly what a train needs, which is in proportion to the velocity it leads to.
        with np.errstate(over="ignore"):
            path = np.exp(option.strength[:, None] + losses) * unit if seeks else np.exp(-losses)
        return found, broken, path

    def later(searches: Search) -> Any:
        # Right before an impact a pulse does as much as right after the one before, later.
        return 10 * _ENOUGH * (np.sin(0.5 * searches.angles[:, 1:]) ** 2).sum(axis=1)

    def rank(searches: Search, broken: np.ndarray) -> Any:
        reached = searches.strength if seeks else searches.loss
        kept = broken < tolerance(searches)
        return np.nan_to_num(np.where(kept, reached, 100 + broken), nan=np.inf) + later(searches)

    if question.limits is not None:
        for _ in range(count):
            required = np.asarray(outcomes(searches, question).required)
            skips = np.clip(np.maximum(searches.skips, required), None, question.most)
            if (skips == searches.skips).all():
                break
            searches = searches._replace(skips=skips)
    searches, broken, path = solved(searches)
    history.append(path)
    each = np.arange(broken.size)
    for _ in range(8 * count):
        # Of starts that keep no constraint yet, the multipliers only grow.
        kept = broken < tolerance(searches)
        begin = searches._replace(multipliers=np.where(kept[:, None], searches.multipliers, 0))
        options = [solved(option, 1)[0] for option in _moved(begin, fewest, question)]
        if not options:
            break
        # Of the best at the same strength and multipliers, several in turn are solved.
        ranks = np.stack([np.nan_to_num(o.loss, nan=np.inf) + later(o) for o in options])
        least = np.where(kept, searches.loss + later(searches), np.inf)
        order = ranks.argsort(axis=0)
        better = np.zeros(broken.size, bool)
        for turn in range(min(_TURNS, len(options))):
            hopeful = ~better & (ranks[order[turn], each] < least - _ENOUGH)
            if not hopeful.any():
                break

            picked = jax.tree.map(lambda *of: np.stack(of)[order[turn], each], *options)  # noqa: B023
            picked = picked._replace(strength=begin.strength, multipliers=begin.multipliers)
            candidates = _where(hopeful, picked, searches)
            found, found_broken, path = solved(candidates)
            gained = hopeful & (rank(found, found_broken) < rank(searches, broken) - _ENOUGH)
            better |= gained
            searches = _where(gained, found, searches)
            broken = np.where(gained, found_broken, broken)
            if gained.any():
                history.append(np.where(gained[:, None], path, history[-1][:, -1:]))
        if not better.any():
            break
    return searches, np.concatenate(history, axis=1)


def with_time_to_try(
    searches: Search, question: Question, spacing: float, latest: float
) -> tuple[Search, Question]:
    """The same searches, ended so early that the best train may be raised to try it.

    The impacts of a train that is raised come later: by how much depends on the train, and
    any time more than that would make the pulses larger than need be.
    """
    rate = float(question.rocker.block.frequency_parameter)
    raised = 1.01 * trial_of(searches.angles.dtype)
    limits = question.limits
    assert limits is not None
    # As exactly as the multipliers keep the limit; 1 % is for hairs after impacts.
    inexact = tolerance(searches) / (PRESSURE * rate)
    for _ in range(3):
        best = best_start(searches, question)
        ends = [
            np.asarray(outcomes(searches._replace(strength=strength), question).times)[best, -1]
            for strength in (searches.strength, searches.strength + raised)
        ]
        if ends[1] <= latest:
            break
        far = max(latest - (ends[1] - ends[0]) - inexact, (searches.angles.shape[1] - 1) * spacing)
        limits = limits._replace(latest=jnp.asarray(far, searches.angles.dtype))
        question = question._replace(limits=limits)
        found = solve(searches, question, *(jnp.asarray(n) for n in (ROUNDS, STEPS)))
        searches = jax.device_get(found[0])
    return searches, question


def _where(condition: np.ndarray, ones: Search, others: Search) -> Search:
    """Start by start."""

    def chosen(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.where(condition.reshape(-1, *(1,) * (one.ndim - 1)), one, other)

    return jax.tree.map(chosen, ones, others)


@eqx.filter_jit
def _weights(searches: Search, goal: Goal) -> Any:
    return jax.vmap(lambda search: train_of(search, goal).weight)(searches)


def reached(
    searches: Search, question: Question
) -> tuple[Outcome, np.ndarray, np.ndarray, np.ndarray]:
    """What trains do, their pulses, what they come to, and whether they keep the constraints."""
    outcome = jax.device_get(outcomes(searches, question))
    kept = outcome.lacking.max(axis=1) * float(question.rocker.block.frequency_parameter)
    kept = kept < tolerance(searches)
    if question.limits is not None:
        kept &= outcome.times[:, -1] < float(question.limits.latest) + tolerance(searches)
    weights = np.asarray(_weights(searches, question.goal))
    magnitudes = np.exp(searches.strength)[:, None] * weights * float(question.rocker.unit)
    magnitudes[:, 0] = abs(magnitudes[:, 0])
    counted = np.arange(weights.shape[1]) < searches.length[:, None]
    if question.goal == "smallest largest":
        objectives = np.where(counted, abs(magnitudes), 0).max(axis=1)
    elif question.goal == "smallest total":
        objectives = np.where(counted, abs(magnitudes), 0).sum(axis=1)
    else:
        objectives = outcome.x
    return outcome, magnitudes, objectives, kept


def best_start(searches: Search, question: Question) -> int:
    """Which start came to the best train: of equally good ones, one whose search has ended.

    Objectives count as equal if they differ by less than the tolerance of the constraints.
    """
    _, _, objectives, kept = reached(searches, question)
    sign = -1 if question.goal == "most rotation" else 1
    losses = np.where(kept, sign * objectives, np.inf)
    equal = losses <= losses.min() + tolerance(searches) * abs(losses.min())
    ended = equal & np.asarray(searches.ended)
    return int(np.argmin(np.where(ended, losses, np.inf) if ended.any() else losses))


def trial_of(dtype: Any) -> float:
    """By how much a train is raised and lowered to try it."""
    return max(1e-6, float(np.finfo(dtype).eps) ** 0.5)
