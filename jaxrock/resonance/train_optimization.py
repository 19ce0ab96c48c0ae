"""Descent to the worst train of one sequence of impacts and pulses, from many starts at once.

With a given bound on the pulses, the final velocity is maximised by BFGS. Constraints on the
times enter by an augmented Lagrangian. Between the descents the multipliers are corrected and,
where the smallest pulses are sought, the bound, until the train just overturns the block.
"""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .pulse_train import Rocker
from .train_through_impacts import Outcome, Train, shot

Goal = Literal["smallest largest", "smallest total", "most rotation"]

ROUNDS = 30  # descents at most, each followed by a correction of bound and multipliers
LATE_PENALTY = 30.0  # of a train that takes too long
_LACKING_PENALTY = 300.0  # of a half-cycle that ends before the pulse may come
_STEPS = 40  # of BFGS in a descent
_STEP_LENGTHS = 3.0 * 0.35 ** np.arange(9)  # over Newton's


class Search(NamedTuple):
    """One start: what is optimised, and how far that got."""

    angles: Any  # (pulses,) pi times the phase
    sizes: Any  # (pulses,) what gives the weights
    log_bound: Any  # logarithm of the bound on the pulses, over `Rocker.unit`
    impacts: Any  # (pulses,) between a pulse and the one before
    count: Any  # pulses of the train, the others are left out
    multipliers: Any  # (pulses,) of the constraints
    loss: Any
    violation: Any  # of the constraints, the largest, times the frequency parameter
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

    def outcome(self, search: Search, *, timed: bool) -> Outcome:
        """What the train of a search does."""
        return shot(
            self.rocker,
            _train(search, self.goal),
            jnp.exp(search.log_bound),
            timed=timed,
            spacing=self.spacing,
            count=search.count,
            max_impacts=self.max_impacts,
        )

    def lagrangian(self, free: Any, log_bound: Any, search: Search) -> tuple[Any, tuple[Any, Any]]:
        """Augmented Lagrangian; the final velocity, and what is violated where positive."""
        search = _with(search, free)._replace(log_bound=log_bound)
        outcome = self.outcome(search, timed=self.constrained)
        loss = -jnp.log(jnp.maximum(outcome.x, 1e-30))
        if not self.constrained:
            return loss, (outcome.x, jnp.zeros_like(search.multipliers))
        violations = jnp.append(outcome.lacking[1:], outcome.times[-1] - self.latest)
        violations = violations * self.rocker.block.frequency_parameter
        penalties = _penalties(violations)
        pressed = jnp.maximum(search.multipliers + penalties * violations, 0)
        added = (pressed**2 - search.multipliers**2) / (2 * penalties)
        return loss + added.sum(), (outcome.x, violations)


def _train(search: Search, goal: Goal) -> Train:
    """The train of free variables, with weights of at most 1 each, or 1 together.

    Through sines and squares, so that at a bound the derivative is 0.
    """
    weight = jnp.sin(search.sizes)
    if goal == "smallest total":
        counted = jnp.where(jnp.arange(weight.size) < search.count, search.sizes, 0)
        weight = counted * jnp.abs(counted) / (counted**2).sum()
    return Train(search.angles / jnp.pi, weight, search.impacts)


def _penalties(violations: Any) -> Any:
    lacking = [_LACKING_PENALTY] * (violations.size - 1)
    return jnp.asarray([*lacking, LATE_PENALTY], violations.dtype)


def _with(search: Search, free: Any) -> Search:
    angles, sizes = jnp.split(free, 2)
    return search._replace(angles=angles, sizes=sizes)


class _Descent(NamedTuple):
    """BFGS: the next point, and the last with what was found there."""

    point: Any
    last: Any
    loss: Any
    gradient: Any
    bound_slope: Any  # derivative with respect to the logarithm of the bound
    x: Any  # final velocity
    violations: Any
    inverse: Any  # of the Hessian, estimated
    steps: Any
    stuck: Any  # times in turn that no length of step led lower
    path: Any  # (_STEPS,) losses


def _descended(search: Search, problem: Problem) -> _Descent:
    """Steps of BFGS at a given bound, until the gradient is rounding."""
    free = jnp.concatenate([search.angles, search.sizes])
    eps = jnp.finfo(free.dtype).eps

    def loss(free: Any, log_bound: Any) -> Any:
        return problem.lagrangian(free, log_bound, search)

    def goes_on(state: _Descent) -> Any:
        steep = (state.steps == 0) | (abs(state.gradient).max() > 8 * eps)
        return (state.steps < _STEPS) & steep & (state.stuck < 2)

    def step(state: _Descent) -> _Descent:
        evaluate = jax.value_and_grad(loss, argnums=(0, 1), has_aux=True)
        (value, (x, violations)), (gradient, bound_slope) = evaluate(state.point, search.log_bound)
        inverse, direction = _direction(state, gradient)
        lengths = jnp.asarray(_STEP_LENGTHS, free.dtype)
        points = state.point[None] + lengths[:, None] * direction[None]
        values = jax.vmap(lambda free: loss(free, search.log_bound)[0])(points)
        values = jnp.where(jnp.isfinite(values), values, jnp.inf)
        k = values.argmin()
        lower = values[k] < value
        return _Descent(
            point=jnp.where(lower, points[k], state.point),
            last=state.point,
            loss=value,
            gradient=gradient,
            bound_slope=bound_slope,
            x=x,
            violations=violations,
            # If stuck, the second time along the gradient.
            inverse=jnp.where(lower, inverse, jnp.eye(free.size, dtype=free.dtype)),
            steps=state.steps + 1,
            stuck=jnp.where(lower, 0, state.stuck + 1),
            path=jnp.where(jnp.arange(_STEPS) >= state.steps, value, state.path),
        )

    zero, none = jnp.zeros_like(free[0]), jnp.zeros((), int)
    eye, path = jnp.eye(free.size, dtype=free.dtype), jnp.zeros(_STEPS, free.dtype)
    violations = jnp.zeros_like(search.multipliers)
    begin = _Descent(free, free, zero, 0 * free, zero, zero, violations, eye, none, none, path)
    return jax.lax.while_loop(goes_on, step, begin)


def _direction(state: _Descent, gradient: Any) -> tuple[Any, Any]:
    """The updated inverse Hessian, and the step that follows; along the gradient if uphill."""
    eps = jnp.finfo(gradient.dtype).eps
    eye = jnp.eye(gradient.size, dtype=gradient.dtype)
    moved, turned = state.point - state.last, gradient - state.gradient
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


@eqx.filter_jit
def solve(searches: Search, problem: Problem, rounds: Any) -> tuple[Search, Any]:
    """All searches after so many rounds, and the losses in the steps of the first descent."""
    return jax.vmap(lambda search: _solved(search, problem, rounds))(searches)


def _solved(search: Search, problem: Problem, rounds: Any) -> tuple[Search, Any]:
    eps = jnp.finfo(search.angles.dtype).eps

    def goes_on(carry: Any) -> Any:
        search, _, number, *_ = carry
        return ~search.ended & (number < rounds)

    def descend_and_correct(carry: Any) -> Any:
        search, path, number, low, high = carry
        angles = jnp.arccos(jnp.cos(search.angles))
        if problem.constrained:
            # Off the ends of the half-cycles: the gradient is 0 there, even if constraints are
            # violated.
            pushed = (number > 0) & (search.loss > eps**0.5)
            angles = jnp.where(pushed, jnp.clip(angles, 0.1, jnp.pi - 0.1), angles)
        descent = _descended(search._replace(angles=angles), problem)
        search, low, high = _corrected(_with(search, descent.last), descent, problem, low, high)
        path = jnp.where(number == 0, descent.path, path)
        return search, path, number + 1, low, high

    zero = jnp.zeros_like(search.loss)
    search = search._replace(ended=zero > 1)
    high = jnp.maximum(search.log_bound, 0) + 0.1  # a single pulse overturns with 0
    begin = (search, jnp.zeros(_STEPS, zero.dtype), jnp.zeros((), int), zero - 50, high)
    search, path, *_ = jax.lax.while_loop(goes_on, descend_and_correct, begin)
    return search, path


def _corrected(
    search: Search, descent: _Descent, problem: Problem, low: Any, high: Any
) -> tuple[Search, Any, Any]:
    """Bound and multipliers after a descent, and what is known to enclose the bound."""
    # A half-cycle that ends too early is that of too weak a train.
    early = (descent.violations[:-1] > 1e-3).any()
    root_eps = jnp.finfo(search.angles.dtype).eps ** 0.5
    change, multipliers = jnp.zeros_like(search.loss), search.multipliers
    if problem.seeks_bound:
        # Newton's step to loss 0: by the envelope theorem the partial derivative with respect
        # to the bound is the derivative of the lowest loss.
        shortfall = -jnp.log(jnp.maximum(descent.x, 1e-30))
        change = jnp.clip(shortfall / jnp.clip(-descent.bound_slope, 0.3, 1e4), -1, 1)
        weak = early | (shortfall > 0)
        low = jnp.where(weak, jnp.maximum(low, search.log_bound), low)
        high = jnp.where(weak, high, search.log_bound)
        new = search.log_bound + change
        outside = ((new <= low) | (new >= high)) & (low > -40) & (high - low > 1e-6)
        change = jnp.where(early | outside, 0.5 * (low + high) - search.log_bound, change)
    if problem.constrained:
        added = _penalties(descent.violations) * descent.violations
        multipliers = jnp.maximum(search.multipliers + added, 0)
        if problem.seeks_bound:
            multipliers = jnp.where(early, 0, multipliers)
    # With constraints only as exactly as the descents end.
    near = 0.01 * root_eps if problem.constrained else 8 * root_eps**2
    steady = abs(multipliers - search.multipliers).max() < 10 * root_eps
    search = search._replace(
        log_bound=search.log_bound + change,
        multipliers=multipliers,
        loss=descent.loss,
        violation=descent.violations.max(),
        ended=(abs(change) < near) & steady,
    )
    return search, low, high


@eqx.filter_jit
def outcomes(searches: Search, problem: Problem) -> Outcome:
    """What the trains of all searches do, with their times."""
    return jax.vmap(lambda search: problem.outcome(search, timed=True))(searches)


def tolerance(searches: Search) -> float:
    """Of constraints, times the frequency parameter."""
    return 10 * float(np.finfo(searches.angles.dtype).eps) ** 0.5
