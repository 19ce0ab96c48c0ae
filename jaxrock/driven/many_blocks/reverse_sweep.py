"""Derivatives in reverse mode: costates that run backwards along the steps of a simulation.

The steps of a block are known once it has been simulated. Each is transposed where it was taken,
with its impact, so that the derivatives are those of forward mode. The states are kept in
windows of steps: the last window is there when the simulation ends, the others are run again,
each from its first state.
"""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...validation import Booleans, Integers, Reals
from .ground_input import GroundInput
from .prepared_blocks import Case, PreparedBlocks
from .queue import FinalStates
from .record_input import RecordInput
from .step import Lanes, take_step

# Lanes times steps in a window. The states of a window fit into a cache.
_ROOM = 2**16
# More windows than a motion takes, unless its steps are used up: then derivatives are NaN.
_WINDOWS = 2**9
_COSTATES = "elapsed", "rotation", "velocity", "peak", "end_rotation", "end_velocity"


class _Sweep(NamedTuple):
    """What changes from window to window, on the way there and back."""

    window: Integers
    returns: Booleans  # whether the end has been reached
    starts: Lanes  # of all windows
    states: Lanes  # of the steps in a window
    places: Integers  # in the arrays of samples, of these steps
    lines: tuple  # cotangents of the samples of these steps
    costates: tuple[Reals, ...]
    blocks: PreparedBlocks  # cotangents
    samples: tuple  # cotangents


def pull_back(
    ground: GroundInput,
    rows: Reals,
    cotangents: PyTree,
    lanes: int,
    order: int,
    prepare: Callable[[Reals], PreparedBlocks],
    summarize: Callable[[PreparedBlocks, FinalStates], PyTree],
) -> tuple[PyTree, Reals]:
    """Pull cotangents of the answers back to the samples of the ground and the arguments.

    `prepare` makes blocks from rows of arguments, `summarize` answers from final states. As many
    blocks as there are `lanes` go side by side.
    """
    size = rows.shape[1]
    padding = -size % lanes

    def split(x: Reals) -> Reals:
        padded = jnp.pad(x, [(0, padding), *[(0, 0)] * (x.ndim - 1)])
        return padded.reshape(-1, lanes, *x.shape[1:])

    def pull_group(samples: tuple, group: tuple[Reals, PyTree]) -> tuple[tuple, Reals]:
        rows, cotangents = group
        prepared, pull_prepared = eqx.filter_vjp(prepare, rows.T)
        samples, pulled = _sweep(ground, prepared, cotangents, samples, order, summarize)
        # A block that is not valid has no derivatives, in either mode.
        return samples, jnp.where(prepared.valid, pull_prepared(pulled)[0], 0).T

    nothing = jax.tree.map(jnp.zeros_like, _get_samples(ground))
    groups = jax.tree.map(split, (rows.T, cotangents))
    samples, pulled = jax.lax.scan(pull_group, nothing, groups)
    pulled = pulled.reshape(-1, len(rows))[:size].T
    return _replace_samples(eqx.filter(ground, False), samples), pulled


def _sweep(
    ground: GroundInput,
    prepared: PreparedBlocks,
    cotangents: PyTree,
    samples: tuple,
    order: int,
    summarize: Callable[[PreparedBlocks, FinalStates], PyTree],
) -> tuple[tuple, PreparedBlocks]:
    """Simulate blocks side by side to their ends, and go back along their steps.

    Returns the cotangents of the samples, added to those given, and of the blocks.
    """
    case = prepared.case
    size = case.duration.size
    length = max(_ROOM // size, 1)
    real_case, rest = eqx.partition(case, eqx.is_inexact_array)

    def begin(prepared: PreparedBlocks) -> Lanes:
        zero = jnp.zeros(size, jnp.int32)
        resting = ground.find_next_interval(zero, prepared.case.excitation)
        return Lanes.begin(prepared.initial, prepared.case, resting)

    def finish(prepared: PreparedBlocks, lanes: Lanes) -> PyTree:
        return summarize(prepared, FinalStates.of(lanes, prepared.case))

    def are_active(lanes: Lanes) -> Booleans:
        return lanes.are_active(case) & prepared.valid

    def run_step(state: tuple[Integers, Lanes, Lanes]) -> tuple[Integers, Lanes, Lanes]:
        step, lanes, states = state
        return step + 1, take_step(lanes, case, ground, order), _write(states, step, lanes)

    def pull_step(state: tuple[Integers, _Sweep]) -> tuple[Integers, _Sweep]:
        step, sweep = state[0] - 1, state[1]
        lanes = _read(sweep.states, step)
        place = case.excitation.first_interval + lanes.interval
        local = ground.read(place)

        def take(costates: tuple, case: Case, samples: tuple) -> tuple[Reals, ...]:
            moved = replace(lanes, **dict(zip(_COSTATES, costates, strict=True)))
            ground = _replace_samples(local, samples)
            return _get_costates(take_step(moved, eqx.combine(case, rest), ground, order))

        arguments = _get_costates(lanes), real_case, _get_samples(local)
        pulled = jax.vjp(take, *arguments)[1](sweep.costates)
        active = are_active(lanes)
        kept = jax.tree.map(lambda x: jnp.where(active, 0, x), sweep.costates)
        pulled = jax.tree.map(lambda x: jnp.where(active, x, 0), pulled)
        return step, sweep._replace(
            costates=jax.tree.map(jnp.add, kept, pulled[0]),
            blocks=sweep.blocks._replace(
                case=jax.tree.map(jnp.add, sweep.blocks.case, pulled[1])
            ),
            lines=_write(sweep.lines, step, pulled[2]),
            places=_write(sweep.places, step, place),
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
        pulled = eqx.filter_vjp(finish, prepared, lanes)[1](cotangents)
        last = tuple(jnp.where(goes_on, jnp.nan, x) for x in _get_costates(pulled[1]))
        sweep = sweep._replace(
            returns=returns,
            starts=_write(sweep.starts, sweep.window + 1, lanes),
            states=states,
            costates=jax.tree.map(functools.partial(jnp.where, ends), last, sweep.costates),
            blocks=jax.tree.map(lambda x, y: x + jnp.where(ends, y, 0), sweep.blocks, pulled[0]),
        )
        _, sweep = jax.lax.while_loop(
            lambda state: state[0] > 0, pull_step, (jnp.where(returns, count, 0), sweep)
        )
        added = jax.tree.map(
            lambda total, lines: total.at[sweep.places].add(lines), sweep.samples, sweep.lines
        )
        return sweep._replace(window=sweep.window + jnp.where(returns, -1, 1), samples=added)

    lanes, pull_begin = eqx.filter_vjp(begin, prepared)
    zeros = jax.tree.map(jnp.zeros_like, (lanes, prepared))
    sweep = _Sweep(
        window=jnp.zeros((), jnp.int32),
        returns=jnp.zeros((), bool),
        starts=_write(_make_room(lanes, _WINDOWS + 1), 0, lanes),
        states=_make_room(lanes, length),
        places=_make_room(lanes.interval, length),
        lines=jax.tree.map(lambda x: jnp.zeros((length, size), x.dtype), samples),
        costates=_get_costates(zeros[0]),
        blocks=eqx.filter(zeros[1], eqx.is_inexact_array),
        samples=samples,
    )
    sweep = jax.lax.while_loop(lambda sweep: sweep.window >= 0, pull_window, sweep)
    first = dict(zip(_COSTATES, sweep.costates, strict=True))
    pulled = pull_begin(replace(eqx.filter(zeros[0], eqx.is_inexact_array), **first))
    return sweep.samples, jax.tree.map(jnp.add, sweep.blocks, pulled[0])


def _make_room(tree: PyTree, length: int) -> PyTree:
    return jax.tree.map(lambda x: jnp.zeros((length, *x.shape), x.dtype), tree)


def _write(rows: PyTree, index: Integers, row: PyTree) -> PyTree:
    write = jax.lax.dynamic_update_index_in_dim
    return jax.tree.map(lambda xs, x: write(xs, x, index, 0), rows, row)


def _read(rows: PyTree, index: Integers) -> PyTree:
    read = jax.lax.dynamic_index_in_dim
    return jax.tree.map(lambda xs: read(xs, index, keepdims=False), rows)


def _get_samples(ground: GroundInput) -> tuple:
    return (ground.horizontal, ground.vertical) if isinstance(ground, RecordInput) else ()


def _replace_samples(ground: GroundInput, samples: tuple) -> GroundInput:
    return replace(ground, horizontal=samples[0], vertical=samples[1]) if samples else ground


def _get_costates(lanes: Lanes) -> tuple[Reals, ...]:
    return tuple(getattr(lanes, name) for name in _COSTATES)
