"""Free rocking between two impacts, in closed form: two models.

`Linearized` is exact in the limit of slender blocks (Eq. 4), `Nonlinear` for any block (Eq. 1
without input). The equation of motion, its linearized solution and the duration of a
half-cycle are Housner's (1963, https://doi.org/10.1785/BSSA0530020403). Free rocking conserves
energy: a block lands as fast as it took off, and everything depends on
``x = velocity / critical_velocity``. The block stands while x < 1.

Notation: ``h = sqrt(1 + lambda^2)`` is R / b, ``k = sqrt(1 - x^2)`` the square root of the
energy that is missing to overturn (over the energy barrier), ``tau = tan(alpha_c / 2)``.
"""

from typing import Literal

import jax.numpy as jnp
from typing_extensions import TypeAliasType

from ..block import Block, diagonal_ratio
from ..numerics import (
    arcsin,
    arcsin_ratio,
    arctan_ratio,
    artanh_ratio,
    carlson_rf,
    jacobi,
    one_minus_square,
    quotient,
)
from ..validation import Reals, describe
from .rocking_model import RockingModel


class Linearized(RockingModel):
    """Free rocking of slender blocks, the equation of motion linearized (Eq. 4).

    At slenderness 3 its critical velocity is 0.43 % too large. Its peaks and durations are
    1.5 to 1.9 % too small up to 0.9 of that velocity. Errors decrease as 1 / lambda^2.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{jr.Linearized().critical_velocity(block):.4f} rad/s")
    0.3749 rad/s
    """

    name = "linearized"

    def _critical_velocity(self, block: Block) -> Reals:
        return block.critical_angle * block.frequency_parameter

    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # alpha_c x^2 / (1 + k), written so that `shape` tends to 1 for slender blocks.
        cotangent = 1 / block.slenderness
        square = 1 + cotangent**2
        shape = arctan_ratio(cotangent) * (square * jnp.sqrt(square))  # a power takes longer
        pulse = _dimensionless_pulse(intensity, block)
        return pulse**2 / (shape * (1 + _missing_energy_root(x)))

    def _rotation_ratio(self, block: Block, x: Reals) -> Reals:
        return x**2 / (1 + _missing_energy_root(x))

    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals:
        # The peak is alpha_c (1 - k), and x^2 = (1 - k) (1 + k). In the quotient of two peaks,
        # less 1, both cancel by hand, so that no difference of close numbers is left.
        slower = _missing_energy_root(x)
        faster = _missing_energy_root(x * (1 + growth))
        return 1 + growth * (2 + growth) * (1 + slower) / (slower + faster)

    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # 2 x / p = 2 I cos(alpha_c) / (g alpha_c)
        cosine = block.slenderness / diagonal_ratio(block)
        weak_limit = 2 * intensity * cosine / (block.gravity * block.critical_angle)
        return weak_limit * artanh_ratio(x)

    def _rotation(self, block: Block, x: Reals, time: Reals) -> Reals:
        # alpha = alpha_c (1 - cosh(p t) + x sinh(p t)), with half of the argument: small
        # rotations keep their digits.
        half = block.frequency_parameter * time / 2
        # The product grows as exp(2 half): just below the largest exponent.
        representable = abs(half) < 0.49 * jnp.log(jnp.finfo(half.dtype).max)
        half = jnp.where(representable, half, 0)
        product = jnp.sinh(half) * (x * jnp.cosh(half) - jnp.sinh(half))
        return jnp.where(representable, 2 * block.critical_angle * product, jnp.nan)

    def _time_from_ground(self, block: Block, rotation: Reals, x: Reals, q: Reals) -> Reals:
        # 1 - alpha / alpha_c + velocity / v_c decays as exp(-p t), from 1 + x on. By log1p,
        # since the quotient of the two is close to 1 shortly after the launch.
        ratio = rotation / block.critical_angle
        return jnp.log1p((x - q + ratio) / (1 - ratio + q)) / block.frequency_parameter


class Nonlinear(RockingModel):
    """Free rocking of any block, the equation of motion (Eq. 1) in full.

    Durations are computed by Carlson's elliptic integral R_F (Carlson 1995,
    https://doi.org/10.1007/BF02198293), rotations over time by Jacobi's elliptic functions.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{jr.Nonlinear().critical_velocity(block):.4f} rad/s")
    0.3743 rad/s
    """

    name = "nonlinear"

    def _critical_velocity(self, block: Block) -> Reals:
        return 2 * block.frequency_parameter * _half_angle_sine_cosine(block)[0]

    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # sin(peak / 2) = tau x^2 / (w + k), and tau x^2 = pulse^2 cos(alpha_c)^2 / 2 with the
        # dimensionless pulse
        cosine_squared = 1 / (1 + block.slenderness**-2)
        divisor = 2 * (_stiffness_terms(block, x)[1] + _missing_energy_root(x))
        pulse = _dimensionless_pulse(intensity, block)
        return 2 * arcsin(pulse**2 * cosine_squared / divisor)

    def _rotation_ratio(self, block: Block, x: Reals) -> Reals:
        tau, w = _stiffness_terms(block, x)
        half_peak = arcsin(quotient(tau * x**2, w + _missing_energy_root(x)))
        return 2 * half_peak / block.critical_angle

    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals:
        # 1 + (rise of the peak) / peak. By energy the sine of half the rise is tau x^2 gain /
        # crossed, and the sine of half the peak tau x^2 / (w + k). What they share cancels by
        # hand: the quotient has a limit at x = 0.
        faster = x * (1 + growth)
        k = _missing_energy_root(x)
        k_faster = _missing_energy_root(faster)
        tau, w = _stiffness_terms(block, x)
        _, w_faster = _stiffness_terms(block, faster)
        gain = growth * (2 + growth)
        crossed = k * w_faster + k_faster * w
        peak = arcsin_ratio(tau * x**2 / (w + k))
        rise = arcsin_ratio(tau * x**2 * gain / crossed)
        return 1 + gain * (w + k) / crossed * rise / peak

    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # 2 x / (p cos(alpha_c / 2)) = 2 I lambda / g
        w = _stiffness_terms(block, x)[1]
        k_squared = one_minus_square(x)
        integral = carlson_rf(jnp.ones_like(w), k_squared, k_squared / w**2)
        return 2 * intensity * block.slenderness / (block.gravity * w) * integral

    def _rotation(self, block: Block, x: Reals, time: Reals) -> Reals:
        sine, cosine = _half_angle_sine_cosine(block)
        m1 = sine**2 * one_minus_square(x)
        sn, cn, dn = jacobi(block.frequency_parameter * time, m1)
        # r is sin((alpha_c - alpha) / 2) over its value at rest, `fall` is 1 - r: small
        # rotations keep their digits.
        denominator = dn + x * cosine * sn * cn
        r = (1 - x**2 * sn**2) / denominator
        fall = sn * (x * cosine * cn - ((1 - m1) / (1 + dn) - x**2) * sn) / denominator
        # Beyond the critical angle r is negative, and the sum of roots would cancel. There the
        # rotation is not small, and the direct expression keeps its digits.
        subcritical = r > 0
        r_beyond = jnp.where(subcritical, 0, r)
        r = jnp.where(subcritical, r, 1)
        fall = jnp.where(subcritical, fall, 0)
        sum_of_roots = jnp.sqrt(1 - sine**2 * r**2) + r * cosine
        rotation = 2 * jnp.arcsin(sine * fall * (1 + r) / sum_of_roots)
        beyond = block.critical_angle - 2 * jnp.arcsin(sine * r_beyond)
        return jnp.where(subcritical, rotation, beyond)

    def _time_from_ground(self, block: Block, rotation: Reals, x: Reals, q: Reals) -> Reals:
        # With y = sin((alpha_c - alpha) / 2)^2 it is the integral of
        # dy / (2 p sqrt(y (1 - y) (y - m))), m = sin(alpha_c / 2)^2 (1 - x^2), up to the
        # ground (DLMF 19.29.4); velocity = 2 p sqrt(y - m). Both roots of y - m are taken over
        # x.
        # A block at rest has no x to divide by: any will do, since `fall` is 0.
        moves = x > 0
        scale = jnp.where(moves, x, 1)
        sine, cosine = _half_angle_sine_cosine(block)
        half_to_go = 0.5 * (block.critical_angle - rotation)
        sine_up = jnp.sin(half_to_go)
        cosine_up = jnp.cos(half_to_go)
        root = sine
        root_up = sine * jnp.where(moves, q / scale, 1)
        fall = jnp.sin(block.critical_angle - 0.5 * rotation) * jnp.sin(0.5 * rotation)
        integral = carlson_rf(
            (sine * cosine * root_up + sine_up * cosine_up * root) ** 2,
            (sine * root * cosine_up + sine_up * root_up * cosine) ** 2,
            (cosine * root * sine_up + cosine_up * root_up * sine) ** 2,
        )
        return fall / scale * integral / block.frequency_parameter


ModelLike = TypeAliasType("ModelLike", RockingModel | Literal["linearized", "nonlinear"])


def as_model(model: object) -> RockingModel:
    """Return a model, given as itself or by its name.

    Raises
    ------
    ValueError
        If `model` is neither.
    """
    if isinstance(model, RockingModel):
        return model
    for kind in (Linearized, Nonlinear):
        # First the class: an array of names is equal to one of them in each of its elements.
        if isinstance(model, str) and model == kind.name:
            return kind()
    raise ValueError(
        'model must be Linearized(), Nonlinear(), "linearized" or "nonlinear",'
        f" got {describe(model)}"
    )


def _missing_energy_root(x: Reals) -> Reals:
    """Compute k = sqrt(1 - x^2) [-], the square root of the energy missing to overturn."""
    return jnp.sqrt(one_minus_square(x))


def _dimensionless_pulse(intensity: Reals, block: Block) -> Reals:
    """Express a pulse as a pure number.

    Its square is twice the peak after a weak pulse, in the limit of slender blocks.
    """
    return intensity / jnp.sqrt(block.gravity * block.half_width * block.inertia_ratio)


def _half_angle_sine_cosine(block: Block) -> tuple[Reals, Reals]:
    """Compute sine and cosine of half the critical angle."""
    # From the slenderness without a detour by the angle; h - lambda = 1 / (h + lambda) is
    # written as a quotient, since the difference cancels for slender blocks.
    h = diagonal_ratio(block)
    slenderness = block.slenderness
    return jnp.sqrt(0.5 / (h * (h + slenderness))), jnp.sqrt(0.5 * (1 + slenderness / h))


def _stiffness_terms(block: Block, x: Reals) -> tuple[Reals, Reals]:
    """Compute tau = 1 / (h + lambda) and w = sqrt(1 + tau^2 x^2) [-]; linearized, w is 1."""
    tau = 1 / (diagonal_ratio(block) + block.slenderness)
    return tau, jnp.sqrt(1 + (tau * x) ** 2)
