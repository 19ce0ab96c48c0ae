"""Descent to the worst train of one sequence of impacts and pulses, from many starts at once."""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .pulse_train import Rocker
from .timed_train import Outcome, Train, shot

Goal = Literal["smallest largest", "smallest total", "most rotation"]

STEPS = 40  # of BFGS at a time
ROUNDS = 30  # of corrections to strength and multipliers
_LENGTHS = 3.0 * 0.35 ** np.arange(9)  # of a step, over Newton's
PRESSURE = 30.0  # of a train that takes too long
_HARD = 300.0  # of a half-cycle that ends before the pulse may come


class Search(NamedTuple):
    """One start: what is optimised, and how far that got."""

    angles: Any  # (pulses,) pi times the phase
    sizes: Any  # (pulses,) what gives the weights
    strength: Any  # logarithm of the bound on the pulses, over `Rocker.unit`
    skips: Any  # (pulses,)
    length: Any  # pulses of the train, the others are left out
    multipliers: Any  # (pulses,) of the constraints
    loss: Any
    slope: Any  # largest component of its gradient
    ended: Any  # whether nothing is left to correct


class Limits(NamedTuple):
    """On the times of the pulses."""

    spacing: Any  # [s]
    latest: Any  # [s]


def train_of(search: Search, goal: Goal) -> Train:
    """A train from free variables: at its best, the slope to each of them is 0.

    Weights are at most 1 each, or 1 together where the total counts.
    """
    sizes = search.sizes
    if goal == "smallest total":
        counted = jnp.where(jnp.arange(sizes.size) < search.length, sizes, 0)
        weight = counted * jnp.abs(counted) / (counted**2).sum()
    else:
        weight = jnp.sin(sizes)
    return Train(search.angles / jnp.pi, weight, search.skips)


class Question(NamedTuple):
    """What is asked of every start alike."""

    rocker: Rocker
    limits: Limits | None
    goal: Goal
    most: int

    def loss(self, free: Any, search: Search) -> tuple[Any, tuple[Outcome, Any]]:
        """Minus the logarithm of the final velocity, and what broken constraints add to it."""
        search = _with(search, free)
        limits, rate = self.limits, self.rocker.block.frequency_parameter
        outcome = shot(
            self.rocker,
            train_of(search, self.goal),
            jnp.exp(search.strength),
            timed=limits is not None,
            spacing=0.0 if limits is None else limits.spacing,
            length=search.length,
            most=self.most,
        )
        loss = -jnp.log(jnp.maximum(outcome.x, 1e-30))
        if limits is None:
            return loss, (outcome, jnp.zeros_like(search.multipliers))
        # Where positive, not kept.
        over = outcome.times[-1] - limits.latest
        broken = jnp.append(outcome.lacking[1:], over) * rate
        pressure = jnp.asarray([_HARD] * (broken.size - 1) + [PRESSURE], broken.dtype)
        pressed = jnp.maximum(search.multipliers + pressure * broken, 0)
        added = (pressed**2 - search.multipliers**2) / (2 * pressure)
        return loss + added.sum(), (outcome, broken)


def _free(search: Search) -> Any:
    return jnp.concatenate([search.angles, search.sizes, search.strength[None]])


def _with(search: Search, free: Any) -> Search:
    count = search.angles.size
    return search._replace(angles=free[:count], sizes=free[count : 2 * count], strength=free[-1])


class _Descent(NamedTuple):
    """Of BFGS: where it is, where it was evaluated last, and what was found there."""

    here: Any
    before: Any
    loss: Any
    slope: Any
    inverse: Any  # of the Hessian, as it is known
    outcome: Any
    broken: Any
    step: Any
    stuck: Any  # times in turn that no length of step led lower
    path: Any  # (STEPS,)


def _descended(search: Search, question: Question, steps: Any) -> _Descent:
    """Some steps of BFGS at a given strength, until there is no slope."""
    free = _free(search)
    eps = jnp.finfo(free.dtype).eps
    eye = jnp.eye(free.size, dtype=free.dtype)
    fixed = jnp.arange(free.size) == free.size - 1

    def loss(free: Any) -> Any:
        return question.loss(free, search)

    def goes_on(state: _Descent) -> Any:
        slope = jnp.where(fixed, 0, state.slope)
        steep = (state.step == 0) | (abs(slope).max() > 8 * eps)
        return (state.step < steps) & steep & (state.stuck < 2)

    def step(state: _Descent) -> _Descent:
        (value, found), slope = jax.value_and_grad(loss, has_aux=True)(state.here)
        moved = state.here - state.before
        turned = jnp.where(fixed, 0, slope - state.slope)
        curvature = moved @ turned
        curved = curvature > eps * jnp.linalg.norm(moved) * jnp.linalg.norm(turned)
        scale = 1 / jnp.where(curved, curvature, 1)
        side = eye - scale * jnp.outer(moved, turned)
        updated = side @ state.inverse @ side.T + scale * jnp.outer(moved, moved)
        inverse = jnp.where(curved & (state.step > 0), updated, state.inverse)
        downhill = jnp.where(fixed, 0, slope)
        towards = -inverse @ downhill
        descends = (towards @ downhill < 0) & jnp.isfinite(towards).all()
        inverse = jnp.where(descends, inverse, eye)
        towards = jnp.where(descends, towards, -downhill)
        # No further than a radian.
        towards = towards / jnp.maximum(abs(towards).max(), 1)
        lengths = jnp.asarray(_LENGTHS, free.dtype)
        tried = state.here[None] + lengths[:, None] * towards[None]
        values = jax.vmap(lambda free: loss(free)[0])(tried)
        values = jnp.where(jnp.isfinite(values), values, jnp.inf)
        k = values.argmin()
        lower = values[k] < value
        there = jnp.where(lower, tried[k], state.here)
        # The second time straight down.
        inverse = jnp.where(lower, inverse, eye)
        stuck = jnp.where(lower, 0, state.stuck + 1)
        path = jnp.where(jnp.arange(STEPS) >= state.step, value, state.path)
        outcome, broken = found
        count = state.step + 1
        return _Descent(
            there, state.here, value, slope, inverse, outcome, broken, count, stuck, path
        )

    zero = jnp.zeros_like(free[0])
    shapes = jax.eval_shape(loss, free)[1]
    outcome, broken = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    path, none = jnp.zeros(STEPS, free.dtype), jnp.zeros((), int)
    begin = _Descent(free, free, zero, 0 * free, eye, outcome, broken, none, none, path)
    return jax.lax.while_loop(goes_on, step, begin)


@eqx.filter_jit
def solve(searches: Search, question: Question, rounds: Any, steps: Any) -> tuple[Search, Any, Any]:
    """Descents, each followed by a correction of strength and multipliers.

    Also by how much constraints are broken in the end, and the loss in each step of the
    first descent.
    """
    return jax.vmap(lambda search: _solved(search, question, rounds, steps))(searches)


def _solved(search: Search, question: Question, rounds: Any, steps: Any) -> tuple[Search, Any, Any]:
    eps = jnp.finfo(search.angles.dtype).eps
    seeks, count = question.goal != "most rotation", search.angles.size
    # Of what is corrected: with constraints, as exactly as the descents end.
    free = question.limits is None
    near, steady = (8 * eps, jnp.inf) if free else (0.01 * eps**0.5, 10 * eps**0.5)

    def goes_on(carry: Any) -> Any:
        search, _, _, number, *_ = carry
        return ~search.ended & (number < rounds)

    def one(carry: Any) -> Any:
        search, _, path, number, lowest, highest = carry
        # Off the ends of the half-cycles, where the slope is 0 whatever is broken.
        pushed = (number > 0) & (search.loss > eps**0.5) & (question.limits is not None)
        folded = jnp.arccos(jnp.cos(search.angles))
        angles = jnp.where(pushed, jnp.clip(folded, 0.1, jnp.pi - 0.1), folded)
        descent = _descended(search._replace(angles=angles), question, steps)
        search = _with(search, descent.before)
        # By the envelope theorem, the loss at its best changes with the strength like that.
        gain = jnp.clip(-descent.slope[-1], 0.3, 1e4)
        short = -jnp.log(jnp.maximum(descent.outcome.x, 1e-30))
        change = jnp.clip(short / gain, -1, 1)
        # A flight that ends too early is that of too weak a train.
        early = (descent.broken[:-1] > 1e-3).any()
        lowest = jnp.where(early | (short > 0), jnp.maximum(lowest, search.strength), lowest)
        highest = jnp.where(early | (short > 0), highest, search.strength)
        outside = search.strength + change
        outside = (outside <= lowest) | (outside >= highest)
        halved = early | (outside & (lowest > -40) & (highest - lowest > 1e-6))
        halfway = 0.5 * (lowest + highest) - search.strength
        change = jnp.where(halved, halfway, change) if seeks else 0 * change
        pressure = jnp.asarray([_HARD] * (count - 1) + [PRESSURE], search.loss.dtype)
        multipliers = jnp.maximum(search.multipliers + pressure * descent.broken, 0)
        if question.limits is None:
            multipliers = search.multipliers
        multipliers = jnp.where(early & seeks, 0, multipliers)
        still = abs(multipliers - search.multipliers).max() < steady
        slope = abs(descent.slope[:-1]).max()
        search = search._replace(
            strength=search.strength + change,
            multipliers=multipliers,
            loss=descent.loss,
            slope=slope,
            ended=(abs(change) < near) & still,
        )
        path = jnp.where(number == 0, descent.path, path)
        return search, descent.broken.max(), path, number + 1, lowest, highest

    zero = jnp.zeros_like(search.loss)
    begin = (
        search._replace(ended=zero > 1),
        zero,
        jnp.zeros(STEPS, zero.dtype),
        jnp.zeros((), int),
        zero - 50,
        jnp.maximum(search.strength, 0) + 0.1,
    )
    search, broken, path, *_ = jax.lax.while_loop(goes_on, one, begin)
    return search, broken, path


@eqx.filter_jit
def outcomes(searches: Search, question: Question) -> Outcome:
    """What the trains of all starts do, with their times."""

    def outcome(search: Search) -> Outcome:
        limits = question.limits
        return shot(
            question.rocker,
            train_of(search, question.goal),
            jnp.exp(search.strength),
            timed=True,
            spacing=0.0 if limits is None else limits.spacing,
            length=search.length,
            most=question.most,
        )

    return jax.vmap(outcome)(searches)


def tolerance(searches: Search) -> float:
    """Of constraints, times the frequency parameter."""
    return 10 * float(np.finfo(searches.angles.dtype).eps) ** 0.5
