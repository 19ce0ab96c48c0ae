"""Inverse design in closed form: what the paper's pulses just overturn."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..numerics import quotient, quotient_or_infinite, share_of_one
from ..validation import COUNT, NON_NEGATIVE, UNIT_INTERVAL, Number, Reals, elementwise
from .free_rocking import Linearized, ModelLike, as_model


@elementwise(restitution=UNIT_INTERVAL, half_cycles=COUNT, model=as_model)
def critical_intensity(
    block: Block,
    restitution: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Intensity of the pulses that just overturn the block within so many half-cycles.

    Solves ``half_cycle_velocity = critical_velocity`` (Eqs. 2 and 8) for the intensity.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    half_cycles : array_like, optional
        n, a whole number from 1 on (1 is the single pulse), or inf.
    model : Linearized or Nonlinear
        Linearized, I is 0.16 % too large at slenderness 5: the unsafe side.

    Returns
    -------
    intensity : Array, shape (...)
        I [m/s]; 0 for C = 1 without limit on the half-cycles.

    Raises
    ------
    ValueError
        If a concrete `restitution` or `half_cycles` is out of range; traced, it gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{jr.critical_intensity(block, 0.7, half_cycles=5.0):.3f} m/s")
    0.375 m/s
    """
    return _single(block, model) * share_of_one(restitution, half_cycles)


@elementwise(restitution=UNIT_INTERVAL, intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model)
def critical_width(
    block: Block,
    restitution: Number,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Width of the block of this slenderness that the pulses just overturn.

    Critical intensities grow with the square root of the size.

    Parameters
    ----------
    block : Block
        Its half-width does not matter.
    restitution : array_like
        C [-], between 0 and 1.
    intensity : array_like
        I of each pulse [m/s], finite and at least 0.
    half_cycles : array_like, optional
        n, a whole number from 1 on (1 is the single pulse), or inf.
    model : Linearized or Nonlinear
        Linearized, 2b is 0.32 % too small at slenderness 5: the unsafe side.

    Returns
    -------
    width : Array, shape (...)
        2b [m]: wider blocks stand, narrower ones overturn. 0 without pulses; inf for C = 1
        without limit on the half-cycles.

    Raises
    ------
    ValueError
        If a concrete argument is out of range; traced, it gives NaN.
    """
    unit = eqx.tree_at(lambda b: b.half_width, block, jnp.ones_like(block.half_width))
    together = _together(restitution, intensity, half_cycles)
    return 2 * (together / _single(unit, model)) ** 2


@elementwise(restitution=UNIT_INTERVAL, intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model)
def critical_slenderness(
    block: Block,
    restitution: Number,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Slenderness of the block of this width that the pulses just overturn.

    Parameters
    ----------
    block : Block
        Its slenderness does not matter.
    restitution, intensity : array_like
        As in `critical_width`.
    half_cycles : array_like, optional
        As in `critical_width`.
    model : Linearized or Nonlinear
        Linearized, lambda is too large: the unsafe side.

    Returns
    -------
    slenderness : Array, shape (...)
        lambda [-]: stockier blocks stand, more slender ones overturn. inf without pulses, or
        where it is beyond the range of floating-point numbers; 0 for C = 1 without limit on
        the half-cycles.

    Raises
    ------
    ValueError
        If a concrete argument is out of range; traced, it gives NaN.
    """
    together = _together(restitution, intensity, half_cycles)
    # As a pure number, on which alone it depends.
    half_width, gravity = block.half_width, block.gravity
    weight = quotient(together, jnp.sqrt(half_width) * jnp.sqrt(gravity / 0.75))
    kind = jnp.finfo(weight.dtype)
    large = weight > 1
    some = (weight > float(kind.max) ** -0.5) & (weight < jnp.inf)
    weight = jnp.where(some, weight, 1)

    def excess(logarithm: Reals, given: Any) -> Reals:
        base, weight = given
        block = Block(0.75 * jnp.ones_like(base), base * jnp.exp(logarithm), jnp.ones_like(base))
        return jnp.log(_single(block, model) / weight)

    # What slender blocks tend to, and but for a factor up to pi / 2 stocky ones: the factor
    # is sought, and no longer changes where the range ends.
    eps = float(kind.eps)
    within = jnp.clip(weight, 0.1 * eps**0.25, 10 / eps)
    base, base_within = (jnp.where(w < 1, (1 / w) ** 2, 1 / w) for w in (weight, within))
    logarithm = _root(excess, jnp.zeros_like(base), base_within, within)
    # There it has no slope either, and what overflows must not meet it.
    factor = jnp.exp(jnp.where(weight == within, logarithm, jax.lax.stop_gradient(logarithm)))
    return jnp.where(some, base * factor, jnp.where(large, 0, jnp.inf))


@elementwise(intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model)
def critical_restitution(
    block: Block,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Restitution with which the pulses just overturn the block.

    Parameters
    ----------
    block : Block
    intensity : array_like
        As in `critical_width`.
    half_cycles : array_like, optional
        As in `critical_width`.
    model : Linearized or Nonlinear
        Linearized, C is too large: the unsafe side.

    Returns
    -------
    restitution : Array, shape (...)
        C [-]: the block stands with less, overturns with more; 0 where the first pulse just
        overturns it. NaN where there is none: if the first pulse is more than that, and if
        the block stands even with C = 1.

    Raises
    ------
    ValueError
        If a concrete argument is out of range; traced, it gives NaN.
    """
    single = _single(block, model)
    share = intensity / single
    half_cycles = jnp.asarray(half_cycles, share.dtype)
    slack = 4 * float(jnp.finfo(share.dtype).eps)
    exists = (share <= 1 + slack) & (half_cycles * share >= 1 - slack)
    several = exists & (half_cycles < jnp.inf)
    gap = jnp.where(share <= 1, (single - intensity) / single, 0)

    def excess(factor: Reals, given: Any) -> Reals:
        count, gap = given
        ratio = factor * gap
        return factor * share_of_one(ratio, count) / share_of_one(ratio, count - 1) - 1

    # C (1 - C^(n-1)) / (1 - C^n) is the gap: bent downwards, so that Newton's method comes
    # from below to C, which is between the gap and twice of it.
    count, gap_or_less = jnp.where(several, half_cycles, 2), jnp.where(several, gap, 0.25)
    factor = _root(excess, jnp.ones_like(share), count, gap_or_less)
    restitution = jnp.where(several, factor, 1) * gap
    # Rounding, which has no slope.
    restitution = restitution - jax.lax.stop_gradient(jnp.maximum(restitution - 1, 0))
    return jnp.where(exists, restitution, jnp.nan)


def _single(block: Block, model: ModelLike) -> Reals:
    """The one pulse that just overturns."""
    return as_model(model)._critical_velocity(block) / block.pulse_velocity(1.0)


def _together(restitution: Number, intensity: Number, half_cycles: Number) -> Reals:
    """The one pulse that does as much as so many, each after an impact."""
    return quotient_or_infinite(jnp.asarray(intensity), share_of_one(restitution, half_cycles))


def _root(function: Callable[[Reals, Any], Reals], start: Reals, *given: Reals) -> Reals:
    """Root by Newton's method, elementwise, with the derivatives of an implicit function."""
    import optimistix

    eps = float(jnp.finfo(jnp.result_type(*given)).eps)

    def one(guess: Reals, *given: Reals) -> Reals:
        return optimistix.root_find(
            function, optimistix.Newton(rtol=4 * eps, atol=4 * eps), guess, given, throw=False
        ).value

    return jnp.vectorize(one)(jax.lax.stop_gradient(start), *given)
