"""Driven motion of many blocks at once, on the grid of the input.

A fixed number of lanes work off a queue of blocks: one that has finished takes the next, so
that nobody waits for a block with many impacts.
"""

import functools
import math
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..block import Block
from ..ground_motion import Motion, Pulse, Record
from ..host import listed, mapped
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, UNIT_INTERVAL, Booleans, Number, Reals, as_real, check
from .batch_step import Arguments, Case, Lanes, most_turns, turn
from .intervals import Grid, factor_length_and_end, grid_of
from .overturning_criterion import margins_of
from .taylor import kept

_LANES = 64  # on a processor
_ROOMS = (512, 4096)  # for the queue, on a processor
_TURNS = 64  # between two looks at the queue
ORDERS = range(3, 13)


class BatchResponse(eqx.Module):
    """What many blocks did; see `respond_batch`. All have the shape of the batch.

    Attributes
    ----------
    peak_rotation : Array
        Largest abs(alpha) [rad], at most pi / 2.
    final_rotation, final_velocity : Array
        At the end of the duration [rad], [rad/s]; of a block that has fallen, at the end of
        the step in which it reached pi / 2.
    overturned : Array of bool
        As in `Response`.
    margin : Array
        `free_motion_margin` at the end of the input [-].
    impacts : Array of int
        Number of impacts, without the infinitely many in which a block comes to rest.
    mode : Array of int
        Of those that overturn, the number of impacts before they do, which may be one more
        than until the end of the input; else -1.
    complete : Array of bool
        Whether the motion was followed to its end. Where it was not, for want of turns of
        the loop or of valid arguments, the real ones are NaN.
    """

    peak_rotation: Reals
    final_rotation: Reals
    final_velocity: Reals
    overturned: Booleans
    margin: Reals
    impacts: Int[Array, "..."]
    mode: Int[Array, "..."]
    complete: Booleans

    def __str__(self) -> str:
        return listed(
            self,
            overturned="",
            margin="",
            peak_rotation="rad",
            final_rotation="rad",
            final_velocity="rad/s",
            impacts="",
            complete="",
        )


class _Progress(NamedTuple):
    lanes: Lanes
    block: Any  # of each lane, its place in the queue; beyond its end: nobody's
    case: Case  # of the lanes
    taken: Any  # from the queue
    results: Any  # (queue + 1, results): what is nobody's goes to the last row


def _march(
    grid: Grid, arguments: Any, count: Any, form: Any, model: RockingModel, lanes: int, order: int
) -> BatchResponse:
    """The first `count` columns of arguments, which have a given form, with as many lanes."""
    queue = Case.of(grid, jax.tree.unflatten(form, list(arguments)), model)
    dtype, size = queue.duration.dtype, queue.duration.size
    valid = queue.valid()
    # Those that will move for long go first.
    effort = queue.equation.tangent / jnp.abs(queue.strength)
    line = jnp.argsort(jnp.where(valid & (jnp.arange(size) < count), effort, jnp.inf))

    def look(progress: _Progress) -> _Progress:
        """Put away the results of lanes that have finished, and give them new blocks."""
        lanes, block, case, taken, results = progress
        idle = ~lanes.active(grid)
        row = (
            lanes.peak,
            lanes.side * lanes.lean,
            lanes.side * lanes.speed,
            lanes.fate_lean,
            lanes.fate_speed,
            lanes.impacts.astype(dtype),
            (lanes.turns < most_turns(grid)).astype(dtype),
        )
        results = results.at[jnp.where(idle, block, size)].set(jnp.stack(row, axis=-1))
        place = taken + jnp.cumsum(idle) - 1
        gets = idle & (place < count)
        place = jnp.clip(place, 0, size - 1)
        block = jnp.where(idle, jnp.where(gets, line[place], size), block)

        def given(new: Any, old: Any) -> Any:
            return jnp.where(gets, new, old)

        next_case = jax.tree.map(lambda leaf: leaf[line[place]], queue)
        case = jax.tree.map(given, next_case, case)
        fresh = grid.next_cell(jnp.zeros_like(lanes.cell), case.trail)
        lanes = jax.tree.map(given, Lanes.at_rest(fresh, dtype), lanes)
        return _Progress(lanes, block, case, jnp.minimum(taken + idle.sum(), count), results)

    def turns(progress: _Progress) -> _Progress:
        case = progress.case
        _, lanes = jax.lax.while_loop(
            lambda state: state[0] < _TURNS,
            lambda state: (state[0] + 1, turn(state[1], case, grid, order)),
            (0, progress.lanes),
        )
        return look(progress._replace(lanes=lanes))

    begin = _Progress(
        Lanes.at_rest(jnp.full(lanes, grid.cells, jnp.int32), dtype),
        jnp.full(lanes, size),
        jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[0], (lanes,)), queue),
        jnp.zeros((), int),
        jnp.zeros((size + 1, 7), dtype),
    )
    *_, results = jax.lax.while_loop(lambda p: (p.block < size).any(), turns, look(begin))
    peak, rotation, velocity, fate_lean, fate_speed, impacts, finished = results[:-1].T
    complete = valid & (finished > 0)
    at_once, later = margins_of(queue.equation, queue.restitution, fate_lean, fate_speed)
    margin = jnp.minimum(at_once, later)
    fallen = peak >= 0.5 * jnp.pi
    overturned = complete & (fallen | (margin < 0))
    impacts = impacts.astype(int)
    mode = impacts + jnp.where(fallen | (at_once < 0), 0, 1)

    def known(value: Any) -> Any:
        return jnp.where(complete, value, jnp.nan)

    return BatchResponse(
        peak_rotation=known(jnp.minimum(peak, 0.5 * jnp.pi)),
        final_rotation=known(rotation),
        final_velocity=known(velocity),
        overturned=overturned,
        margin=known(margin),
        impacts=impacts,
        mode=jnp.where(overturned, mode, -1),
        complete=complete,
    )


def _known(name: str, value: Any) -> bool:
    """Whether the compiler takes an option: versions differ, and none must break the batch."""
    try:
        trial = jax.jit(lambda x: kept(x + x) * x, compiler_options={name: value})
        with jax.default_device(jax.local_devices(backend="cpu")[0]):
            trial.lower(np.zeros(2, np.float32)).compile()
    except Exception:  # of which type depends on the version
        return False
    return True


@functools.cache
def compiler_options(platform: str) -> dict[str, Any] | None:
    """Options for XLA, for programs that follow a batch and are not part of a larger program."""
    if platform != "cpu":
        return None
    # The widest vectors that a processor has are not what XLA takes by itself, and what
    # becomes of NaN is looked after here.
    options = {
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_enable_fast_min_max": True,
    }
    if jax.__version_info__ < (0, 11):
        # A pass that removes what keeps values from being computed again; later versions have
        # none that does so too early, and need it.
        options["xla_disable_hlo_passes"] = "cse_barrier_expander"
    return {n: v for n, v in options.items() if _known(n, v)}


@functools.cache
def _compiled(platform: str) -> Callable[..., BatchResponse]:
    static = ("form", "model", "lanes", "order")
    return jax.jit(_march, static_argnames=static, compiler_options=compiler_options(platform))


def respond_batch(
    blocks: Block,
    restitution: Number,
    motion: Motion,
    duration: Number | None = None,
    *,
    model: ModelLike = Nonlinear(),
    order: int | None = None,
) -> BatchResponse:
    """Response of many blocks, from rest, on the grid of the input.

    Everything broadcasts: blocks, restitutions, durations, the amplitude, duration and
    start of a pulse, the scale, time step and start of a `Record`, and the leading axes of
    its samples. What one block does is the same whatever else is in the batch.

    Parameters
    ----------
    blocks : Block
    restitution : array_like
        C [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.
    duration : array_like, optional
        Time to follow each block for [s], greater than 0; to the end of the motion unless
        given.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    order : int, optional
        Of the Taylor polynomials, 3 to 12: what accuracy is dialled with. 8 by default, and in
        float32, where rounding is all that is left then, 6. `choose` says which one a motion
        needs, `respond_within` takes it.

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
    Taylor polynomials, one a sample (more where the block is fast). A pulse is
    taken as 128 quintics a period. Without a transformation, the batch is shared out to
    the devices, or on a single processor to its cores. Has forward-mode derivatives.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> pulses = jr.Sine(amplitude=jnp.array([2.5, 3.5, 4.5]), duration=0.5)
    >>> response = jr.respond_batch(jr.Block(half_width=0.1, slenderness=5.0), 0.9, pulses)
    >>> print(*(f"{peak:.3f} rad" for peak in response.peak_rotation), response.overturned)
    0.044 rad 0.069 rad 0.077 rad [False  True  True]
    """
    restitution = as_real("restitution", restitution)
    check("restitution", restitution, UNIT_INTERVAL)
    if duration is not None:
        duration = as_real("duration", duration)
        check("duration", duration, POSITIVE)
    if not isinstance(motion, Pulse | Record):
        raise ValueError(f"motion must be a pulse or a Record, got {type(motion).__name__}")
    if order is not None and order not in ORDERS:
        raise ValueError(f"order must be a whole number from 3 to 12, got {order}")
    blocks.check()
    motion.check()
    model = as_model(model)
    leaves = jax.tree.leaves((blocks, restitution, motion, duration))
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*leaves)
    if order is None:
        order = 8 if dtype == np.float64 else 6
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
    # Outside of a transformation NumPy is quicker for what there is to do.
    library: Any = jnp if traced else np

    def converted(tree: Any) -> Any:
        return jax.tree.map(lambda leaf: library.asarray(leaf, dtype), tree)

    shaking = converted(motion)
    grid = grid_of(shaking)
    factor, length, end = factor_length_and_end(shaking)
    arguments = Arguments(
        converted(blocks),
        converted(restitution),
        factor,
        length,
        shaking.start,
        end if duration is None else converted(duration),
        np.arange(math.prod(grid.motions), dtype=dtype).reshape(grid.motions),
    )
    leaves, form = jax.tree.flatten(arguments)
    shape = np.broadcast_shapes(*(leaf.shape for leaf in leaves))
    size = math.prod(shape)
    rows = library.stack([library.broadcast_to(leaf, shape).reshape(-1) for leaf in leaves])
    if traced:
        result = _march(grid, rows, size, form, model, _LANES, order)
        return jax.tree.map(lambda leaf: leaf.reshape(shape), result)

    default = jax.config.jax_default_device
    if default is None:
        devices = jax.local_devices()
    else:  # which may be the name of a platform
        named = isinstance(default, str)
        devices = jax.local_devices(backend=default) if named else [default]
    on_processor = devices[0].platform == "cpu"
    workers = (os.cpu_count() or 1) if on_processor else len(devices)
    share = max(-(-size // workers), 1)
    room, lanes = 1 << (share - 1).bit_length(), share
    if on_processor:
        # Few different shapes, so that little is compiled.
        share, lanes = min(_ROOMS[-1], share), _LANES
        room = next(room for room in _ROOMS if share <= room)
    march = _compiled(devices[0].platform)

    def on_device(k: int) -> BatchResponse:
        part = rows[:, k * share : (k + 1) * share]
        count = part.shape[1]
        queue = np.pad(part, ((0, 0), (0, room - count)), constant_values=1)
        placed = jax.device_put((grid, queue), devices[k % len(devices)])
        result = march(*placed, count, form=form, model=model, lanes=lanes, order=order)
        return jax.tree.map(lambda leaf: leaf[:count], jax.device_get(result))

    pieces = max(1, -(-size // share))
    separate = mapped(on_device, range(pieces), min(workers, pieces))
    whole = jax.tree.map(lambda *parts: np.concatenate(parts).reshape(shape), *separate)
    return jax.device_put(whole)
