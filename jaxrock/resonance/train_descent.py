"""Gradient steps of many trains in one compiled program, without limits on their times.

The steps are those of resilient backpropagation (Riedmiller and Braun 1993,
https://doi.org/10.1109/ICNN.1993.298623), as optax has it: each number goes by a length of its
own, which grows while the sign of its derivative stays and shrinks when it changes. Most numbers
of a worst train lie at their bounds, which such steps reach exactly.

The trains descend one after the other inside of the program, each until it has settled. On a
CPU that takes no longer per step than side by side, where all wait for the slowest, and
compiles in two thirds of the time. With one step the same program evaluates a train.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..validation import Booleans, Integers, Reals
from .rocker import Rocker
from .train_through_impacts import Evaluation, evaluate_with_slopes

_MOST_STEPS = 50
_FIRST_STEP = 0.1
_LARGEST_STEP = 0.5
_LEAST_RISE = 0.1  # smallest d(log x) / d(log bound) that is used; it is about 1
_LARGEST_CORRECTION = 0.5  # of the logarithm of the bound, in one step


class Descents(NamedTuple):
    """Trains and how to change them, in arrays of shape (trains, ...).

    Attributes
    ----------
    numbers, impacts
        See `evaluate_with_slopes`.
    lows, highs
        Bounds on the numbers.
    steps
        Most steps; a train with 0 is not even evaluated.
    """

    numbers: Reals
    impacts: Integers
    lows: Reals
    highs: Reals
    steps: Integers


class Descended(NamedTuple):
    """The best trains of descents, in arrays of shape (trains, ...).

    Attributes
    ----------
    numbers
        The best train on the way.
    loss
        The number that is minimised: the logarithm of the size of the pulses once they just
        overturn the block, or of the critical velocity over the final velocity.
    path
        The same in each step; NaN after the last.
    last
        Evaluation of the train at which the last step began.
    """

    numbers: Reals
    loss: Reals
    path: Reals
    last: Evaluation


class _State(NamedTuple):
    """A descent under way; `moved` is the largest change of a number in the last step."""

    step: Integers
    moved: Reals
    numbers: Reals
    optimizer: Any
    so_far: Descended


@functools.partial(jax.jit, static_argnames="most_impacts")
def descend_all(
    descents: Descents,
    rocker: Rocker,
    seeks_pulses: Booleans,
    seeks_total: Booleans,
    most_impacts: int,
) -> Descended:
    """Improve trains by gradient steps, each until it has settled.

    Parameters
    ----------
    descents, rocker
        The trains, and the block.
    seeks_pulses, seeks_total
        Whether the smallest pulses are sought, not the highest peak; and the smallest total.
    most_impacts
        Most impacts between two pulses.
    """
    import optax  # which only this needs

    optimizer = optax.rprop(_FIRST_STEP, max_step_size=_LARGEST_STEP)
    settled = float(jnp.finfo(descents.numbers.dtype).eps) ** 0.5

    def descend(descent: Descents) -> Descended:
        """Improve one train."""
        numbers, impacts, lows, highs, steps = descent

        def evaluate(numbers: Reals) -> Evaluation:
            """Evaluate a train."""
            return evaluate_with_slopes(
                numbers, impacts, impacts.size, rocker, 0.0, most_impacts
            )

        def advance(state: _State) -> _State:
            """Go one step."""
            evaluation = evaluate(state.numbers)
            loss, slope, excess = _compute_slope(
                state.numbers, evaluation, seeks_pulses, seeks_total
            )
            updates, optimizer_state = optimizer.update(slope, state.optimizer, state.numbers)
            moved_to = jnp.asarray(optax.apply_updates(state.numbers, updates))
            numbers = jnp.clip(moved_to, lows, highs)
            # A step of Newton's method towards pulses that just overturn.
            correction = jnp.clip(excess, -_LARGEST_CORRECTION, _LARGEST_CORRECTION)
            numbers = numbers.at[-1].set(state.numbers[-1] - correction)
            # Far from what overturns, the loss is not known well.
            uncertain = loss + abs(excess)
            better = uncertain < state.so_far.loss
            just_overturning = state.numbers.at[-1].add(-excess)
            so_far = Descended(
                numbers=jnp.where(better, just_overturning, state.so_far.numbers),
                loss=jnp.where(better, uncertain, state.so_far.loss),
                path=state.so_far.path.at[state.step].set(loss),
                last=evaluation,
            )
            moved = abs(numbers - state.numbers).max()
            return _State(state.step + 1, moved, numbers, optimizer_state, so_far)

        shapes = jax.eval_shape(evaluate, numbers)
        unknown = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
        infinite = jnp.full_like(numbers[0], jnp.inf)
        path = jnp.full(_MOST_STEPS, jnp.nan, numbers.dtype)
        first = _State(
            step=jnp.zeros_like(steps),
            moved=infinite,
            numbers=numbers,
            optimizer=optimizer.init(numbers),
            so_far=Descended(numbers, infinite, path, unknown),
        )
        last = jax.lax.while_loop(
            lambda state: (state.step < steps) & (state.moved > settled), advance, first
        )
        return last.so_far

    return jax.lax.map(descend, descents)


def _compute_slope(
    numbers: Reals, evaluation: Evaluation, seeks_pulses: Booleans, seeks_total: Booleans
) -> tuple[Reals, Reals, Reals]:
    """Compute the loss, its derivatives, and how much larger the pulses are than need be.

    The last is a logarithm. Where the smallest pulses are sought, the bound follows from the
    other numbers: the derivatives are those with the bound that just overturns (reduced
    gradient).
    """
    log_x = evaluation.values[0]
    slopes = evaluation.slopes[0]
    per_bound = jnp.where(seeks_pulses, jnp.maximum(slopes[-1], _LEAST_RISE), 1)
    excess = jnp.where(seeks_pulses, log_x / per_bound, 0)
    pulses = slice((numbers.size - 1) // 2, -1)
    sizes = abs(numbers[pulses])
    total = sizes.sum()
    size = numbers[-1] + jnp.where(seeks_total, jnp.log(total), 0)
    loss = jnp.where(seeks_pulses, size - excess, -log_x)
    slope = -slopes / per_bound
    share = jnp.where(seeks_total, jnp.sign(numbers[pulses]) / total, 0)
    slope = slope.at[pulses].add(share).at[-1].set(0)
    return loss, jnp.where(jnp.isfinite(slope), slope, 0), excess
