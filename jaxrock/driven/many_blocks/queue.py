"""A queue of blocks, worked off by a fixed number of lanes.

A lane that has finished takes the next block, so that none waits for a block with many
impacts.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ...validation import Integers, Reals
from .ground_inputs import PulseInput, RecordInput
from .step import Case, Lanes, max_steps

_STEPS = {PulseInput: 4, RecordInput: 64}  # between two refills of the lanes


class FinalStates(NamedTuple):
    """The states and counts of blocks that have finished."""

    peak: Reals
    rotation: Reals  # signed, like the velocity
    velocity: Reals
    end_rotation: Reals  # at the end of the input
    end_velocity: Reals
    impacts: Reals
    followed: Reals  # 1 if to the end, otherwise 0

    @classmethod
    def of(cls, lanes: Lanes, case: Case) -> "FinalStates":
        """Those of all lanes, finished or not."""
        return cls(
            lanes.peak,
            lanes.side * lanes.rotation,
            lanes.side * lanes.velocity,
            lanes.end_rotation,
            lanes.end_velocity,
            lanes.impacts.astype(lanes.peak.dtype),
            (lanes.steps < max_steps(case)).astype(lanes.peak.dtype),
        )


class _Progress(NamedTuple):
    lanes: Lanes
    block: Integers  # of each lane, its place in the queue; beyond its end for none
    case: Case  # of the lanes
    taken: Integers  # from the queue
    results: Reals  # (queue + 1, results): those of no block go to the last row


def work_off(
    ground: PulseInput | RecordInput,
    queue: Case,
    count: Integers | int,
    lanes: int,
    step: Callable[[Lanes, Case], Lanes],
) -> FinalStates:
    """Take the first `count` blocks of a queue to their ends, by `step`."""
    dtype = queue.duration.dtype
    size = queue.duration.size

    def refilled(progress: _Progress) -> _Progress:
        """Store the results of lanes that have finished, and give them new blocks."""
        lanes, block, case, taken, results = progress
        idle = ~lanes.active(case)
        rows = jnp.stack(FinalStates.of(lanes, case), axis=-1)
        results = results.at[jnp.where(idle, block, size)].set(rows)
        number = _running_sum(idle.astype(jnp.int32))
        place = taken + number - 1
        gets = idle & (place < count)
        place = jnp.clip(place, 0, size - 1)
        block = jnp.where(idle, jnp.where(gets, place, size), block)

        def replaced(new: Array, old: Array) -> Array:
            return jnp.where(gets, new, old)

        next_case = jax.tree.map(
            lambda leaf: leaf.at[place].get(mode="promise_in_bounds"), queue
        )
        case = jax.tree.map(replaced, next_case, case)
        fresh = ground.next_interval(jnp.zeros_like(lanes.interval), case)
        lanes = jax.tree.map(replaced, Lanes.at_rest(fresh, dtype), lanes)
        return _Progress(lanes, block, case, jnp.minimum(taken + number[-1], count), results)

    def steps(progress: _Progress) -> _Progress:
        _, lanes = jax.lax.while_loop(
            lambda state: state[0] < _STEPS[type(ground)],
            lambda state: (state[0] + 1, step(state[1], progress.case)),
            (0, progress.lanes),
        )
        return refilled(progress._replace(lanes=lanes))

    any_case = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[0], (lanes,)), queue)
    begin = _Progress(
        Lanes.at_rest(any_case.intervals, dtype),
        jnp.full(lanes, size, jnp.int32),
        any_case,
        jnp.zeros((), jnp.int32),
        jnp.zeros((size + 1, len(FinalStates._fields)), dtype),
    )
    *_, results = jax.lax.while_loop(lambda p: (p.block < size).any(), steps, refilled(begin))
    return FinalStates(*results[:-1].T)


def _running_sum(x: Integers) -> Integers:
    """Sum all up to each, by doubling: XLA's own takes all pairs."""
    shift = 1
    while shift < x.size:
        x = x + jnp.pad(x[:-shift], (shift, 0))
        shift *= 2
    return x
