"""The factor on a motion that just lifts a block."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..driven import uplift_acceleration
from ..ground_motion import Harmonic, Motion, Pulse, Record
from ..numerics import pick_largest
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Reals, check, check_kind, elementwise


def uplift_factor(block: Block, motion: Motion, *, model: ModelLike = Nonlinear()) -> Reals:
    """Compute the smallest factor with which a motion lifts the block from rest.

    With a larger factor the horizontal acceleration at some time exceeds (g + vertical)
    tan(alpha_c), or (g + vertical) alpha_c with `Linearized`: to either side, or away from
    the wall of a one-sided block. The factor multiplies both components.

    Parameters
    ----------
    block : Block
    motion : Motion
        One pulse, `Harmonic` or `Record`.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    Array, shape (...)
        Factor [-], of the shape of `block`; inf where no factor lifts it. Has derivatives in
        both modes.

    Raises
    ------
    ValueError
        If `motion` is no motion, or an array of them, or a concrete number is out of range. A
        traced one gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> factor = jr.overturning.uplift_factor(jr.Block(0.3, 3.0), jr.example_record())
    >>> print(f"{factor:.3f}")
    0.653
    """
    check_single(motion)
    uplift = _describe_uplift(block, model)
    return _divide_by_strength(*uplift, motion.bucketed(), one_sided=block.one_sided)


def check_single(motion: Motion) -> None:
    """Check that a motion is one pulse, `Harmonic` or `Record`; a `ValueError` if not."""
    check_kind("motion", motion, Pulse, Harmonic, Record)
    shapes = {jnp.shape(x) for x in jax.tree.leaves(motion)}
    # The samples of a record are an axis of their own, of one record.
    shapes -= {(motion.samples,)} if isinstance(motion, Record) else set()
    if array := next((shape for shape in shapes if shape), None):
        raise ValueError(f"motion must be a single motion, got an array of shape {array}")
    check("motion", motion, None)


@elementwise(model=as_model)
def _describe_uplift(block: Block, model: ModelLike) -> tuple[Reals, Reals]:
    """Compute the acceleration that lifts a block [m/s2], and its ratio to gravity."""
    needed = uplift_acceleration(block, as_model(model))
    return needed, needed / block.gravity


@eqx.filter_jit
def _divide_by_strength(
    needed: Reals, tangent: Reals, motion: Motion, *, one_sided: bool
) -> Reals:
    """Divide the acceleration that lifts the block by the largest one of a motion."""
    # For a block that is not allowed, NaN is replaced by 1, so that derivatives are 0.
    valid = ~jnp.isnan(needed)
    needed, tangent = (jnp.where(valid, x, 1) for x in (needed, tangent))
    # Between knots the horizontal acceleration is monotone. Under a record both components are
    # lines there, and other motions have no vertical one: the excess is extreme at knots.
    knots = motion.knots()
    # The axes of blocks come first.
    shape = (1,) * needed.ndim + knots.shape
    push, lift = (x.reshape(shape) for x in motion.value(knots))
    outward = push if one_sided else abs(push)
    strength = pick_largest(outward - tangent[..., None] * lift)
    # A pulse into the wall ends with a push away from it that is mere rounding.
    rounding = 64 * float(jnp.finfo(strength.dtype).eps)
    least = rounding * jnp.max(abs(push), axis=-1) if one_sided else 0
    lifts = strength > least
    factor = jnp.where(lifts, needed / jnp.where(lifts, strength, 1), jnp.inf)
    return jnp.where(valid, factor, jnp.nan)
