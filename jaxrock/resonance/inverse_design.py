"""Inverse design in closed form: intensities and blocks at the overturning threshold.

All follow from one statement: a number of the paper's pulses just overturns a block if the
single pulse that launches as fast as all of them does (Eqs. 2 and 8).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..impact import prepare_restitution, require_linear_law
from ..numerics import quotient, quotient_or_infinite, share_of_one
from ..validation import (
    COUNT,
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Number,
    Reals,
    as_name,
    elementwise,
)
from .free_rocking import Linearized, ModelLike, as_model

_guard = elementwise(
    prepare_restitution,
    restitution=UNIT_INTERVAL,
    intensity=NON_NEGATIVE,
    half_cycles=COUNT,
    model=as_model,
)


@elementwise(prepare_restitution, restitution=UNIT_INTERVAL, half_cycles=COUNT, model=as_model)
def critical_intensity(
    block: Block,
    restitution: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Compute the intensity of pulses that just overturn the block within n half-cycles.

    At this intensity `half_cycle_velocity` is the critical velocity (Eqs. 2 and 8). With
    `Linearized`, it is 0.16 % too large at slenderness 5, which is unsafe.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1; of a one-sided block its magnitude counts.
    half_cycles : array_like
        n, a whole number from 1 on, or inf.
    model : ModelLike
        `Linearized` by default, as in the paper; driven motion is `Nonlinear` by default.

    Returns
    -------
    Array, shape (...)
        I [m/s]; 0 for C = 1 and n = inf.

    Raises
    ------
    ValueError
        If a concrete `restitution` or `half_cycles` is out of range. A traced one gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{jr.critical_intensity(block, 0.7, half_cycles=5.0):.3f} m/s")
    0.375 m/s
    """
    return _single_pulse_intensity(block, model) * share_of_one(restitution, half_cycles)


def critical_width(
    block: Block,
    restitution: Number,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
    *,
    fixed: str = "slenderness",
) -> Reals:
    """Compute the width that pulses just overturn, at fixed slenderness or height.

    The half-width of `block` does not matter. At fixed slenderness the height changes in
    proportion to the width, and critical intensities grow with the square root of the size. At
    fixed height they grow faster: for a slender block nearly in proportion to the width.
    With `Linearized`, the width is too small, which is unsafe: at slenderness 5 by 0.32 %, at
    this height by about half of that.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1; of a one-sided block its magnitude counts.
    intensity : array_like
        I [m/s], finite and at least 0.
    half_cycles : array_like
        n, a whole number from 1 on, or inf.
    model : ModelLike
    fixed : str
        Quantity that stays constant: ``"slenderness"`` or ``"height"``.

    Returns
    -------
    Array, shape (...)
        2b [m]: wider blocks stand. 0 without pulses; inf for C = 1 and n = inf.

    Raises
    ------
    ValueError
        If `fixed` is neither of the two, or a concrete `restitution`, `intensity` or
        `half_cycles` is out of range. A traced one gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> cabinet = jr.Block.from_size(width=0.6, height=1.8)
    >>> for fixed in ("slenderness", "height"):
    ...     width = jr.critical_width(cabinet, 0.9, 0.15, fixed=fixed)
    ...     print(f"{width:.2f} m at this {fixed}")
    0.95 m at this slenderness
    0.74 m at this height
    """
    functions = {"slenderness": _width_at_slenderness, "height": _width_at_height}
    function = functions[as_name("fixed", fixed, functions)]
    return function(block, restitution, intensity, half_cycles, model)


@_guard
def _width_at_slenderness(
    block: Block, restitution: Number, intensity: Number, half_cycles: Number, model: ModelLike
) -> Reals:
    """Compute the width at this slenderness that pulses just overturn."""
    # A block of half-width 1 m instead of the given one, which drops out: so it is not in the
    # derivatives either.
    unit = eqx.tree_at(lambda b: b.half_width, block, jnp.ones_like(block.half_width))
    pulse = _equivalent_intensity(restitution, intensity, half_cycles)
    return 2 * (pulse / _single_pulse_intensity(unit, model)) ** 2


@_guard
def _width_at_height(
    block: Block, restitution: Number, intensity: Number, half_cycles: Number, model: ModelLike
) -> Reals:
    """Compute the width at this height that pulses just overturn."""
    pulse = _equivalent_intensity(restitution, intensity, half_cycles)
    half_height = block.slenderness * block.half_width
    weight = _express_as_weight(pulse, block, half_height)
    finite = weight < jnp.inf
    # Slender blocks are overturned by a weight of b / a, stocky ones by (b / a)^1.5, up to a
    # factor of pi / 2.
    eps = float(jnp.finfo(weight.dtype).eps)
    weight = jnp.where(finite, weight, 1)
    ratio = _solve_shape(
        lambda ratio: _compute_weight(ratio, 1 / ratio, model),
        # Not by a power of 2 / 3, whose rounding a large number would multiply.
        lambda weight: jnp.where(weight < 1, weight, jnp.cbrt(jnp.maximum(weight, 1)) ** 2),
        weight,
        (0.1 * eps**0.5, (10 / eps) ** 1.5),
    )
    return jnp.where(finite, 2 * half_height * ratio, jnp.inf)


@_guard
def critical_slenderness(
    block: Block,
    restitution: Number,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Compute the slenderness of the block of this width that pulses just overturn.

    The slenderness of `block` does not matter. The answer times the width is the critical
    height at this width. With `Linearized`, lambda is too large, which is unsafe.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1; of a one-sided block its magnitude counts.
    intensity : array_like
        I [m/s], finite and at least 0.
    half_cycles : array_like
        n, a whole number from 1 on, or inf.
    model : ModelLike

    Returns
    -------
    Array, shape (...)
        lambda [-]: stockier blocks stand. inf without pulses, or beyond the range of
        floating-point numbers; 0 for C = 1 and n = inf.

    Raises
    ------
    ValueError
        If a concrete `restitution`, `intensity` or `half_cycles` is out of range. A traced one
        gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.critical_slenderness(jr.Block(0.4, 5.0), 0.7, intensity=0.15):.2f}")
    20.97
    """
    pulse = _equivalent_intensity(restitution, intensity, half_cycles)
    weight = _express_as_weight(pulse, block, block.half_width)
    number = jnp.finfo(weight.dtype)
    # Below this bound (1 / weight)^2, the slenderness of slender blocks, would overflow.
    representable = (weight > float(number.max) ** -0.5) & (weight < jnp.inf)
    slenderness_beyond = jnp.where(weight > 1, 0, jnp.inf)
    weight = jnp.where(representable, weight, 1)

    # Weak pulses overturn slender blocks of slenderness 1 / weight^2, strong ones stocky
    # blocks of slenderness 1 / weight, up to a factor of pi / 2.
    eps = float(number.eps)
    slenderness = _solve_shape(
        lambda slenderness: _compute_weight(jnp.ones_like(slenderness), slenderness, model),
        lambda weight: jnp.where(weight < 1, (1 / weight) ** 2, 1 / weight),
        weight,
        (0.1 * eps**0.25, 10 / eps),
    )
    return jnp.where(representable, slenderness, slenderness_beyond)


@elementwise(intensity=NON_NEGATIVE, half_cycles=COUNT, model=as_model)
def critical_restitution(
    block: Block,
    intensity: Number,
    half_cycles: Number = jnp.inf,
    model: ModelLike = Linearized(),
) -> Reals:
    """Compute the restitution with which pulses just overturn the block within n half-cycles.

    With `Linearized`, C is too large, which is unsafe.

    Parameters
    ----------
    block : Block
    intensity : array_like
        I [m/s], finite and at least 0.
    half_cycles : array_like
        n, a whole number from 1 on, or inf.
    model : ModelLike

    Returns
    -------
    Array, shape (...)
        C [-], for a one-sided block its magnitude; with less, the block stands. 0 where the
        first pulse just overturns it. NaN where the first pulse is stronger than that, or the
        block stands even with C = 1.

    Raises
    ------
    ValueError
        If a concrete `intensity` or `half_cycles` is out of range. A traced one gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.critical_restitution(jr.Block(0.4, 5.0), intensity=0.3):.3f}")
    0.711
    """
    single = _single_pulse_intensity(block, model)
    share = intensity / single
    half_cycles = jnp.asarray(half_cycles, share.dtype)
    # Some rounding is granted at both ends: a pulse from `critical_intensity` with C = 0 or 1
    # has an answer.
    slack = 4 * float(jnp.finfo(share.dtype).eps)
    exists = (share <= 1 + slack) & (half_cycles * share >= 1 - slack)
    finite = exists & (half_cycles < jnp.inf)
    # Of a gap close to 1 the derivative of the quotient would cancel, of a small one 1 - share.
    gap = jnp.select([share < 0.5, share <= 1], [1 - share, (single - intensity) / single])

    def relative_excess(factor: Reals, parameters: tuple[Reals, Reals]) -> Reals:
        """Compute the gap for C = factor * gap, over the given gap, less 1."""
        count, gap = parameters
        c = factor * gap
        return factor * share_of_one(c, count) / share_of_one(c, count - 1) - 1

    # C (1 - C^(n-1)) / (1 - C^n) is the gap. It is concave, so that Newton's method converges
    # from below to C, which is between the gap and twice the gap. Where n is infinite C is the
    # gap itself; there, and where no C exists, stand-ins keep the search out of trouble.
    count = jnp.where(finite, half_cycles, 2)
    finite_gap = jnp.where(finite, gap, 0.25)
    factor = _solve_by_newton(relative_excess, jnp.ones_like(share), count, finite_gap)
    restitution = jnp.where(finite, factor, 1) * gap
    # Above 1 only by rounding, which has no derivative.
    restitution = restitution - jax.lax.stop_gradient(jnp.maximum(restitution - 1, 0))
    return jnp.where(exists, restitution, jnp.nan)


def _single_pulse_intensity(block: Block, model: ModelLike) -> Reals:
    """Compute the intensity of the single pulse that just overturns [m/s]."""
    require_linear_law()
    return as_model(model)._critical_velocity(block) / block.pulse_velocity(1.0)


def _equivalent_intensity(
    restitution: Number, intensity: Number, half_cycles: Number
) -> Reals:
    """Compute the single pulse that launches as fast as n, each after an impact [m/s]."""
    return quotient_or_infinite(jnp.asarray(intensity), share_of_one(restitution, half_cycles))


def _express_as_weight(pulse: Reals, block: Block, length: Reals) -> Reals:
    """Express a pulse as a pure number, on which alone the shape of a block of a length depends."""
    return quotient(pulse, jnp.sqrt(length) * jnp.sqrt(block.gravity * block.inertia_ratio))


def _compute_weight(half_width: Reals, slenderness: Reals, model: ModelLike) -> Reals:
    """Compute the pulse that just overturns a block, both as pure numbers."""
    # With g kappa = 1 and a length of 1 a pulse in m/s is the pure number.
    block = Block(0.75 * half_width, slenderness, jnp.ones_like(slenderness))
    return _single_pulse_intensity(block, model)


def _solve_shape(
    weigh: Callable[[Reals], Reals],
    estimate: Callable[[Reals], Reals],
    weight: Reals,
    bounds: tuple[float, float],
) -> Reals:
    """Find the shape of the block that a pulse just overturns, both as pure numbers.

    The factor on the estimate is solved for; beyond the bounds on the pulse it no longer changes.
    """

    def log_excess(log_factor: Reals, parameters: tuple[Reals, Reals]) -> Reals:
        """Compute log(pulse that just overturns a block of this shape / given pulse)."""
        estimated, weight = parameters
        return jnp.log(weigh(estimated * jnp.exp(log_factor)) / weight)

    estimated = estimate(weight)
    clipped = jnp.clip(weight, *bounds)
    log_factor = _solve_by_newton(
        log_excess, jnp.zeros_like(estimated), estimate(clipped), clipped
    )
    # Nor has it a derivative there: the derivative at an end, times one that overflows, would
    # be NaN.
    fixed = jax.lax.stop_gradient(log_factor)
    return estimated * jnp.exp(jnp.where(weight == clipped, log_factor, fixed))


def _solve_by_newton(
    function: Callable[[Reals, tuple[Reals, Reals]], Reals], start: Reals, *parameters: Reals
) -> Reals:
    """Find a root by Newton's method, elementwise, with the derivatives of the root."""
    import optimistix  # which loads slowly

    eps = float(jnp.finfo(jnp.result_type(*parameters)).eps)
    newton = optimistix.Newton(rtol=4 * eps, atol=4 * eps)

    def solve(start: Reals, *parameters: Reals) -> Reals:
        return optimistix.root_find(function, newton, start, parameters, throw=False).value

    return jnp.vectorize(solve)(jax.lax.stop_gradient(start), *parameters)
