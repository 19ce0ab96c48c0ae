"""Blocks that are launched at some phase of a harmonic motion, and how high they rise."""

import functools
from collections.abc import Callable, Hashable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from ...block import Block
from ...ground_motion import Harmonic
from ...resonance import RockingModel
from ...validation import Integers, Number, Reals
from ..overturning_criterion import TOPPLED_ROTATION
from .compiler_options import jit_steps
from .ground_input import GroundInput
from .ground_motions import convert_motion
from .single_kernels import call_as_one_function
from .step import (
    BatchArguments,
    Case,
    Lanes,
    StepControl,
    max_steps,
    prepare_blocks,
    take_step,
)

_LANES = 64
# As `respond_batch` has them in float64 at its default tolerance.
_ORDER = 14
_TOLERANCE = 5e-11


def follow_launched(
    block: Block,
    restitution: Number,
    motion: Harmonic,
    phase: Number,
    velocity: Number,
    model: RockingModel,
) -> np.ndarray:
    """Find the peak rotations of blocks until the motion ends [rad]; NumPy, one-dimensional.

    Launched to the positive side with a velocity [rad/s] at a phase [rad] of the first period.
    At most `TOPPLED_ROTATION`; NaN where the integration did not finish.
    """
    ground = convert_motion(motion)
    numbers = ground.numbers
    time = np.mod(phase, 2 * np.pi) / np.asarray(motion.frequency)
    arguments = BatchArguments(
        block,
        np.asarray(restitution),
        factor=numbers.factor,
        length=numbers.length,
        start=numbers.start,
        duration=numbers.end,
        motion=numbers.motion,
    )
    leaves, form = jax.tree.flatten((arguments, time, velocity))
    size = np.size(time)
    groups = max(1, -(-size // _LANES))
    # A power of two, so that few programs are compiled; the rest is filled with blocks that
    # there are.
    room = (1 << (groups - 1).bit_length()) * _LANES
    rows = np.stack([np.resize(np.broadcast_to(leaf, (size,)), room) for leaf in leaves])
    rows = rows.reshape(len(leaves), -1, _LANES).swapaxes(0, 1)
    follow = _compile(jax.default_backend())
    peaks = follow(ground.parts[0], rows, groups, form=form, model=model)
    return np.asarray(peaks).reshape(-1)[:size]


def _follow_groups(
    ground: GroundInput,
    rows: Reals,
    groups: Integers,
    form: Hashable,
    model: RockingModel,
) -> Reals:
    """Follow the blocks of the first groups of rows, one group after the other."""

    def follow_group(number: Integers, peaks: Reals) -> Reals:
        arguments, time, velocity = jax.tree.unflatten(form, list(rows[number]))
        case, unit, valid = prepare_blocks(ground, arguments, model)
        dtype = time.dtype
        tolerance = jnp.asarray(max(_TOLERANCE, float(jnp.finfo(dtype).eps)), dtype)
        control = StepControl(tolerance, 1.0, (1.0, 1.0))
        resting = Lanes.at_rest(jnp.zeros(_LANES, jnp.int32), dtype)
        begin = replace(
            resting,
            elapsed=time / unit,
            velocity=velocity * unit,
            moves=jnp.ones(_LANES, bool),
        )

        def take_steps(lanes: Lanes, case: Case) -> Lanes:
            return jax.lax.while_loop(
                lambda lanes: lanes.are_active(case).any(),
                lambda lanes: take_step(lanes, case, ground, control, _ORDER),
                lanes,
            )

        end = call_as_one_function(take_steps, begin, case)
        followed = valid & (end.steps < max_steps(case))
        peak = jnp.where(followed, jnp.minimum(end.peak, TOPPLED_ROTATION), jnp.nan)
        return peaks.at[number].set(peak)

    return jax.lax.fori_loop(0, groups, follow_group, jnp.zeros(rows[:, 0].shape, rows.dtype))


@functools.cache
def _compile(platform: str) -> Callable[..., Reals]:
    """Jit `_follow_groups` for a platform, once in a process."""
    return jit_steps(_follow_groups, platform, ("form", "model"))
