"""Driven motion of many blocks at once, on the grid of the input.

Every block marches at its own pace through the cells of the grid: in each turn of one loop
all take a step, by a Taylor polynomial, to the end of their cell or, if they land before,
to the impact, which is a root of that polynomial. A block with many impacts takes more turns
and holds nobody up; what a block does depends on no other.
"""

import concurrent.futures
import os
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .arguments import POSITIVE, UNIT_INTERVAL, Booleans, Number, Reals, as_real, check
from .block import Block
from .equation import Equation
from .fate import margin_of
from .motion import Motion, Pulse, Record
from .series import Coefficients, derivative, evaluate, lean_series

_ORDER = 6
_LONGEST = 0.15  # step times p
_PULSE_CELLS = 128  # a duration
_UNROLLED = 2  # turns a pass of the loop
_LANES = 512  # blocks in one loop, on a processor


class BatchResponse(eqx.Module):
    """What many blocks did; see `respond_batch`. All have the shape of the batch.

    Attributes
    ----------
    peak_rotation : Array
        Largest abs(alpha) [rad], at most pi / 2.
    final_rotation, final_velocity : Array
        At the end of the duration [rad], [rad/s].
    overturned : Array of bool
        As in `Response`.
    margin : Array
        `fate_margin` at the end of the input.
    impacts : Array of int
        Number of impacts.
    complete : Array of bool
        Whether the motion was followed to its end. Where it was not, for want of turns of
        the loop or of valid arguments, the answers are NaN.
    """

    peak_rotation: Reals
    final_rotation: Reals
    final_velocity: Reals
    overturned: Booleans
    margin: Reals
    impacts: Int[Array, "..."]
    complete: Booleans


class _Grid(eqx.Module):
    """The ground as cells, in each a polynomial of the time in cells."""

    table: Reals  # (records or 1, cells, 2 (horizontal, vertical), degree + 1)
    amplitude: Reals
    length: Reals  # of a cell
    start: Reals
    row: Int[Array, "..."]


class _Lanes(NamedTuple):
    cell: Any
    along: Any  # time in the cell
    side: Any
    lean: Any
    speed: Any
    rests: Any
    over: Any
    peak: Any
    impacts: Any
    fate_lean: Any
    fate_speed: Any
    turns: Any


def _pulse_table(motion: Pulse) -> Any:
    """Cubics with the values and slopes of the shape at the ends of every cell."""
    cells = int(_PULSE_CELLS * motion.turns[-1])
    edges = jnp.linspace(0, motion.turns[-1], cells + 1, dtype=motion.amplitude.dtype)
    value, slope = jax.jvp(motion.shape, (edges,), (jnp.full_like(edges, 1 / _PULSE_CELLS),))
    rise = value[1:] - value[:-1]
    before, after = slope[:-1], slope[1:]
    cubic = jnp.stack(
        [value[:-1], before, 3 * rise - 2 * before - after, before + after - 2 * rise], axis=-1
    )
    return jnp.stack([cubic, jnp.zeros_like(cubic)], axis=1)[None]


def _record_table(motion: Record) -> Any:
    def lines(samples: Any) -> Any:
        return jnp.stack([samples[..., :-1], jnp.diff(samples)], axis=-1)

    vertical = motion.vertical
    if vertical is None:
        vertical = jnp.zeros_like(motion.acceleration)
    both = jnp.stack([lines(motion.acceleration), lines(vertical)], axis=-2)
    return both.reshape(-1, *both.shape[-3:])


def _kept(values: Any) -> Any:
    """Have values computed here, once: XLA would compute them again wherever they are used."""
    return jax.lax.optimization_barrier(values)


def _crossing(c: Coefficients, wanted: Any, low: Any, high: Any, guess: Any) -> Any:
    """Where a series falls through 0 between `low` and `high`: Newton, kept in the bracket.

    Until all that are wanted have it; the last step, outside of the loop, gives the root its
    derivative.
    """
    slope = derivative(c)
    small = 4 * jnp.finfo(guess.dtype).eps

    def newton(x: Any) -> tuple[Any, Any, Any]:
        value, steep = evaluate(c, x), evaluate(slope, x)
        return value, steep < 0, x - value / jnp.where(steep < 0, steep, -1)

    def better(state: Any) -> Any:
        x, low, high, left, count = state
        value, falling, there = newton(x)
        low = jnp.where(left & (value > 0), x, low)
        high = jnp.where(left & ~(value > 0), x, high)
        inside = falling & (there >= low) & (there <= high)
        there = jnp.where(inside, there, 0.5 * (low + high))
        # One that has its root waits, so that no other changes it.
        still = left & (jnp.abs(there - x) > small * high)
        return jnp.where(left, there, x), low, high, still, count + 1

    x, *_ = jax.lax.while_loop(
        lambda state: state[3].any() & (state[4] < 80),
        better,
        (guess, low, high, wanted, 0),
    )
    _, falling, there = newton(x)
    return jnp.where(falling, jnp.clip(there, low, high), x)


def _turn(lanes: _Lanes, equation: Equation, restitution: Any, grid: _Grid, duration: Any) -> Any:
    """One step of every lane: to the end of its cell, its impact, or its uplift."""
    cells = grid.table.shape[1]
    dtype = lanes.lean.dtype
    angle, square = equation.critical_angle, equation.square
    rate = jnp.sqrt(square)
    acts = (lanes.cell >= 0) & (lanes.cell < cells)
    begin = jnp.where(lanes.cell < 0, 0, grid.start + lanes.cell.astype(dtype) * grid.length)
    length = jnp.where(lanes.cell < 0, grid.start, jnp.where(acts, grid.length, jnp.inf))
    stop = jnp.minimum(length, duration - begin)  # of the cell, or of everything
    left = stop - lanes.along
    moves = ~lanes.rests
    step = jnp.where(moves, jnp.minimum(left, _LONGEST / rate), left)

    # The ground from here on, in powers of time.
    entry = grid.table[grid.row, jnp.clip(lanes.cell, 0, cells - 1)]
    strength = jnp.where(acts, grid.amplitude / equation.gravity, 0)
    xi, per = lanes.along / grid.length, 1 / grid.length

    def ahead(c: Any) -> Any:
        c = [strength * c[..., k] for k in range(entry.shape[-1])]
        if len(c) == 2:
            return c[0] + xi * c[1], c[1] * per
        value, slope = evaluate(tuple(c), xi), evaluate(derivative(tuple(c)), xi)
        return value, slope * per, (c[2] + 3 * xi * c[3]) * per**2, c[3] * per**3

    horizontal, lift = ahead(entry[..., 0, :]), ahead(entry[..., 1, :])
    push = tuple(lanes.side * part for part in horizontal)
    horizontal, lift, push, step = _kept((horizontal, lift, push, step))

    # At rest: when is it lifted, and to which side?
    def excess(side: Any) -> Any:
        return tuple(
            side * h - v * equation.tangent - (equation.tangent if k == 0 else 0)
            for k, (h, v) in enumerate(zip(horizontal, lift, strict=True))
        )

    right, leftward = excess(1.0), excess(-1.0)
    one_step = jnp.where(jnp.isfinite(step), step, 0)
    e_right, e_left = evaluate(right, one_step), evaluate(leftward, one_step)
    at_once = jnp.maximum(right[0], leftward[0]) > 0
    to_right = jnp.where(at_once, right[0] > 0, e_right >= e_left)
    lifted = lanes.rests & (at_once | (jnp.maximum(e_right, e_left) > 0))
    chosen = tuple(jnp.where(to_right, a, b) for a, b in zip(right, leftward, strict=True))
    rise = jnp.where(to_right, e_right, e_left) - chosen[0]
    wait = jnp.where(lifted & ~at_once, -chosen[0] * one_step / jnp.where(rise > 0, rise, 1), 0)
    if len(chosen) > 2:
        for _ in range(3):
            slope = evaluate(derivative(chosen), wait)
            better = wait - evaluate(chosen, wait) / jnp.where(slope > 0, slope, 1)
            wait = jnp.where(slope > 0, jnp.clip(better, 0, one_step), wait)
    wait = jnp.where(at_once, 0, wait)
    wait, lifted, to_right = _kept((wait, lifted, to_right))

    # In motion: the Taylor polynomial, and whether it meets the ground.
    path = lean_series(equation, lanes.lean, lanes.speed, push, lift, _ORDER)
    path = _kept(path)
    slope = derivative(path)
    bend = derivative(slope)
    end = evaluate(path, one_step)
    lowest = one_step
    for _ in range(2):  # a minimum before the end, approached from there
        curvature = evaluate(bend, lowest)
        rising = evaluate(slope, lowest)
        dips = (curvature > 0) & (rising > 0)
        lowest = jnp.where(
            dips, jnp.clip(lowest - rising / jnp.where(dips, curvature, 1), 0, one_step), lowest
        )
    lowest = jnp.where(end < 0, one_step, lowest)
    grounded = lanes.lean == 0
    # A block that has just been launched is on the ground: divide that root out.
    reduced = tuple(
        jnp.where(grounded, after, here)
        for here, after in zip(path, (*path[1:], jnp.zeros_like(end)), strict=True)
    )
    lands = moves & (evaluate(reduced, lowest) < 0) & (lowest > 0)
    lands, lowest, end, reduced = _kept((lands, lowest, end, reduced))
    a, b, c = path[:3]
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    down = jnp.where(b >= 0, (b + root) / jnp.where(c < 0, -2 * c, 1), 2 * a / (root - b))
    guess = jnp.where((down > 0) & (down < lowest) & ((c < 0) | (b < 0)), down, 0.5 * lowest)
    x = _crossing(reduced, lands, jnp.zeros_like(lowest), lowest, guess)
    flight = jnp.where(lands, x, one_step)
    speed = evaluate(slope, flight)
    lean = jnp.where(lands, 0, evaluate(path, flight))
    lean, speed, flight = _kept((lean, speed, flight))
    # The highest point on the way.
    turns = (b > 0) & (speed < 0)
    guess = flight * b / jnp.where(turns, b - speed, 1)
    top = jnp.where(
        turns, _crossing(slope, turns & moves, jnp.zeros_like(flight), flight, guess), flight
    )
    peak = jnp.maximum(lean, evaluate(path, top))

    peak = _kept(peak)

    # Impact, and rest if all the bounces left are over in no time.
    leaving = restitution * jnp.abs(speed)
    push_then = -evaluate(push, flight)
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    if equation.linearized:
        sine, cosine = angle, jnp.ones_like(angle)
    onward = equation.lean_acceleration(sine, cosine, push_then, evaluate(lift, flight))
    negligible = 1e-6 if dtype == jnp.float64 else 1e-4
    bounces = 2 * leaving * rate
    lost = -onward * (1 - restitution)
    settles = lands & (onward < 0) & (bounces <= negligible * lost)

    over = moves & (lean >= 0.5 * jnp.pi)
    lean = jnp.where(over, 0.5 * jnp.pi, lean)
    taken = jnp.where(moves, flight, jnp.where(lifted, wait, one_step))
    arrives = jnp.where(moves, ~lands & (step >= left), ~lifted)
    along = lanes.along + taken
    new_cell = arrives & (stop >= length)
    ended = arrives & ~new_cell
    after = _Lanes(
        cell=jnp.where(new_cell, lanes.cell + 1, jnp.where(ended, cells + 1, lanes.cell)),
        along=jnp.where(new_cell, 0, along),
        side=jnp.where(
            moves,
            jnp.where(lands, -lanes.side, lanes.side),
            jnp.where(lifted, jnp.where(to_right, 1.0, -1.0).astype(dtype), lanes.side),
        ),
        lean=jnp.where(moves, lean, lanes.lean),
        speed=jnp.where(
            moves, jnp.where(lands, jnp.where(settles, 0, leaving), speed), lanes.speed
        ),
        rests=jnp.where(moves, settles, ~lifted),
        over=over,
        peak=jnp.where(moves, jnp.maximum(lanes.peak, peak), lanes.peak),
        impacts=jnp.where(moves & lands, lanes.impacts + 1, lanes.impacts),
        fate_lean=lanes.fate_lean,
        fate_speed=lanes.fate_speed,
        turns=lanes.turns + 1,
    )
    # The fate is read where the input ends.
    now = acts | (lanes.cell < 0)
    after = after._replace(
        fate_lean=jnp.where(now, after.lean, lanes.fate_lean),
        fate_speed=jnp.where(now, after.speed, lanes.fate_speed),
    )
    active = _active(lanes, cells)
    return _kept(jax.tree.map(lambda new, old: jnp.where(active, new, old), after, lanes))


def _active(lanes: _Lanes, cells: int) -> Any:
    return (lanes.cell <= cells) & ~lanes.over & (lanes.turns < _most_turns(cells))


def _most_turns(cells: int) -> int:
    """Most turns that a lane may take: a bound on the time, reported where it is hit."""
    return 1000 * cells + 10**6


@eqx.filter_jit
def _march(equation: Equation, restitution: Any, grid: _Grid, duration: Any) -> BatchResponse:
    dtype, shape = duration.dtype, duration.shape
    cells = grid.table.shape[1]
    valid = (
        jnp.isfinite(
            equation.square
            + equation.tangent
            + restitution
            + duration
            + grid.amplitude
            + grid.length
            + grid.start
            + grid.table.sum()
        )
        & (equation.square > 0)
        & (restitution >= 0)
        & (restitution <= 1)
        & (grid.length > 0)
        & (duration > 0)
    )
    zero = jnp.zeros(shape, dtype)
    count = jnp.zeros(shape, int)
    lanes = _Lanes(
        cell=jnp.where(valid, count - 1, cells + 1),
        along=zero,
        side=zero + 1,
        lean=zero,
        speed=zero,
        rests=jnp.ones(shape, bool),
        over=jnp.zeros(shape, bool),
        peak=zero,
        impacts=count,
        fate_lean=zero,
        fate_speed=zero,
        turns=count,
    )

    def turns(lanes: _Lanes) -> _Lanes:
        for _ in range(_UNROLLED):
            lanes = _turn(lanes, equation, restitution, grid, duration)
        return lanes

    lanes = jax.lax.while_loop(lambda c: _active(c, cells).any(), turns, lanes)
    complete = valid & ((lanes.cell > cells) | lanes.over)
    margin = margin_of(equation, restitution, lanes.fate_lean, lanes.fate_speed)

    def known(value: Any) -> Any:
        return jnp.where(complete, value, jnp.nan)

    return BatchResponse(
        peak_rotation=known(jnp.minimum(lanes.peak, 0.5 * jnp.pi)),
        final_rotation=known(lanes.side * lanes.lean),
        final_velocity=known(lanes.side * lanes.speed),
        overturned=complete & (lanes.over | (margin < 0)),
        margin=known(margin),
        impacts=lanes.impacts,
        complete=complete,
    )


def respond_batch(
    blocks: Block,
    restitution: Number,
    motion: Motion,
    duration: Number,
    *,
    linearized: bool = False,
) -> BatchResponse:
    """Response of many blocks, from rest, on the grid of the input.

    Everything broadcasts: blocks, restitutions, durations, the amplitude, duration and
    start of a pulse, the scale, time step and start of a `Record`, and the leading axes of
    its samples. What one block does is the same whatever else is in the batch.

    Parameters
    ----------
    blocks : Block
    restitution : array_like
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.
    duration : array_like
        Time to follow the blocks for [s], greater than 0.
    linearized : bool
        Linearize the equation of motion; see `respond`.

    Returns
    -------
    BatchResponse

    Raises
    ------
    ValueError
        If a concrete argument is outside of what is allowed, or shapes do not broadcast.
        Traced values outside give NaN.

    Notes
    -----
    Taylor polynomials of order 6, one a sample (more where the block is fast). Without a
    transformation, the batch is shared out to the devices, or on a single processor to its
    cores. Has forward-mode derivatives.
    """
    restitution, duration = as_real("restitution", restitution), as_real("duration", duration)
    check("restitution", restitution, UNIT_INTERVAL)
    check("duration", duration, POSITIVE)
    blocks.check()
    motion.check()
    arguments = (blocks, restitution, motion, duration)
    leaves = jax.tree.leaves(arguments)
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*leaves)
    blocks, restitution, motion, duration = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, dtype), arguments
    )
    if isinstance(motion, Record):
        records, table = motion.acceleration.shape[:-1], _record_table(motion)
        if motion.vertical is not None:
            records = motion.vertical.shape[:-1] or records
        amplitude, length = motion.scale, motion.time_step
    elif isinstance(motion, Pulse):
        records, table = (), _pulse_table(motion)
        amplitude, length = motion.amplitude, motion.duration / _PULSE_CELLS
    else:
        raise ValueError(f"motion must be a pulse or a Record, got {type(motion).__name__}")
    row = jnp.arange(table.shape[0]).reshape(records)
    equation = Equation.of(blocks, linearized)
    parts = (equation, restitution, amplitude, length, motion.start, row, duration)
    shape = np.broadcast_shapes(*(part.shape for part in jax.tree.leaves(parts)))
    flat = jax.tree.map(lambda part: jnp.broadcast_to(part, shape).reshape(-1), parts)
    size = int(np.prod(shape))

    def march(part: Any) -> BatchResponse:
        equation, restitution, amplitude, length, start, row, duration = part
        grid = _Grid(table, amplitude, length, start, row)
        return _march(equation, restitution, grid, duration)

    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in (table, *jax.tree.leaves(flat)))
    devices = jax.local_devices()
    on_processor = devices[0].platform == "cpu"
    # Always the same number of lanes on a processor, so that it is the same code which
    # computes a block, alone or with others, and is compiled once.
    lanes = _LANES if on_processor else 1 << max(size // len(devices) - 1, 1).bit_length()
    pieces = max(1, -(-size // lanes))
    padding = pieces * lanes - size
    padded = jax.tree.map(
        lambda part: jnp.pad(part, (0, padding), mode="edge").reshape(pieces, lanes), flat
    )
    if traced:
        results = jax.lax.map(march, padded)
    else:

        def on_device(k: int) -> BatchResponse:
            piece = jax.tree.map(lambda part: part[k], padded)
            piece = jax.device_put(piece, devices[k % len(devices)])
            return jax.device_get(march(piece))

        workers = (os.cpu_count() or 1) if on_processor else len(devices)
        with concurrent.futures.ThreadPoolExecutor(min(workers, pieces)) as pool:
            separate = list(pool.map(on_device, range(pieces)))
        results = jax.tree.map(lambda *parts: jnp.stack(parts), *separate)
    return jax.tree.map(lambda part: part.reshape(-1)[:size].reshape(shape), results)
