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

    With it, `half_cycle_velocity` is the critical velocity (Eqs. 2 and 8). Linearized, it is
    0.16 % too large at slenderness 5: the unsafe side.

    Returns I [m/s]; 0 for C = 1 and n = inf.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{jr.critical_intensity(block, 0.7, half_cycles=5.0):.3f} m/s")
    0.375 m/s
    """
    return _single_pulse(block, model) * share_of_one(restitution, half_cycles)


@elementwise(
    restitution=UNIT_INTERVAL, intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model
)
def critical_width(
    block: Block,
    restitution: Number,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Width of the block of this slenderness that pulses [m/s] just overturn.

    Its half-width does not matter. Critical intensities grow with the square root of the size.
    Linearized, the width is 0.32 % too small at slenderness 5: the unsafe side.

    Returns 2b [m]: wider blocks stand. 0 without pulses; inf for C = 1 and n = inf.
    """
    unit = eqx.tree_at(lambda b: b.half_width, block, jnp.ones_like(block.half_width))
    pulse = _equivalent_pulse(restitution, intensity, half_cycles)
    return 2 * (pulse / _single_pulse(unit, model)) ** 2


@elementwise(
    restitution=UNIT_INTERVAL, intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model
)
def critical_slenderness(
    block: Block,
    restitution: Number,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Slenderness of the block of this width that pulses [m/s] just overturn.

    Its slenderness does not matter. Linearized, lambda is too large: the unsafe side.

    Returns lambda [-]: stockier blocks stand. inf without pulses, or beyond the range of
    floating-point numbers; 0 for C = 1 and n = inf.
    """
    pulse = _equivalent_pulse(restitution, intensity, half_cycles)
    half_width = block.half_width
    gravity = block.gravity * block.inertia_ratio
    # The pulse as a pure number, on which alone the slenderness depends: b g kappa is 1 with
    # it.
    weight = quotient(pulse, jnp.sqrt(half_width) * jnp.sqrt(gravity))
    number = jnp.finfo(weight.dtype)
    representable = (weight > float(number.max) ** -0.5) & (weight < jnp.inf)
    slenderness_beyond = jnp.where(weight > 1, 0, jnp.inf)
    weight = jnp.where(representable, weight, 1)

    def excess(log_factor: Reals, parameters: Any) -> Reals:
        estimate, weight = parameters
        slenderness = estimate * jnp.exp(log_factor)
        unit = jnp.ones_like(estimate)
        return jnp.log(_single_pulse(Block(0.75 * unit, slenderness, unit), model) / weight)

    # The slenderness is the limit for slender blocks, for stocky ones up to a factor of pi /
    # 2. The factor is solved for: beyond the ends of the clipped range it no longer changes.
    eps = float(number.eps)
    clipped = jnp.clip(weight, 0.1 * eps**0.25, 10 / eps)
    estimate, clipped_estimate = (
        jnp.where(w < 1, (1 / w) ** 2, 1 / w) for w in (weight, clipped)
    )
    log_factor = _root(excess, jnp.zeros_like(estimate), clipped_estimate, clipped)
    # Nor has it a derivative there; what overflows must not meet the one of the end.
    fixed = jax.lax.stop_gradient(log_factor)
    factor = jnp.exp(jnp.where(weight == clipped, log_factor, fixed))
    return jnp.where(representable, estimate * factor, slenderness_beyond)


@elementwise(intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model)
def critical_restitution(
    block: Block,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Restitution with which pulses [m/s] just overturn the block within so many half-cycles.

    Linearized, C is too large: the unsafe side.

    Returns C [-]: the block stands with less. 0 where the first pulse just overturns it; NaN
    where the first pulse is more than that, or the block stands even with C = 1.
    """
    single = _single_pulse(block, model)
    share = intensity / single
    half_cycles = jnp.asarray(half_cycles, share.dtype)
    slack = 4 * float(jnp.finfo(share.dtype).eps)
    exists = (share <= 1 + slack) & (half_cycles * share >= 1 - slack)
    finite = exists & (half_cycles < jnp.inf)
    gap = jnp.where(share <= 1, (single - intensity) / single, 0)

    def excess(factor: Reals, parameters: Any) -> Reals:
        count, gap = parameters
        c = factor * gap
        return factor * share_of_one(c, count) / share_of_one(c, count - 1) - 1

    # C (1 - C^(n-1)) / (1 - C^n) is the gap. It is concave, so that Newton's method converges
    # from below to C, which is between the gap and twice the gap.
    count = jnp.where(finite, half_cycles, 2)
    finite_gap = jnp.where(finite, gap, 0.25)
    factor = _root(excess, jnp.ones_like(share), count, finite_gap)
    restitution = jnp.where(finite, factor, 1) * gap
    # Above 1 only by rounding, which has no derivative.
    restitution = restitution - jax.lax.stop_gradient(jnp.maximum(restitution - 1, 0))
    return jnp.where(exists, restitution, jnp.nan)


def _single_pulse(block: Block, model: ModelLike) -> Reals:
    """Intensity of the single pulse that just overturns."""
    return as_model(model)._critical_velocity(block) / block.pulse_velocity(1.0)


def _equivalent_pulse(restitution: Number, intensity: Number, half_cycles: Number) -> Reals:
    """Intensity of the single pulse that launches as fast as so many, each after an impact."""
    return quotient_or_infinite(jnp.asarray(intensity), share_of_one(restitution, half_cycles))


def _root(function: Callable[[Reals, Any], Reals], start: Reals, *parameters: Reals) -> Reals:
    """Root by Newton's method, elementwise, with the derivatives of an implicit function."""
    import optimistix

    eps = float(jnp.finfo(jnp.result_type(*parameters)).eps)
    newton = optimistix.Newton(rtol=4 * eps, atol=4 * eps)

    def root(start: Reals, *parameters: Reals) -> Reals:
        return optimistix.root_find(function, newton, start, parameters, throw=False).value

    return jnp.vectorize(root)(jax.lax.stop_gradient(start), *parameters)
