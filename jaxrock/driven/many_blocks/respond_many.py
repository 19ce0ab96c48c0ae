"""Driven motion of many blocks at once, shared out to devices or processors."""

import functools
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...block import Block
from ...ground_motion import Harmonic, Motion, Pulse, Record, Suite
from ...host import (
    Printed,
    Status,
    count_processors,
    count_work,
    format_fields,
    map_in_threads,
)
from ...impact import read_restitution
from ...numerics import transpose_by
from ...resonance import ModelLike, Nonlinear, RockingModel, as_model
from ...validation import (
    FINITE,
    POSITIVE,
    AnyArray,
    Booleans,
    Integers,
    Number,
    Reals,
    as_real,
    check,
    check_kind,
    check_shapes,
)
from ..overturning_criterion import TOPPLED_ROTATION, free_motion_margins, pick_smaller_margin
from ..scene import UP_TO_ITS_SIDE, check_initial_state
from .batch import Batch
from .coincidences import AnswerEvents, Nearest
from .ground_input import HostReals
from .ground_motions import GroundInput
from .prepared_blocks import MARGIN, ROTATION_RATIO, Case, PreparedBlocks, prepare_blocks
from .queue import work_off
from .record_input import RecordInput
from .reverse_sweep import pull_back
from .single_kernels import jit_steps
from .step import Lanes, max_steps, take_step

# On a processor, lanes fill its vectors several times over, and their states its nearest
# cache.
_LANES = 64
# The queue has one size there, so that one program serves batches of all sizes.
_ROOM = 2048
_INITIAL = {"rotation": UP_TO_ITS_SIDE, "velocity": FINITE}


class _Program(NamedTuple):
    """The facts that a program is compiled for, beside the kind of input."""

    form: Hashable  # of the arguments
    model: RockingModel
    order: int  # of the Taylor polynomials


class SimulatedBatch(NamedTuple):
    """Responses, and sums over impacts by which two motions of a block are compared.

    A sum is of squared velocities before impacts (after impacts all are 0 if C = 0) while the
    input acts, with weights that grow in time from 1 to 2. Trajectories that diverge have other
    impacts, or the same ones at other times. Velocities are in the unit of the batch, which
    depends on the block and the kind of input alone.
    """

    response: "BatchResponse"
    impact_sum: Reals
    impact_unit: Reals  # square of the velocity before an impact that sends it to its peak
    # A `SimulatedAnswer` where derivatives or coincidences are wanted, and its slopes, which have
    # an axis for the parameters behind that of the blocks.
    answer: Any = None
    slopes: Any = None


class SimulatedAnswer(NamedTuple):
    """An answer, and the events from which it comes."""

    # NaN for the peak of a block that overturns, and the margin of one that topples before the
    # input ends.
    value: Reals
    # By which the highest top exceeds the second one, as a fraction, or the larger of both margins
    # the smaller.
    gap: Reals
    impact_sum: Reals  # with derivatives
    events: AnswerEvents
    # The nearest coincidences behind those of the events: where another top becomes the highest,
    # or the other of both margins the smaller one, and where the block overturns.
    change: Nearest
    overturning: Nearest


class BatchResponse(Printed, eqx.Module):
    """Responses of many blocks; see `respond_batch`. All arrays have the shape of the batch.

    Attributes
    ----------
    peak_rotation : Array
        Largest abs(alpha) [rad], at most pi / 2.
    final_rotation, final_velocity : Array
        Rotation [rad] and angular velocity [rad/s] at the end of the duration, or of the step
        in which the block reached pi / 2.
    overturned : Array of bool
        As in `Response`.
    margin : Array
        `free_motion_margin` at the end of the input [-].
    impacts : Array of int
        Number of impacts, without the infinitely many in which a block comes to rest.
    mode : Array of int
        Number of impacts before overturning; -1 for a block that stands. One impact may come
        after the end of the input, if the block then overturns on the other side.
    status : Array of int
        A `jaxrock.Status`: COMPLETE, or else STOPPED or INVALID, with NaN instead of numbers.
    """

    peak_rotation: Reals
    final_rotation: Reals
    final_velocity: Reals
    overturned: Booleans
    margin: Reals
    impacts: Integers
    mode: Integers
    status: Integers

    # Of NumPy in what rooms of the inside simulate; see `follow_batch`.
    @property
    def complete(self) -> AnyArray | np.bool_:
        """True where the status is COMPLETE."""
        return self.status == Status.COMPLETE

    def __str__(self) -> str:
        return format_fields(
            self,
            overturned="",
            margin="",
            peak_rotation="rad",
            final_rotation="rad",
            final_velocity="rad/s",
            impacts="",
        )


def _follow_rows(
    ground: GroundInput,
    rows: Reals,
    count: Integers | int,
    program: _Program,
    lanes: int,
    final: Lanes | None = None,
) -> SimulatedBatch:
    """Follow the blocks of the first `count` columns, whose rows are their arguments.

    Or only make the answers, if the `final` states are given.
    """
    arguments: Batch = jax.tree.unflatten(program.form, list(rows))
    directions = arguments.directions
    arguments = replace(arguments, directions=None)
    if directions is None:
        return _follow(ground, arguments, count, program, lanes, final)
    along = jax.tree.map(lambda *leaves: jnp.stack(leaves), *directions)
    moves = jax.tree.map(
        lambda part: part is not None, along, is_leaf=lambda part: part is None
    )
    moving, fixed = eqx.partition(arguments, moves)

    def follow(moving: Batch) -> tuple[SimulatedAnswer, SimulatedBatch]:
        simulated = _follow(ground, eqx.combine(moving, fixed), count, program, lanes)
        return simulated.answer, simulated

    def differentiate(along: Batch) -> tuple[SimulatedAnswer, SimulatedBatch]:
        return jax.jvp(follow, (moving,), (along,), has_aux=True)[1:]

    slopes, simulated = jax.vmap(differentiate, out_axes=(-1, None))(along)
    return simulated._replace(slopes=slopes)


def _follow(
    ground: GroundInput,
    arguments: Batch,
    count: Integers | int,
    program: _Program,
    lanes: int,
    final: Lanes | None = None,
) -> SimulatedBatch:
    """Follow the first `count` blocks, as `_follow_rows` does."""
    case, initial, unit, valid = prepare_blocks(ground, arguments, program.model)

    def step(lanes: Lanes, case: Case) -> Lanes:
        return take_step(lanes, case, ground, program.order)

    if final is None:
        watched = case.answer is not None
        final = work_off(ground, case, initial, count, lanes, step, watched)
    finished = final.steps.astype(jnp.int32) < max_steps(case)
    # In as few bytes as a boolean: statuses of large batches are copied like all else.
    status = jnp.where(finished, Status.COMPLETE, Status.STOPPED)
    status = jnp.where(valid, status, Status.INVALID).astype(jnp.int8)
    complete = status == Status.COMPLETE
    before_impact, after_impact = free_motion_margins(
        case.equation, case.restitution, final.end_rotation, final.end_velocity
    )
    margin = pick_smaller_margin(before_impact, after_impact)
    toppled = final.peak >= TOPPLED_ROTATION
    overturned = complete & (toppled | (margin < 0))
    # It overturns on the other side after one more impact, which may fall after the end of the
    # input. So impacts are counted where the criterion is read.
    at_once = (final.end_rotation >= TOPPLED_ROTATION) | (before_impact < 0)
    mode = final.end_impacts.astype(int) + jnp.where(at_once, 0, 1)

    def where_complete(value: Reals) -> Reals:
        return jnp.where(complete, value, jnp.nan)

    response = BatchResponse(
        peak_rotation=where_complete(jnp.minimum(final.peak, TOPPLED_ROTATION)),
        final_rotation=where_complete(final.side * final.rotation),
        final_velocity=where_complete(final.side * final.velocity / unit),
        overturned=overturned,
        margin=where_complete(margin),
        impacts=final.impacts.astype(int),
        mode=jnp.where(overturned, mode, -1),
        status=status,
    )
    # From beyond the critical angle a block has no velocity of free motion.
    highest = jnp.minimum(final.peak, case.equation.critical_angle)
    leaving = case.equation.landing_velocity(highest, jnp.zeros_like(highest))
    # What an impact absorbs has no effect on the motion: the limits of `to_tolerance` are for
    # the velocity that it leaves, if it leaves any.
    arriving = leaving / jnp.maximum(case.restitution, 0.25)
    sums = jax.lax.stop_gradient((final.impact_sum / case.duration, arriving * arriving))
    simulated = SimulatedBatch(response, *sums)
    coincidences = final.coincidences
    if coincidences is None:
        return simulated
    peak = jnp.where(overturned, jnp.nan, response.peak_rotation)
    ratio = peak / arguments.block.critical_angle
    is_peak = case.answer != MARGIN
    events = coincidences.answer
    value = jnp.where(case.answer == ROTATION_RATIO, ratio, peak)
    zero = jnp.zeros_like(peak)
    none = Nearest(zero, zero)
    gap = jnp.where(
        is_peak,
        final.peak - coincidences.find_second_peak(),
        jnp.abs(after_impact - before_impact),
    )
    return simulated._replace(
        answer=SimulatedAnswer(
            # The margin of a block that topples is that of the step in which it does.
            value=jnp.where(
                is_peak,
                value,
                jnp.where(final.end_rotation < TOPPLED_ROTATION, response.margin, jnp.nan),
            ),
            gap=gap / jnp.where(is_peak & (final.peak > 0), final.peak, 1),
            impact_sum=final.impact_sum,
            events=events._replace(lifted=events.lifted * unit),
            change=jax.tree.map(
                lambda rate: jnp.where(is_peak, rate, 0), coincidences.later
            ).include(gap, complete),
            overturning=none.include(margin, is_peak).include(
                arguments.block.critical_angle - final.peak, is_peak
            ),
        )
    )


@functools.partial(jax.jit, static_argnames="program")
def _pull_rows(
    inputs: tuple[GroundInput, Reals], cotangents: SimulatedBatch, program: _Program
) -> PyTree:
    """Pull cotangents of answers back to the input and the rows, for reverse mode."""
    ground, rows = inputs

    def prepare(rows: Reals) -> PreparedBlocks:
        arguments = jax.tree.unflatten(program.form, list(rows))
        return prepare_blocks(ground, arguments, program.model)

    def answer(rows: Reals, final: Lanes) -> SimulatedBatch:
        return _follow_rows(ground, rows, 0, program, 0, final)

    return pull_back(ground, rows, cotangents, program.order, prepare, answer)


# Inside of transformations, where options of the compiler are not allowed. Without this, the
# loop would be compiled for every derivative again.
_follow_rows_jitted = jax.jit(_follow_rows, static_argnames=("program", "lanes"))


@functools.cache
def _compile(platform: str) -> Callable[..., SimulatedBatch]:
    """Jit `_follow_rows` for a platform, once in a process."""
    return jit_steps(_follow_rows, platform, ("program", "lanes"))


def respond_batch(
    blocks: Block,
    restitution: Number,
    motion: Motion | Suite,
    duration: Number | None = None,
    *,
    rotation: Number | None = None,
    velocity: Number | None = None,
    model: ModelLike = Nonlinear(),
    rtol: float | None = None,
) -> BatchResponse:
    """Compute the responses of many blocks, each in time steps of its own.

    Everything broadcasts: blocks, restitutions, durations, initial states, the numbers of a
    pulse or a `Harmonic`, the scale, time step and start of a `Record`, and the leading axes of
    its samples. The response of a block does not depend on what else is in the batch.

    Parameters
    ----------
    blocks : Block
    restitution : array_like
        C [-], between 0 and 1; of one-sided blocks its magnitude counts.
    motion : Motion or Suite
        A pulse, a `Harmonic`, a `Record`, or a `Suite`, whose records make the leading axis of
        the results.
    duration : array_like, optional
        Simulated time [s], greater than 0; by default to the end of the motion.
    rotation, velocity : array_like, optional
        Initial rotation [rad] and angular velocity [rad/s]; at rest by default. If either is
        given, even as 0, another program is compiled.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rtol : float, optional
        Tolerance of each step, 1e-9 by default (1e-5 in float32). The last two terms of the
        step's polynomial are at most rtol / 20 times the first ones (rtol / 50 below 1e-10),
        as far as rounding allows. `rtol` controls the error of a step, not of an answer:
        impacts amplify errors, up to a million times and more. A step ends at a sample of a
        record at the latest. Where samples are close, as in most records, the steps for 1e-3
        and 1e-7 are the same, and so are the answers: their agreement proves nothing.
        `respond_within` estimates the error of each answer.

    Returns
    -------
    BatchResponse

    Raises
    ------
    ValueError
        If a concrete argument is not allowed, or shapes do not broadcast. Traced values that
        are out of range give NaN.

    Notes
    -----
    Each step is a Taylor polynomial, as long as its last terms allow. A pulse enters by its own
    Taylor series, a harmonic motion by one for each period, a record by a line between samples.
    Outside of transformations, the batch is distributed over the devices, or over the cores of
    a processor. Derivatives exist in both modes, in reverse mode by one sweep backwards along
    the steps of each block.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> pulses = jr.Sine(amplitude=jnp.array([2.5, 3.5, 4.5]), duration=0.5)
    >>> response = jr.respond_batch(jr.Block(half_width=0.1, slenderness=5.0), 0.9, pulses)
    >>> print(*(f"{peak:.3f} rad" for peak in response.peak_rotation), response.overturned)
    0.044 rad 0.069 rad 0.077 rad [False  True  True]
    """
    initial = {}
    for name, value, unit in (("rotation", rotation, "rad"), ("velocity", velocity, "rad/s")):
        if value is not None:
            initial[name] = as_real(name, value, unit=unit)
    restitution, duration = check_batch(blocks, restitution, motion, duration, **initial)
    if rtol is not None:
        check("rtol", as_real("rtol", rtol), POSITIVE)
    batch = Batch.of(blocks, restitution, motion, duration, rtol=rtol, **initial)
    response = follow_batch(batch, as_model(model))
    return response if batch.traced else jax.device_put(response)


def check_batch(
    blocks: Block,
    restitution: Number,
    motion: Motion | Suite,
    duration: Number | None,
    **initial: Reals,
) -> tuple[Reals, Reals | None]:
    """Check the arguments of `respond_batch`, and return restitution and duration as arrays.

    `initial` are rotation and velocity at time 0 where they are given, as arrays.
    """
    check_kind("blocks", blocks, Block)
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    restitution = read_restitution(blocks, restitution)
    if duration is not None:
        duration = as_real("duration", duration, unit="s")
        check("duration", duration, POSITIVE)
    for name, value in initial.items():
        check(name, value, _INITIAL[name])
    if initial:
        check_initial_state(blocks, initial.get("rotation", 0.0), initial.get("velocity", 0.0))
    single = motion[0] if isinstance(motion, Suite) else motion  # whose shape all records have
    check_shapes(
        blocks=blocks, restitution=restitution, motion=single, duration=duration, **initial
    )
    return restitution, duration


def follow_batch(
    batch: Batch, model: RockingModel, count: Integers | int | None = None
) -> BatchResponse:
    """Follow a batch, as `respond_batch` does once it has checked; in NumPy where concrete.

    In a transformation only the first `count` blocks need be simulated.
    """
    return simulate_batch(batch, model, count).response


def simulate_batch(
    batch: Batch, model: RockingModel, count: Integers | int | None = None
) -> SimulatedBatch:
    """Simulate a batch, and sum over impacts; see `follow_batch`."""
    rows, form = batch.flatten()
    ground = batch.ground.input
    # The order follows from precision and kind of input alone: a program for each tolerance
    # would have to be compiled.
    program = _Program(form, model, ground.orders[batch.dtype.itemsize])
    if batch.traced:
        # The samples of a record may be all that is traced.
        ground, rows = jax.tree.map(jnp.asarray, (ground, rows))
        number = rows.shape[1] if count is None else count
        lanes = min(_LANES, rows.shape[1])
        result = _follow_rows_jitted(ground, rows, number, program=program, lanes=lanes)
        pull = functools.partial(_pull_rows, program=program)
        result = transpose_by((ground, rows), result, pull=pull)
    else:
        result = _share_out(ground, rows, program)
    shape = batch.shape
    return jax.tree.map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), result)


def _share_out(ground: GroundInput, rows: HostReals, program: _Program) -> SimulatedBatch:
    """Follow all columns, on all devices or processors; NumPy arrays."""
    default = jax.config.jax_default_device
    devices = [default]
    if default is None or isinstance(default, str):  # which may be the name of a platform
        devices = jax.local_devices(backend=default)
    on_processor = devices[0].platform == "cpu"
    workers = count_processors() if on_processor else len(devices)
    size = rows.shape[1]

    # An accelerator takes all its blocks as lanes, in a queue of a power of two; each number
    # of lanes is a program.
    fewest = ground.fewest_for_two_threads() if on_processor else 1
    share = max(-(-size // workers), fewest)
    room = 1 << (share - 1).bit_length()
    lanes = share
    if on_processor:
        # One shape, so that one program is compiled; the same share for each worker.
        share = -(-share // -(-share // _ROOM))
        room = _ROOM
        lanes = _LANES
    follow = _compile(devices[0].platform)
    pieces = max(1, -(-size // share))
    order = np.arange(size)
    if isinstance(ground, RecordInput):
        # Long records first, so that no lane begins one when the others have nothing left.
        numbers = jax.tree.unflatten(program.form, list(rows)).ground
        intervals = np.asarray(ground.intervals)[numbers.motion.astype(int)]
        order = np.argsort(-intervals, kind="stable")

    def follow_piece(k: int) -> SimulatedBatch:
        # Every `pieces`-th block: neighbours in a grid take about as long.
        part = rows[:, order[k::pieces]]
        count = part.shape[1]
        queue = np.ones((len(rows), room), rows.dtype)
        queue[:, :count] = part
        placed = (ground, queue)
        if len(devices) > 1 or not on_processor:
            placed = jax.device_put(placed, devices[k % len(devices)])
        result = follow(*placed, count, program=program, lanes=lanes)
        answers = jax.tree.map(lambda leaf: leaf[:count], jax.device_get(result))
        work.update(count)
        return answers

    with count_work("motions", size) as work:
        separate = map_in_threads(follow_piece, range(pieces), min(workers, pieces))

    def put_together(*parts: np.ndarray) -> np.ndarray:
        whole = np.empty((size, *parts[0].shape[1:]), parts[0].dtype)
        for k, part in enumerate(parts):
            whole[order[k::pieces]] = part
        return whole

    return jax.tree.map(put_together, *separate)
