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
from .ground_motions import GroundInput
from .prepared_blocks import Case, InitialState
from .single_kernels import call_loop, materialize
from .step import Lanes


class _Progress(NamedTuple):
    lanes: Lanes
    block: Integers  # of each lane, its place in the queue; beyond its end for none
    case: Case  # of the lanes
    taken: Integers  # from the queue
    results: Reals  # (queue + 1, numbers): the last row is for lanes without a block


def work_off(
    ground: GroundInput,
    queue: Case,
    initial: InitialState | None,
    count: Integers | int,
    lanes: int,
    step: Callable[[Lanes, Case], Lanes],
    watched: bool,
) -> Lanes:
    """Take the first `count` blocks of a queue from time 0 to their ends, by `step`.

    With coincidences if `watched`. Returns their last states, in reals only.
    """
    dtype = queue.duration.dtype
    size = queue.duration.size
    # One gather of rows, as for the results. It costs 7 % of a batch of pulses: blocks that
    # begin at rest have a program without it.
    initial_rows = None if initial is None else jnp.stack(initial, axis=-1)

    def refill(progress: _Progress) -> _Progress:
        """Store the results of lanes that have finished, and give them new blocks."""
        lanes, block, case, taken, results = progress
        idle = ~lanes.are_active(case)
        # One scatter of rows: an array for each number would need ten.
        leaves = jax.tree.leaves(lanes.without_next_step())
        rows = jnp.stack([leaf.astype(dtype) for leaf in leaves], axis=-1)
        results = results.at[jnp.where(idle, block, size)].set(rows)

        # Idle lanes are numbered, and take blocks from the queue in that order.
        number = _sum_up(idle.astype(jnp.int32))
        place = taken + number - 1
        gets = idle & (place < count)
        place = jnp.clip(place, 0, size - 1)
        block = jnp.where(idle, jnp.where(gets, place, size), block)

        def replace(new: Array, old: Array) -> Array:
            return jnp.where(gets, new, old)

        next_case, next_initial = jax.tree.map(
            lambda leaf: leaf.at[place].get(mode="promise_in_bounds"), (queue, initial_rows)
        )
        case = jax.tree.map(replace, next_case, case)
        resting = ground.find_next_interval(jnp.zeros_like(lanes.interval), case.excitation)
        state = None
        if next_initial is not None:
            # Here and once: XLA would gather them for each number that a lane begins with.
            state = materialize(InitialState(*next_initial.T))
        next_lanes = Lanes.begin(state, case, resting, watched)
        lanes = jax.tree.map(replace, next_lanes, lanes)
        return _Progress(lanes, block, case, jnp.minimum(taken + number[-1], count), results)

    def take_steps(lanes: Lanes, case: Case) -> Lanes:
        # A refill moves all numbers of all lanes, and costs as much as a step.
        return jax.lax.while_loop(
            lambda state: state[0] < ground.steps_between_refills,
            lambda state: (state[0] + 1, step(state[1], case)),
            (0, lanes),
        )[1]

    def go_on(progress: _Progress) -> _Progress:
        progress = refill(progress)
        lanes = call_loop(take_steps, progress.lanes, progress.case)
        return progress._replace(lanes=lanes)

    # Lanes begin as if they had finished some block, whose result nobody reads.
    any_case = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[0], (lanes,)), queue)
    idle = Lanes.at_rest(any_case.excitation.intervals, dtype, watched)
    final = idle.without_next_step()
    begin = _Progress(
        lanes=idle,
        block=jnp.full(lanes, size, jnp.int32),
        case=any_case,
        taken=jnp.zeros((), jnp.int32),
        results=jnp.zeros((size + 1, len(jax.tree.leaves(final))), dtype),
    )
    # The last turn only stores results: what refills before the loop as well is compiled twice.
    *_, results = jax.lax.while_loop(
        lambda progress: (progress.taken < count) | (progress.block < size).any(), go_on, begin
    )
    return jax.tree.unflatten(jax.tree.structure(final), list(results[:-1].T))


def _sum_up(x: Integers) -> Integers:
    """Sum all elements up to each, by doubling: XLA's own adds n^2 pairs on processors."""
    shift = 1
    while shift < x.size:
        x = x + jnp.pad(x[:-shift], (shift, 0))
        shift *= 2
    return x
