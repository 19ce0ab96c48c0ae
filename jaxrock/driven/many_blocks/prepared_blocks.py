"""The numbers of the blocks of a batch, and what follows from them once for all steps."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ... import impact
from ...block import Block
from ...resonance import RockingModel
from ...validation import Booleans, Reals
from ..equation import Equation
from ..scene import UP_TO_ITS_SIDE, is_before_wall
from .flight import LONGEST_STEP
from .ground_input import Excitation, GroundInput, HostNumbers, PerBlock, rounding_margin
from .initial_state import InitialState
from .taylor import tilt_sine_cosine

# The answers of which derivatives may be wanted, as a real like all other numbers.
PEAK_ROTATION, ROTATION_RATIO, MARGIN = 0.0, 1.0, 2.0


class StepControl(NamedTuple):
    """The length of each step of a block, and the terms of its polynomial that count.

    A step ends at the next sample of a record, however loose the tolerance. So a tolerance
    alone does not make two motions whose steps differ; companions, which omit terms, do.
    """

    tolerance: HostNumbers  # of the last two terms of a polynomial, relative to its first ones
    companion: HostNumbers  # 1 or 2 for a companion of `to_tolerance`, 0 for a response


class BatchArguments(NamedTuple):
    """The numbers of each block of a batch; arrays of one type that broadcast."""

    control: StepControl
    block: Block
    restitution: HostNumbers
    factor: HostNumbers  # on the motion: its amplitude or scale
    length: HostNumbers  # of an interval [s]
    start: HostNumbers  # of the motion [s]
    duration: HostNumbers  # for which the block is followed [s]
    rotation: HostNumbers | None  # initial, signed [rad]; None, like the velocity, at rest
    velocity: HostNumbers | None  # initial, signed [rad/s]
    # Index of the motion, where there are several; a real as all the others.
    motion: HostNumbers
    # What derivatives are wanted of, and how these numbers move with each parameter.
    answer: HostNumbers | None = None
    directions: tuple["BatchArguments", ...] | None = None


class Case(eqx.Module):
    """The numbers of a block that all steps need, in its unit of time."""

    equation: Equation
    ground_sine: PerBlock  # of the tilt alpha_c - rotation, on the ground
    ground_cosine: PerBlock
    longest_free_step: PerBlock  # behind the end of the input
    restitution: PerBlock
    bounces: PerBlock  # sum of 1 + C^2 + C^4 + ..., or 1 where that is infinite
    start: PerBlock  # of the motion
    duration: PerBlock
    excitation: Excitation
    control: StepControl
    answer: PerBlock | None  # None where no derivatives are asked for


class PreparedBlocks(NamedTuple):
    """Blocks as they are followed, with the unit and validity that the answers need."""

    case: Case
    initial: InitialState | None  # None for blocks that begin at rest
    unit: Reals  # of time [s]
    valid: Booleans  # whether all arguments are allowed


def prepare_blocks(
    ground: GroundInput, arguments: BatchArguments, model: RockingModel
) -> PreparedBlocks:
    """Compute what follows from the arguments once for all steps, elementwise."""
    motion = jnp.asarray(arguments.motion).astype(jnp.int32)
    restitution = jnp.asarray(arguments.restitution)
    equation = Equation.of(arguments.block, model)
    angle = equation.critical_angle
    strength = jnp.asarray(arguments.factor) / equation.gravity
    length = jnp.asarray(arguments.length)
    rate = ground.find_rate(length)
    natural = jnp.sqrt(equation.p_squared)

    # The unit is arbitrary, so that no derivative depends on it.
    unit = jax.lax.stop_gradient(1 / ground.find_fastest(natural, rate))
    equation = dataclasses.replace(
        equation,
        p_squared=equation.p_squared * unit * unit,
        critical_velocity=equation.critical_velocity * unit,
        velocity_unit=None if impact.LAW.linear else 1 / unit,
    )
    rate = rate * unit
    length = length / unit
    start = jnp.asarray(arguments.start) / unit
    duration = jnp.asarray(arguments.duration) / unit

    # By rounding alone no block is lifted, as in `GroundInput.find_uplift`.
    needed = equation.tangent / jnp.abs(strength)
    uplift_times = ground.find_uplift_times(rate, needed * (1 + rounding_margin(rate.dtype)))
    if ground.has_vertical:
        # The grade is about the larger of both components. If s is the larger of abs(push) and
        # abs(lift), uplift needs s > (1 - s) tangent, and so s > tangent / (1 + tangent).
        needed = needed / (1 + equation.tangent)
    first_interval, intervals = ground.find_intervals(motion)
    excitation = Excitation(
        strength=strength,
        length=length,
        rate=rate,
        first_interval=first_interval,
        intervals=intervals,
        grade=ground.choose_grade(needed),
        uplift_times=uplift_times,
    )

    # A sum is finite only if all its terms are: one test serves all.
    total = equation.p_squared + equation.tangent + strength + start
    finite = jnp.isfinite(total + restitution + length + duration) & ground.is_finite(motion)
    positive = (equation.p_squared > 0) & (length > 0) & (duration > 0)
    valid = finite & positive & (restitution >= 0) & (restitution <= 1)
    initial = None
    if arguments.rotation is not None and arguments.velocity is not None:
        rotation = jnp.asarray(arguments.rotation)
        velocity = jnp.asarray(arguments.velocity) * unit
        valid = valid & UP_TO_ITS_SIDE.contains(rotation) & jnp.isfinite(velocity)
        if equation.one_sided:
            valid = valid & is_before_wall(rotation, velocity)
        # A block that is not valid rests, so that it is done soon.
        rotation = jnp.where(valid, rotation, 0)
        velocity = jnp.where(valid, velocity, 0)
        initial = InitialState.of(equation, rotation, velocity, start)

    ground_sine, ground_cosine = tilt_sine_cosine(equation, angle)
    case = Case(
        # Without numbers that no step needs: what a loop carries costs time.
        equation=eqx.tree_at(lambda e: (e.gravity, e.inertia_ratio), equation, (None, None)),
        ground_sine=ground_sine,
        ground_cosine=ground_cosine,
        longest_free_step=LONGEST_STEP / (natural * unit),
        restitution=restitution,
        bounces=1 / jnp.where(restitution < 1, (1 - restitution) * (1 + restitution), 1),
        start=start,
        duration=duration,
        excitation=excitation,
        control=jax.lax.stop_gradient(arguments.control),
        answer=None if arguments.answer is None else jnp.asarray(arguments.answer),
    )
    return PreparedBlocks(case, initial, unit, valid)
