"""Reverse mode of a batch: costates that run backwards along the steps of the simulation.

The steps of a block are known once it has been simulated. Each is transposed at the state from
which it was taken, with its impact: the derivatives are those of forward mode. The simulation
keeps the first state of each window of steps; on the way back each window is simulated again,
with all its states.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...validation import Booleans, Integers, Reals
from .ground_motions import GroundInput
from .prepared_blocks import PreparedBlocks
from .record_input import RecordInput
from .step import Lanes, take_step

# Blocks side by side, as in the simulation; steps in a window; and windows of a motion. One that
# takes more has derivatives that are NaN.
_LANES = 64
_STEPS = 128
_WINDOWS = 2**12
_NO_PLACE = np.int32(2**31 - 1)  # beyond all samples

# Windows that are left, and the cotangents of lanes, blocks and samples.
_Back = tuple[Integers, Lanes, PreparedBlocks, tuple]


def pull_back(
    ground: GroundInput,
    rows: Reals,
    cotangents: PyTree,
    order: int,
    prepare: Callable[[Reals], PreparedBlocks],
    answer: Callable[[Reals, Lanes], PyTree],
) -> tuple[PyTree, Reals]:
    """Pull cotangents of answers back to the samples of the ground and the rows of arguments.

    `prepare` makes blocks from rows, and `answer` the answers from rows and final states.
    """
    count = rows.shape[1]
    size = min(count, _LANES)
    samples = (ground.horizontal, ground.vertical) if isinstance(ground, RecordInput) else ()
    run = functools.partial(_simulate_window, ground, order)

    def pull_group(samples: tuple, group: tuple[Reals, PyTree]) -> tuple[tuple, Reals]:
        rows, cotangents = group
        prepared, pull_prepared = eqx.filter_vjp(prepare, rows)
        case = prepared.case
        resting = ground.find_next_interval(jnp.zeros(size, jnp.int32), case.excitation)

        def begin(prepared: PreparedBlocks) -> Lanes:
            return Lanes.begin(prepared.initial, prepared.case, resting)

        def are_active(lanes: Lanes) -> Booleans:
            return lanes.are_active(case) & prepared.valid

        def go_on(state: tuple[Integers, Lanes, Lanes]) -> tuple[Integers, Lanes, Lanes]:
            window, lanes, starts = state
            write = jax.lax.dynamic_update_index_in_dim
            starts = jax.tree.map(lambda xs, x: write(xs, x, window, 0), starts, lanes)
            return window + 1, run(prepared, lanes, nothing)[0], starts

        def go_back(state: _Back) -> _Back:
            window, costates, blocks, samples = state
            lanes = jax.tree.map(lambda xs: xs[window - 1], starts)
            (_, places), pull = eqx.filter_vjp(run, prepared, lanes, nothing)
            pulled = pull((costates, None))
            samples = jax.tree.map(lambda x, y: x.at[places].add(y), samples, pulled[2])
            return window - 1, pulled[1], _add(blocks, pulled[0]), samples

        nothing = jax.tree.map(
            lambda x: jnp.zeros((_STEPS, *x.shape), x.dtype), ground.read(resting)
        )
        lanes, pull_begin = eqx.filter_vjp(begin, prepared)
        room = jax.tree.map(lambda x: jnp.zeros((_WINDOWS, *x.shape), x.dtype), lanes)
        windows, lanes, starts = jax.lax.while_loop(
            lambda state: (state[0] < _WINDOWS) & are_active(state[1]).any(),
            go_on,
            (jnp.zeros((), jnp.int32), lanes, room),
        )
        pulled_rows, costates = eqx.filter_vjp(answer, rows, lanes)[1](cotangents)
        costates = jax.tree.map(lambda x: jnp.where(are_active(lanes), jnp.nan, x), costates)
        blocks = jax.tree.map(jnp.zeros_like, eqx.filter(prepared, eqx.is_inexact_array))
        _, costates, blocks, samples = jax.lax.while_loop(
            lambda state: state[0] > 0, go_back, (windows, costates, blocks, samples)
        )
        pulled = pulled_rows + pull_prepared(_add(blocks, pull_begin(costates)[0]))[0]
        # What is not valid has no derivatives, as in forward mode.
        return samples, jnp.where(prepared.valid, pulled, 0)

    def split(x: Reals) -> Reals:
        # Blocks of zeros fill the last group: they are not valid, and not simulated.
        padded = jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, -count % size)])
        return jnp.moveaxis(padded.reshape(*x.shape[:-1], -1, size), -2, 0)

    groups = jax.tree.map(split, (rows, cotangents))
    samples, pulled = jax.lax.scan(pull_group, jax.tree.map(jnp.zeros_like, samples), groups)
    pulled_ground = eqx.filter(ground, False)
    if samples:
        pulled_ground = eqx.tree_at(
            lambda ground: (ground.horizontal, ground.vertical), pulled_ground, samples
        )
    return pulled_ground, jnp.moveaxis(pulled, 0, 1).reshape(len(rows), -1)[:, :count]


def _simulate_window(
    ground: GroundInput, order: int, prepared: PreparedBlocks, lanes: Lanes, lines: tuple
) -> tuple[Lanes, Integers]:
    """Simulate a window of steps, and return the places of their intervals as well.

    The `lines`, all 0, are added to what each step reads of the ground: for derivatives.
    """
    case = prepared.case

    @jax.checkpoint
    def step(lanes: Lanes, added: tuple) -> tuple[Lanes, Integers]:
        active = lanes.are_active(case) & prepared.valid
        place = case.excitation.first_interval + lanes.interval
        line = _add(ground.read(place), added)
        after = take_step(lanes, case, ground, order, line)
        after = jax.tree.map(lambda x, y: jnp.where(active, x, y), after, lanes)
        return after, jnp.where(active, place, _NO_PLACE)

    return jax.lax.scan(step, lanes, lines, length=_STEPS)


def _add(a: PyTree, b: PyTree) -> PyTree:
    return jax.tree.map(jnp.add, a, b)
