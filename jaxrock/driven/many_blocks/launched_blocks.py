"""What becomes of blocks that are launched near a steady motion on a harmonic floor."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...block import Block
from ...ground_motion import Harmonic
from ...resonance import RockingModel
from ...validation import Number, Reals
from ..overturning_criterion import TOPPLED_ROTATION
from .batch import ground_of
from .ground_inputs import PulseInput
from .respond_many import compiler_options
from .step import Case, Lanes, max_steps, take_step

_LANES = 64
# those of `respond_batch` at its usual tolerance
_ORDER = 14
_TOLERANCE = 5e-11


def peak_after_launch(
    block: Block,
    restitution: Number,
    motion: Harmonic,
    phase: Number,
    velocity: Number,
    model: RockingModel,
) -> np.ndarray:
    """Peak rotations of blocks until the motion ends [rad]; NumPy, one-dimensional.

    Launched to the positive side with a velocity [rad/s] at a phase [rad] of the first period.
    At most `TOPPLED_ROTATION`; NaN where the motion could not be followed to its end.
    """
    ground = ground_of(motion)
    time = np.mod(phase, 2 * np.pi) / np.asarray(motion.frequency)
    arguments = (block, restitution, *ground.numbers)
    leaves, form = jax.tree.flatten((arguments, time, velocity))
    size = np.size(time)
    groups = max(1, -(-size // _LANES))
    # A power of two, so that few programs are compiled; the rest are blocks that there are.
    room = (1 << (groups - 1).bit_length()) * _LANES
    rows = np.stack([np.resize(np.broadcast_to(leaf, (size,)), room) for leaf in leaves])
    rows = rows.reshape(len(leaves), -1, _LANES).swapaxes(0, 1)
    follow = _compiled(jax.default_backend())
    peaks = follow(ground.parts[0], rows, groups, form=form, model=model)
    return np.asarray(peaks).reshape(-1)[:size]


def _follow(
    ground: PulseInput, rows: Any, groups: Any, form: Any, model: RockingModel
) -> Reals:
    """Return the first groups of rows, one after the other."""

    def group(number: Any, peaks: Reals) -> Reals:
        arguments, time, velocity = jax.tree.unflatten(form, list(rows[number]))
        case = Case.of(ground, arguments, model)
        dtype = time.dtype
        steps_of = case.for_steps()
        tolerance = jnp.asarray(max(_TOLERANCE, float(jnp.finfo(dtype).eps)), dtype)
        begin = Lanes.at_rest(jnp.zeros(_LANES, jnp.int32), dtype)._replace(
            along=time / case.unit,
            velocity=velocity * case.unit,
            moves=jnp.ones(_LANES, bool),
        )
        end = jax.lax.while_loop(
            lambda lanes: lanes.active(steps_of).any(),
            lambda lanes: take_step(lanes, steps_of, ground, tolerance, _ORDER),
            begin,
        )
        followed = case.valid() & (end.steps < max_steps(case))
        peak = jnp.where(followed, jnp.minimum(end.peak, TOPPLED_ROTATION), jnp.nan)
        return peaks.at[number].set(peak)

    return jax.lax.fori_loop(0, groups, group, jnp.zeros(rows[:, 0].shape, rows.dtype))


@functools.cache
def _compiled(platform: str) -> Callable[..., Reals]:
    options = compiler_options(platform)
    return jax.jit(_follow, static_argnames=("form", "model"), compiler_options=options)
