"""The numbers of the blocks of a batch, and what follows from them once for all steps."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ... import impact
from ...resonance import RockingModel
from ...validation import Booleans, Reals
from ..equation import Equation
from ..scene import UP_TO_ITS_SIDE, is_before_wall
from .batch import Batch, StepControl
from .flight import LONGEST_STEP
from .ground_input import Excitation, PerBlock
from .ground_motions import GroundInput
from .taylor import tilt_sine_cosine

# The answers of which derivatives may be wanted.
PEAK_ROTATION, ROTATION_RATIO, MARGIN = 0.0, 1.0, 2.0


class InitialState(NamedTuple):
    """The state of each block at time 0, from the side on which it stands."""

    side: PerBlock  # 1 or -1
    rotation: PerBlock
    velocity: PerBlock
    elapsed: PerBlock  # time since the start of the motion; negative before it

    @classmethod
    def of(
        cls, equation: Equation, rotation: Reals, velocity: Reals, start: Reals
    ) -> "InitialState":
        """Take the side from the sign of the rotation, or where that is 0 of the velocity."""
        towards = jnp.where(rotation == 0, velocity, rotation)
        side = jnp.where(towards < 0, -1, 1).astype(towards.dtype)
        rotation = side * rotation
        velocity = side * velocity

        # A start at time 0 cannot move to an earlier time. The derivative is for a later start,
        # as in `respond`: until then the block moves freely, for a delay that is 0 and has a
        # derivative. The terms of second order serve second derivatives.
        begins = start == 0
        delay = start - jax.lax.stop_gradient(start)
        delay = jnp.where(begins & (towards != 0), delay, 0)
        tilt = equation.critical_angle - rotation - 0.5 * delay * velocity
        push = jnp.zeros_like(tilt)
        acceleration = equation.right_hand_side(*tilt_sine_cosine(equation, tilt), push, 0.0)
        return cls(
            side=side,
            rotation=rotation + delay * (velocity + 0.5 * delay * acceleration),
            velocity=velocity + delay * acceleration,
            elapsed=jnp.where(begins, 0, -start),
        )


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
    ground: GroundInput, arguments: Batch, model: RockingModel
) -> PreparedBlocks:
    """Compute what follows from the arguments once for all steps, elementwise."""
    numbers = arguments.ground
    motion = jnp.asarray(numbers.motion).astype(jnp.int32)
    restitution = jnp.asarray(arguments.restitution)
    equation = Equation.of(arguments.block, model)
    angle = equation.critical_angle
    strength = jnp.asarray(numbers.factor) / equation.gravity
    length = jnp.asarray(numbers.length)
    rate = ground.find_rate(length)
    natural = jnp.sqrt(equation.p_squared)

    # The unit is arbitrary, so that no derivative depends on it. With the faster rate of block
    # and pulse, the coefficients of both series stay of order 1; the steps under a record are
    # short in any case.
    fastest = natural if ground.intervals_end_steps else jnp.maximum(natural, jnp.abs(rate))
    unit = jax.lax.stop_gradient(1 / fastest)
    equation = dataclasses.replace(
        equation,
        p_squared=equation.p_squared * unit * unit,
        critical_velocity=equation.critical_velocity * unit,
        velocity_unit=None if impact.LAW.linear else 1 / unit,
    )
    length = length / unit
    start = jnp.asarray(numbers.start) / unit
    duration = jnp.asarray(arguments.until) / unit
    excitation, ground_is_finite = ground.excite(
        motion, strength, length, rate * unit, equation.tangent
    )

    # A sum is finite only if all its terms are: one test serves all.
    total = equation.p_squared + equation.tangent + strength + start
    finite = jnp.isfinite(total + restitution + length + duration) & ground_is_finite
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
