"""Derivatives in reverse mode: costates that run backwards along the steps of a simulation.

The steps of a block are known once it has been simulated. Each is transposed at the state from
which it was taken, with its impact, so that the derivatives are those of forward mode. The states
are kept in windows of steps: the last window is there when the simulation ends, each other one
is simulated again from its first state.
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

# Blocks side by side, as in the simulation, and states of each in a window: 8 MB in all.
_LANES = 64
_ROOM = 2**16
# Windows of a motion. One that takes more has derivatives that are NaN.
_WINDOWS = 2**9

_Samples = tuple[tuple[Reals, ...], ...]  # horizontal and vertical, or cotangents of them


class _Sweep(NamedTuple):
    """What changes from window to window, on the way to the end and back."""

    window: Integers
    returns: Booleans
    starts: Lanes  # of the windows
    states: Lanes  # in the window
    costates: Lanes
    blocks: PreparedBlocks  # cotangents, like the samples
    lines: _Samples  # of the states in the window
    samples: _Samples


def pull_back(
    ground: GroundInput,
    rows: Reals,
    cotangents: PyTree,
    order: int,
    prepare: Callable[[Reals], PreparedBlocks],
    summarize: Callable[[PreparedBlocks, FinalStates], PyTree],
) -> tuple[PyTree, Reals]:
    """Pull cotangents of answers back to the samples of the ground and to rows of arguments.

    `prepare` makes the blocks from the rows, `summarize` the answers from final states.
    """
    count = rows.shape[1]
    lanes = min(count, _LANES)
    leaves, form = jax.tree.flatten(cotangents)
    table = jnp.stack([*rows, *leaves])
    # Blocks of zeros fill the last group. They are not valid, and not simulated.
    padded = jnp.pad(table, ((0, 0), (0, -count % lanes)))
    groups = padded.reshape(len(table), -1, lanes).swapaxes(0, 1)

    def pull_group(samples: _Samples, group: Reals) -> tuple[_Samples, Reals]:
        prepared, pull_prepared = eqx.filter_vjp(prepare, group[: len(rows)])
        ends = form.unflatten(group[len(rows) :])

        def finish(prepared: PreparedBlocks, lanes: Lanes) -> PyTree:
            return summarize(prepared, FinalStates.of(lanes, prepared.case))

        def pull_end(lanes: Lanes) -> tuple[PreparedBlocks, Lanes]:
            return eqx.filter_vjp(finish, prepared, lanes)[1](ends)

        samples, pulled = _sweep(ground, prepared, order, pull_end, samples)
        # What is not valid has no derivatives, as in forward mode.
        return samples, jnp.where(prepared.valid, pull_prepared(pulled)[0], 0)

    nothing = jax.tree.map(jnp.zeros_like, _get_samples(ground))
    samples, pulled = jax.lax.scan(pull_group, nothing, groups)
    pulled_ground = eqx.filter(ground, False)
    if samples:
        pulled_ground = replace(pulled_ground, horizontal=samples[0], vertical=samples[1])
    return pulled_ground, pulled.swapaxes(0, 1).reshape(len(rows), -1)[:, :count]


def _sweep(
    ground: GroundInput,
    prepared: PreparedBlocks,
    order: int,
    pull_end: Callable[[Lanes], tuple[PreparedBlocks, Lanes]],
    samples: _Samples,
) -> tuple[_Samples, PreparedBlocks]:
    """Simulate blocks side by side to their ends, and go back along their steps.

    Returns the cotangents of the samples, added to those given, and of the blocks.
    """
    case = prepared.case
    length = max(_ROOM // case.duration.size, 1)
    begin = jnp.zeros(case.duration.shape, jnp.int32)
    resting = ground.find_next_interval(begin, case.excitation)

    def are_active(lanes: Lanes) -> Booleans:
        return lanes.are_active(case) & prepared.valid

    def take(prepared: PreparedBlocks, lanes: Lanes, ground: GroundInput) -> Lanes:
        return take_step(lanes, prepared.case, ground, order)

    def run_step(state: tuple[Integers, Lanes, Lanes]) -> tuple[Integers, Lanes, Lanes]:
        step, lanes, states = state
        return step + 1, take(prepared, lanes, ground), _write(states, step, lanes)

    def pull_step(state: tuple[Integers, _Sweep]) -> tuple[Integers, _Sweep]:
        step, sweep = state[0] - 1, state[1]
        lanes = _read(sweep.states, step)
        line = ground.read(case.excitation.first_interval + lanes.interval)
        _, pull = eqx.filter_vjp(take, prepared, lanes, line)
        active = are_active(lanes)
        pulled = jax.tree.map(lambda x: jnp.where(active, x, 0), pull(sweep.costates))
        kept = jax.tree.map(lambda x: jnp.where(active, 0, x), sweep.costates)
        return step, sweep._replace(
            costates=jax.tree.map(jnp.add, kept, pulled[1]),
            blocks=jax.tree.map(jnp.add, sweep.blocks, pulled[0]),
            lines=_write(sweep.lines, step, _get_samples(pulled[2])),
        )

    def pull_window(sweep: _Sweep) -> _Sweep:
        count, lanes, states = jax.lax.while_loop(
            lambda state: (state[0] < length) & are_active(state[1]).any(),
            run_step,
            (0, _read(sweep.starts, sweep.window), sweep.states),
        )
        goes_on = are_active(lanes)
        ends = ~goes_on.any() | (sweep.window == _WINDOWS - 1)
        returns = sweep.returns | ends
        blocks, costates = pull_end(lanes)
        sweep = sweep._replace(
            returns=returns,
            starts=_write(sweep.starts, sweep.window + 1, lanes),
            states=states,
            costates=jax.tree.map(
                lambda x, old: jnp.where(ends, jnp.where(goes_on, jnp.nan, x), old),
                costates,
                sweep.costates,
            ),
            blocks=jax.tree.map(lambda x, y: x + jnp.where(ends, y, 0), sweep.blocks, blocks),
        )
        _, sweep = jax.lax.while_loop(
            lambda state: state[0] > 0, pull_step, (jnp.where(returns, count, 0), sweep)
        )
        # Not in the loop, which would not be one function of the processor.
        places = case.excitation.first_interval + sweep.states.interval
        return sweep._replace(
            window=sweep.window + jnp.where(returns, -1, 1),
            samples=jax.tree.map(lambda x, y: x.at[places].add(y), sweep.samples, sweep.lines),
        )

    def begin_lanes(prepared: PreparedBlocks) -> Lanes:
        return Lanes.begin(prepared.initial, prepared.case, resting)

    lanes, pull_begin = eqx.filter_vjp(begin_lanes, prepared)
    costates, blocks = jax.tree.map(
        jnp.zeros_like, eqx.filter((lanes, prepared), eqx.is_inexact_array)
    )
    sweep = _Sweep(
        window=jnp.zeros((), jnp.int32),
        returns=jnp.zeros((), bool),
        starts=_write(_make_room(lanes, _WINDOWS + 1), 0, lanes),
        states=_make_room(lanes, length),
        costates=costates,
        blocks=blocks,
        lines=jax.tree.map(lambda x: jnp.zeros((length, *begin.shape), x.dtype), samples),
        samples=samples,
    )
    sweep = jax.lax.while_loop(lambda sweep: sweep.window >= 0, pull_window, sweep)
    return sweep.samples, jax.tree.map(jnp.add, sweep.blocks, pull_begin(sweep.costates)[0])


def _make_room(row: PyTree, length: int) -> PyTree:
    return jax.tree.map(lambda x: jnp.zeros((length, *x.shape), x.dtype), row)


def _write(rows: PyTree, index: Integers, row: PyTree) -> PyTree:
    write = jax.lax.dynamic_update_index_in_dim
    return jax.tree.map(lambda xs, x: write(xs, x, index, 0), rows, row)


def _read(rows: PyTree, index: Integers) -> PyTree:
    read = jax.lax.dynamic_index_in_dim
    return jax.tree.map(lambda xs: read(xs, index, keepdims=False), rows)


def _get_samples(ground: GroundInput) -> _Samples:
    return (ground.horizontal, ground.vertical) if isinstance(ground, RecordInput) else ()
