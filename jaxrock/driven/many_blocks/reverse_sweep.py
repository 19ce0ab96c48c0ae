"""Derivatives of a batch in reverse mode: costates that run backwards along the known steps."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...validation import Integers
from .ground_input import GroundInput
from .prepared_blocks import PreparedBlocks
from .queue import FinalStates
from .record_input import RecordInput
from .step import Lanes, take_step

# States of lanes in a window: 16 numbers each, of which the processor's cache holds about this
# many. Windows that have passed are run again, each from its first state.
_STATES = 2**16
_WINDOWS = 512
# What has derivatives in the state of a lane: the costates.
_REAL = ("elapsed", "rotation", "velocity", "peak", "end_rotation", "end_velocity")


class _Walk(NamedTuple):
    """A run through all windows, and back."""

    window: Integers  # under way
    lanes: Lanes  # now
    count: Integers  # of states in the window
    states: Lanes  # of the window, in the order of time
    first: Lanes  # states of all windows


def pull_back(
    ground: GroundInput,
    rows: Array,
    cotangents: PyTree,
    order: int,
    prepare: Callable[[Array], PreparedBlocks],
    summarize: Callable[[PreparedBlocks, FinalStates], PyTree],
) -> tuple[PyTree, Array]:
    """Pull the cotangents of the answers of some blocks back to samples and arguments.

    """
    size = rows.shape[1]
    prepared, pull_prepared = eqx.filter_vjp(prepare, rows)
    case = prepared.case

    def begin(prepared):
        case = prepared.case
        resting = ground.find_next_interval(jnp.zeros(size, jnp.int32), case.excitation)
        return Lanes.begin(prepared.initial, case, resting)

    lanes, pull_begin = eqx.filter_vjp(begin, prepared)
    active = lambda lanes: lanes.are_active(case) & prepared.valid
    length = max(_STATES // size, 1)

    def stack(lanes, count):
        return jax.tree.map(lambda x: jnp.zeros((count, *x.shape), x.dtype), lanes)

    def read(stacked, place):
        return jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, place, keepdims=False), stacked)

    def write(stacked, place, lanes):
        return jax.tree.map(lambda x, y: jax.lax.dynamic_update_index_in_dim(x, y, place, 0), stacked, lanes)

    def run(lanes, states):
        def go(s):
            k, lanes, states = s
            return k + 1, take_step(lanes, case, ground, order), write(states, k, lanes)
        return jax.lax.while_loop(lambda s: (s[0] < length) & active(s[1]).any(), go, (0, lanes, states))

    def forward(s):
        m, lanes, _, states, firsts = s
        firsts = write(firsts, m, lanes)
        k, lanes, states = run(lanes, states)
        return m + 1, lanes, k, states, firsts

    m, lanes, k, states, firsts = jax.lax.while_loop(
        lambda s: (s[0] < _WINDOWS) & active(s[1]).any(), forward,
        (0, lanes, 0, stack(lanes, length), stack(lanes, _WINDOWS)))
    unfinished = active(lanes)

    def finish(prepared, lanes):
        return summarize(prepared, FinalStates.of(lanes, prepared.case))

    _, pull_finish = eqx.filter_vjp(finish, prepared, lanes)
    prepared_ct, lanes_ct = pull_finish(cotangents)
    costate = tuple(getattr(lanes_ct, name) for name in _REAL)
    costate = jax.tree.map(lambda x: jnp.where(prepared.valid, jnp.where(unfinished, jnp.nan, x), 0), costate)
    samples = (ground.horizontal, ground.vertical) if isinstance(ground, RecordInput) else ()
    samples_ct = jax.tree.map(jnp.zeros_like, samples)
    last = m - 1
    real_case, rest_case = eqx.partition(case, eqx.is_inexact_array)

    def back(s):
        m, states, costate, case_ct, samples_ct = s
        m = m - 1
        def again(states):
            k2, _, states = run(read(firsts, m), states)
            return k2, states
        k2, states = jax.lax.cond(m == last, lambda states: (k, states), again, states)

        def pull_step(s):
            j, costate, case_ct, lines_ct, places = s
            j = j - 1
            lanes = read(states, j)
            place = case.excitation.first_interval + lanes.interval
            ours = ground.read(place) if samples else ground
            lines = (ours.horizontal, ours.vertical) if samples else ()

            def step(state, real_case, lines):
                g = replace(ours, horizontal=lines[0], vertical=lines[1]) if samples else ours
                new = take_step(replace(lanes, **dict(zip(_REAL, state))), eqx.combine(real_case, rest_case), g, order)
                return tuple(getattr(new, name) for name in _REAL)

            state = tuple(getattr(lanes, name) for name in _REAL)
            _, pull = jax.vjp(step, state, real_case, lines)
            new, dcase, dlines = pull(costate)
            on = active(lanes)
            keep = lambda a, b: jnp.where(on, a, b)
            costate = jax.tree.map(keep, new, costate)
            case_ct = jax.tree.map(lambda t, d: t + jnp.where(on, d, 0), case_ct, dcase)
            lines_ct = write(lines_ct, j, jax.tree.map(lambda d: jnp.where(on, d, 0), dlines))
            places = write(places, j, place)
            return j, costate, case_ct, lines_ct, places

        lines0 = jax.tree.map(lambda _: jnp.zeros((length, size), rows.dtype), samples)
        _, costate, case_ct, lines_ct, places = jax.lax.while_loop(lambda s: s[0] > 0, pull_step, (k2, costate, case_ct, lines0, jnp.zeros((length, size), jnp.int32)))
        samples_ct = jax.tree.map(lambda t, d: t.at[places].add(d, mode="clip"), samples_ct, lines_ct)
        return m, states, costate, case_ct, samples_ct

    case_ct0 = jax.tree.map(jnp.zeros_like, real_case)
    _, _, costate, case_ct, samples_ct = jax.lax.while_loop(lambda s: s[0] > 0, back, (m, states, costate, case_ct0, samples_ct))
    real_lanes = jax.tree.map(lambda x: jnp.zeros_like(x) if eqx.is_inexact_array(x) else None, lanes)
    lanes_ct = replace(real_lanes, **dict(zip(_REAL, costate)))
    begin_ct, = pull_begin(lanes_ct)
    add = lambda *p: sum(p)
    prepared_ct = jax.tree.map(add, prepared_ct, begin_ct)
    prepared_ct = prepared_ct._replace(case=jax.tree.map(add, prepared_ct.case, case_ct))
    rows_ct, = pull_prepared(prepared_ct)
    return samples_ct, jnp.where(prepared.valid, rows_ct, 0)


