"""Reverse mode of a batch: costates that run backwards along the steps of the simulation.

The steps of a block are known once it has been simulated. Each is transposed at the state from
which it was taken, with its impact: the derivatives are those of forward mode. The states are
kept in windows of steps. The last window is there when the simulation ends; each window before
it is simulated again, from its first state.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...validation import Booleans, Integers, Reals
from .ground_input import GroundInput
from .prepared_blocks import PreparedBlocks
from .queue import FinalStates
from .record_input import RecordInput
from .step import Lanes, take_step

# Blocks side by side, as in the simulation, and states of them in a window: 8 MB.
_LANES = 64
_ROOM = 2**16
# Windows of a motion. If it takes more, its derivatives are NaN.
_WINDOWS = 2**9


class _Sweep(NamedTuple):
    """What changes from window to window, on the way to the end and back."""

    window: Integers
    returns: Booleans
    starts: Lanes  # of the windows
    states: Lanes  # in the window
    lines: tuple  # cotangents of what these states read of the ground
    costates: Lanes
    blocks: PreparedBlocks  # cotangents, as all that follow
    rows: Reals
    samples: tuple


def pull_back(
    ground: GroundInput,
    rows: Reals,
    cotangents: PyTree,
    order: int,
    prepare: Callable[[Reals], PreparedBlocks],
    answer: Callable[[Reals, FinalStates], PyTree],
) -> tuple[PyTree, Reals]:
    """Pull cotangents of answers back to the samples of the ground and the rows of arguments.

    `prepare` makes blocks from rows, and `answer` the answers from rows and final states.
    """
    count = rows.shape[1]
    size = min(count, _LANES)
    length = _ROOM // size
    samples = (ground.horizontal, ground.vertical) if isinstance(ground, RecordInput) else ()

    def pull_group(samples: tuple, group: tuple[Reals, PyTree]) -> tuple[tuple, Reals]:
        rows, cotangents = group
        prepared, pull_prepared = eqx.filter_vjp(prepare, rows)
        case = prepared.case
        resting = ground.find_next_interval(jnp.zeros(size, jnp.int32), case.excitation)

        def begin(prepared: PreparedBlocks) -> Lanes:
            return Lanes.begin(prepared.initial, prepared.case, resting)

        def take(prepared: PreparedBlocks, lanes: Lanes, line: tuple) -> Lanes:
            return take_step(lanes, prepared.case, ground, order, line)

        def finish(rows: Reals, lanes: Lanes) -> PyTree:
            return answer(rows, FinalStates.of(lanes, case))

        def are_active(lanes: Lanes) -> Booleans:
            return lanes.are_active(case) & prepared.valid

        def goes_on(state: tuple[Integers, Lanes, Lanes]) -> Booleans:
            return (state[0] < length) & are_active(state[1]).any()

        def run_step(state: tuple[Integers, Lanes, Lanes]) -> tuple[Integers, Lanes, Lanes]:
            step, lanes, states = state
            next_lanes = take_step(lanes, case, ground, order)
            return step + 1, next_lanes, _write(states, step, lanes)

        def pull_step(state: tuple[Integers, _Sweep]) -> tuple[Integers, _Sweep]:
            step, sweep = state[0] - 1, state[1]
            lanes = _read(sweep.states, step)
            line = ground.read(case.excitation.first_interval + lanes.interval)
            pulled = eqx.filter_vjp(take, prepared, lanes, line)[1](sweep.costates)
            active = are_active(lanes)
            pulled = jax.tree.map(lambda x: jnp.where(active, x, 0), pulled)
            kept = jax.tree.map(lambda x: jnp.where(active, 0, x), sweep.costates)
            return step, sweep._replace(
                blocks=_add(sweep.blocks, pulled[0]),
                costates=_add(kept, pulled[1]),
                lines=_write(sweep.lines, step, pulled[2]),
            )

        def pull_window(sweep: _Sweep) -> _Sweep:
            start = 0, _read(sweep.starts, sweep.window), sweep.states
            steps, lanes, states = jax.lax.while_loop(goes_on, run_step, start)
            active = are_active(lanes)
            ends = ~active.any() | (sweep.window == _WINDOWS - 1)
            # What has not ended by then has no derivatives.
            pulled = eqx.filter_vjp(finish, rows, lanes)[1](cotangents)
            pulled = jax.tree.map(lambda x: jnp.where(active, jnp.nan, x), pulled)
            at_end = jax.tree.map(lambda x: jnp.where(ends, x, 0), pulled)
            sweep = sweep._replace(
                returns=sweep.returns | ends,
                starts=_write(sweep.starts, sweep.window + 1, lanes),
                states=states,
                rows=sweep.rows + at_end[0],
                costates=_add(sweep.costates, at_end[1]),
            )
            begin = jnp.where(sweep.returns, steps, 0), sweep
            sweep = jax.lax.while_loop(lambda state: state[0] > 0, pull_step, begin)[1]
            # Outside of the loop, which a scatter would keep from being one function.
            places = case.excitation.first_interval + states.interval
            samples = jax.tree.map(
                lambda x, y: x.at[places].add(y), sweep.samples, sweep.lines
            )
            window = sweep.window + jnp.where(sweep.returns, -1, 1)
            return sweep._replace(window=window, samples=samples)

        lanes, pull_begin = eqx.filter_vjp(begin, prepared)
        reals = eqx.filter((lanes, prepared), eqx.is_inexact_array)
        costates, blocks = jax.tree.map(jnp.zeros_like, reals)
        line = ground.read(resting)
        sweep = _Sweep(
            window=jnp.zeros((), jnp.int32),
            returns=jnp.zeros((), bool),
            starts=_write(_make_room(lanes, _WINDOWS + 1), 0, lanes),
            states=_make_room(lanes, length),
            lines=_make_room(line, length),
            costates=costates,
            blocks=blocks,
            rows=jnp.zeros_like(rows),
            samples=samples,
        )
        sweep = jax.lax.while_loop(lambda sweep: sweep.window >= 0, pull_window, sweep)
        blocks = _add(sweep.blocks, pull_begin(sweep.costates)[0])
        pulled = sweep.rows + pull_prepared(blocks)[0]
        # What is not valid has no derivatives either, as in forward mode.
        return sweep.samples, jnp.where(prepared.valid, pulled, 0)

    def split(x: Reals) -> Reals:
        # Blocks of zeros fill the last group: they are not valid, and not simulated.
        padded = jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, -count % size)])
        return jnp.moveaxis(padded.reshape(*x.shape[:-1], -1, size), -2, 0)

    nothing = jax.tree.map(jnp.zeros_like, samples)
    groups = jax.tree.map(split, (rows, cotangents))
    samples, pulled = jax.lax.scan(pull_group, nothing, groups)
    pulled_ground = eqx.filter(ground, False)
    if samples:
        pulled_ground = replace(pulled_ground, horizontal=samples[0], vertical=samples[1])
    return pulled_ground, jnp.moveaxis(pulled, 0, 1).reshape(len(rows), -1)[:, :count]


def _add(a: PyTree, b: PyTree) -> PyTree:
    return jax.tree.map(jnp.add, a, b)


def _make_room(row: PyTree, length: int) -> PyTree:
    return jax.tree.map(lambda x: jnp.zeros((length, *x.shape), x.dtype), row)


def _write(rows: PyTree, index: Integers, row: PyTree) -> PyTree:
    write = jax.lax.dynamic_update_index_in_dim
    return jax.tree.map(lambda xs, x: write(xs, x, index, 0), rows, row)


def _read(rows: PyTree, index: Integers) -> PyTree:
    return jax.tree.map(lambda xs: xs[index], rows)
