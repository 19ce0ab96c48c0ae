"""Levels from which on records lift blocks, in closed form."""

import jax
import numpy as np

from ..block import Block
from ..driven import RecordVariants, uplift_acceleration
from ..grids import apply_padded
from ..ground_motion import Suite
from ..resonance import RockingModel
from ..validation import AnyArray


def find_uplift_levels(
    block: Block,
    motions: Suite | RecordVariants,
    intensities: AnyArray,
    model: RockingModel,
) -> np.ndarray:
    """Find the level from which on each record lifts each block, on the host.

    As `uplift_factor`: where the horizontal acceleration exceeds (g + vertical) tan(alpha_c).

    Parameters
    ----------
    block : Block, shape (blocks,)
    motions : Suite or RecordVariants
        As they are; the variants are those of the blocks.
    intensities : array_like, shape (records,) or (records, blocks)
        Their measure.
    model : Nonlinear or Linearized

    Returns
    -------
    ndarray, shape (records, blocks)
        Infinite where a record lifts a block with no factor.
    """
    needed = apply_padded(
        lambda padded: uplift_acceleration(jax.device_put(padded), model), block
    )
    tangent = needed / np.asarray(block.gravity)
    variants = np.zeros(needed.size, int)
    if isinstance(motions, RecordVariants):
        variants = np.ravel(motions.which).astype(int)
    strength = np.empty((len(motions.records), needed.size))
    for k, record in enumerate(motions.records):
        scale = np.asarray(record.scale)
        push = np.atleast_2d(scale * np.asarray(record.acceleration))
        outward = push if block.one_sided else abs(push)
        largest = outward.max(axis=-1)[variants]
        if record.vertical is not None:
            lift = np.broadcast_to(scale * np.asarray(record.vertical), push.shape)
            pairs = zip(variants, tangent, strict=True)
            largest = np.array([(outward[v] - share * lift[v]).max() for v, share in pairs])
        # A pulse into the wall ends with a push away from it that is mere rounding.
        rounding = 64 * np.finfo(push.dtype).eps * block.one_sided
        strength[k] = np.where(largest > rounding * abs(push).max(), largest, 0)
    with np.errstate(divide="ignore"):
        factors = needed / strength
    return factors * np.asarray(intensities).reshape(len(strength), -1)
