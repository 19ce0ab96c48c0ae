"""Driven motion of many blocks at once, shared out to devices or processors."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...block import Block
from ...ground_motion import Harmonic, Motion, Pulse, Record, Suite
from ...host import Printed, listed, mapped, processors, with_progress
from ...resonance import ModelLike, Nonlinear, RockingModel, as_model
from ...validation import (
    POSITIVE,
    UNIT_INTERVAL,
    Booleans,
    Integers,
    Number,
    Reals,
    as_real,
    check,
    check_kind,
    check_shapes,
)
from ..overturning_criterion import TOPPLED_ROTATION, free_motion_margins, smaller_margin
from .batch import Batch, GroundMotions
from .ground_inputs import PulseInput, RecordInput
from .queue import work_off
from .step import Case, Lanes, take_step
from .taylor import materialized

_LANES = 64  # on a processor
_ROOM = 2048  # for the queue, on a processor
# Blocks that one thread follows as fast as two, through one pulse or a record.
_ALONE = {PulseInput: 512, RecordInput: 16}
# Orders of the Taylor polynomials, by the bytes of a number. On records samples keep steps
# short.
_ORDERS = {PulseInput: {8: 14, 4: 8}, RecordInput: {8: 10, 4: 8}}
# Of the tolerance that a step may take, also from 1e-10 on, where rounding takes a part.
_SHARE = 0.05
_SHARE_OF_TIGHT = 0.02
_TIGHT = 1e-10


class BatchResponse(Printed, eqx.Module):
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
        Number of impacts before overturning, which may be one more than until the end of the
        input; -1 for a block that stands.
    complete : Array of bool
        Whether the motion was followed to its end. Where it was not, for want of steps or of
        valid arguments, the real numbers are NaN.
    """

    peak_rotation: Reals
    final_rotation: Reals
    final_velocity: Reals
    overturned: Booleans
    margin: Reals
    impacts: Integers
    mode: Integers
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


def _march(
    ground: PulseInput | RecordInput,
    arguments: Any,
    count: Any,
    tolerance: Any,
    form: Any,
    model: RockingModel,
    lanes: int,
    order: int,
) -> BatchResponse:
    """Return the first `count` columns of arguments, leaves of a tree of the given form."""
    case = Case.of(ground, jax.tree.unflatten(form, list(arguments)), model)

    def step(lanes: Lanes, case: Case) -> Lanes:
        return take_step(lanes, case, ground, tolerance, order)

    ends = work_off(ground, case.for_steps(), count, lanes, step)
    complete = case.valid() & (ends.followed > 0)
    before_impact, after_impact = free_motion_margins(
        case.equation, case.restitution, ends.end_rotation, ends.end_velocity
    )
    margin = smaller_margin(before_impact, after_impact)
    fallen = ends.peak >= TOPPLED_ROTATION
    overturned = complete & (fallen | (margin < 0))
    impacts = ends.impacts.astype(int)
    mode = impacts + jnp.where(fallen | (before_impact < 0), 0, 1)

    def where_complete(value: Any) -> Any:
        return jnp.where(complete, value, jnp.nan)

    return BatchResponse(
        peak_rotation=where_complete(jnp.minimum(ends.peak, TOPPLED_ROTATION)),
        final_rotation=where_complete(ends.rotation),
        final_velocity=where_complete(ends.velocity / case.unit),
        overturned=overturned,
        margin=where_complete(margin),
        impacts=impacts,
        mode=jnp.where(overturned, mode, -1),
        complete=complete,
    )


def _takes_option(name: str, value: Any) -> bool:
    """Tell whether the compiler takes an option: versions differ, and none must fail."""
    try:
        trial = jax.jit(lambda x: materialized(x + x) * x, compiler_options={name: value})
        with jax.default_device(jax.local_devices(backend="cpu")[0]):
            trial.lower(np.zeros(2, np.float32)).compile()
    except Exception:  # of which type depends on the version
        return False
    return True


@functools.cache
def compiler_options(platform: str) -> dict[str, Any] | None:
    """Options for XLA, for programs that follow a batch on their own."""
    if platform != "cpu":
        return None
    # By itself XLA does not take the widest vectors of a processor. A minimum that does not
    # propagate NaN is faster, and blocks with NaN are masked here anyway.
    options = {
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_enable_fast_min_max": True,
    }
    if jax.__version_info__ < (0, 11):
        # This pass removes the barriers against recomputation, too early in these versions.
        options["xla_disable_hlo_passes"] = "cse_barrier_expander"
    return {n: v for n, v in options.items() if _takes_option(n, v)}


@functools.cache
def _compiled(platform: str) -> Callable[..., BatchResponse]:
    static = ("form", "model", "lanes", "order")
    return jax.jit(_march, static_argnames=static, compiler_options=compiler_options(platform))


def respond_batch(
    blocks: Block,
    restitution: Number,
    motion: Motion | Suite,
    duration: Number | None = None,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float | None = None,
) -> BatchResponse:
    """Response of many blocks, from rest, on the grid of the input.

    Everything broadcasts: blocks, restitutions, durations, the amplitude, duration and
    start of a pulse, the amplitude, frequency and start of a `Harmonic`, the scale, time step
    and start of a `Record`, and the leading axes of its samples. What one block does is the
    same whatever else is in the batch.

    Parameters
    ----------
    blocks : Block
    restitution : array_like
        C [-], between 0 and 1.
    motion : Motion or Suite
        A pulse, a `Harmonic`, a `Record`, or a `Suite`, whose records make the leading axis of
        the results.
    duration : array_like, optional
        How long to follow each block [s], greater than 0; by default to the end of the motion.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rtol : float, optional
        Relative error of peak rotations that is aimed at; 1e-9 by default, 1e-5 in float32.
        Where impacts amplify errors, more is left: `respond_within` says of which blocks.

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
    By Taylor polynomials, each as long as its last terms allow: a pulse enters by its own
    series, a harmonic motion by one for each period, a record by one line from sample to
    sample. Outside of transformations, the batch is shared out to the devices, or to the cores
    of a processor. Has forward-mode derivatives.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> pulses = jr.Sine(amplitude=jnp.array([2.5, 3.5, 4.5]), duration=0.5)
    >>> response = jr.respond_batch(jr.Block(half_width=0.1, slenderness=5.0), 0.9, pulses)
    >>> print(*(f"{peak:.3f} rad" for peak in response.peak_rotation), response.overturned)
    0.044 rad 0.069 rad 0.077 rad [False  True  True]
    """
    restitution, duration = check_batch(blocks, restitution, motion, duration)
    if rtol is not None:
        check("rtol", as_real("rtol", rtol), POSITIVE)
    batch = Batch.of(blocks, restitution, motion, duration)
    response = follow_batch(batch, as_model(model), rtol)
    return response if batch.traced else jax.device_put(response)


def check_batch(
    blocks: Block, restitution: Number, motion: Motion | Suite, duration: Number | None
) -> tuple[Reals, Reals | None]:
    """Check the arguments of `respond_batch`, and return restitution and duration as arrays."""
    check_kind("blocks", blocks, Block)
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    restitution = as_real("restitution", restitution)
    check("restitution", restitution, UNIT_INTERVAL)
    if duration is not None:
        duration = as_real("duration", duration)
        check("duration", duration, POSITIVE)
    single = motion[0] if isinstance(motion, Suite) else motion  # whose shape all records have
    check_shapes(blocks=blocks, restitution=restitution, motion=single, duration=duration)
    return restitution, duration


def follow_batch(
    batch: Batch, model: RockingModel, rtol: float | None = None, count: Any = None
) -> BatchResponse:
    """`respond_batch` of what has been checked; in NumPy where it is concrete.

    In a transformation only the first `count` blocks need be followed.
    """
    dtype = batch.dtype
    if rtol is None:
        rtol = 1e-9 if dtype == np.float64 else 1e-5
    share = _SHARE if rtol >= _TIGHT else _SHARE_OF_TIGHT
    tolerance = np.asarray(max(share * rtol, float(jnp.finfo(dtype).eps)), dtype)
    rows, form = batch.rows()
    order = _ORDERS[type(batch.ground.parts[0])][dtype.itemsize]
    static = {"form": form, "model": model, "order": order}
    if batch.traced:
        (part,) = batch.ground.parts
        # The samples of a record may be all that is traced.
        part, rows = jax.tree.map(jnp.asarray, (part, rows))
        count = rows.shape[1] if count is None else count
        result = _march(part, rows, count, tolerance, lanes=_LANES, **static)
    else:
        result = _in_parts(batch.ground, rows, tolerance, static)
    shape = batch.shape
    return jax.tree.map(lambda leaf: leaf.reshape(shape), result)


def _in_parts(
    ground: GroundMotions, rows: Any, tolerance: Any, static: dict[str, Any]
) -> BatchResponse:
    """`_march` of all columns, under one group of records after the other; NumPy arrays."""
    if not ground.begins[1:]:
        return _shared_out(ground.parts[0], rows, tolerance, static)
    group = np.searchsorted(ground.begins, rows[-1], side="right") - 1
    separate = []
    places = []
    for k, part in enumerate(with_progress(ground.parts, "groups of records")):
        (place,) = np.nonzero(group == k)
        own = rows[:, place]
        own[-1] -= ground.begins[k]
        separate.append(_shared_out(part, own, tolerance, static))
        places.append(place)
    order = np.argsort(np.concatenate(places))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[order], *separate)


def _shared_out(
    ground: PulseInput | RecordInput, rows: Any, tolerance: Any, static: dict[str, Any]
) -> BatchResponse:
    """`_march` of all columns, on all devices or processors; NumPy arrays."""
    default = jax.config.jax_default_device
    if default is None:
        devices = jax.local_devices()
    else:  # which may be the name of a platform
        named = isinstance(default, str)
        devices = jax.local_devices(backend=default) if named else [default]
    on_processor = devices[0].platform == "cpu"
    workers = processors() if on_processor else len(devices)
    size = rows.shape[1]
    alone = _ALONE[type(ground)] if on_processor else 1
    if isinstance(ground, PulseInput):
        alone = max(alone // int(ground.intervals), 1)
    share = max(-(-size // workers), alone)
    room = 1 << (share - 1).bit_length()
    lanes = share
    if on_processor:
        # One shape, so that one program is compiled; the same share for each worker.
        share = -(-share // -(-share // _ROOM))
        room = _ROOM
        lanes = _LANES
    march = _compiled(devices[0].platform)
    pieces = max(1, -(-size // share))
    order = np.arange(size)
    if isinstance(ground, RecordInput):
        # Long records first, so that no lane begins one when the others have nothing left.
        intervals = np.asarray(ground.intervals)[rows[-1].astype(int)]
        order = np.argsort(-intervals, kind="stable")

    def on_device(k: int) -> BatchResponse:
        part = rows[:, order[k::pieces]]
        count = part.shape[1]
        queue = np.ones((len(rows), room), rows.dtype)
        queue[:, :count] = part
        placed = ground, queue
        if len(devices) > 1 or not on_processor:
            placed = jax.device_put(placed, devices[k % len(devices)])
        result = march(*placed, count, tolerance, lanes=lanes, **static)
        return jax.tree.map(lambda leaf: leaf[:count], jax.device_get(result))

    separate = mapped(on_device, range(pieces), min(workers, pieces))

    def put_together(*parts: np.ndarray) -> np.ndarray:
        whole = np.empty(size, parts[0].dtype)
        for k, part in enumerate(parts):
            whole[order[k::pieces]] = part
        return whole

    return jax.tree.map(put_together, *separate)
