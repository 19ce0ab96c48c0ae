"""Free rocking between two impacts, in closed form: two models.

`Linearized` is exact for slender blocks (Eq. 4), `Nonlinear` for any block (Eq. 1 without
input). Free rocking conserves energy: a block lands as fast as it took off, and everything
depends on ``x = velocity / critical_velocity``. The block stands while x < 1.

Notation: ``h = sqrt(1 + lambda^2)`` is R / b, ``k = sqrt(1 - x^2)`` the square root of the
energy that is missing to overturn (over the energy barrier), ``tau = tan(alpha_c / 2)``.
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
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
from ..validation import FINITE, GROWTH, NON_NEGATIVE, Number, Reals, describe, elementwise


class RockingModel(eqx.Module):
    """What both models can answer; see `Linearized` and `Nonlinear`.

    A model is written in terms of x and of the pulse that gives the launch velocity to the
    block at rest. In terms of the velocity derivatives would cancel: slenderness and width act
    on it in the opposite way as on peak and duration.
    """

    name: ClassVar[str]  # in datasets and options

    @abc.abstractmethod
    def _critical_velocity(self, block: Block) -> Reals: ...

    _peak_rotation: ClassVar[Callable[..., Reals]]  # of block, x, intensity
    _rotation_ratio: ClassVar[Callable[..., Reals]]  # of block, x
    _peak_amplification: ClassVar[Callable[..., Reals]]  # of block, x, growth
    _half_cycle_duration: ClassVar[Callable[..., Reals]]  # of block, x, intensity
    _rotation: ClassVar[Callable[..., Reals]]  # of block, x, time
    # Of block, rotation, x, q: from the launch to a rotation on the way up, where velocity /
    # critical velocity is q; by symmetry also from there down to the impact, where x may
    # exceed 1.
    _time_from_ground: ClassVar[Callable[..., Reals]]

    @elementwise()
    def critical_velocity(self, block: Block) -> Reals:
        """Launch velocity that just overturns the block.

        Returns ``alpha_c p`` (`Linearized`) or ``2 p sin(alpha_c / 2)`` (`Nonlinear`) [rad/s].
        """
        return self._critical_velocity(block)

    @elementwise(velocity=NON_NEGATIVE)
    def peak_rotation(self, block: Block, velocity: Number) -> Reals:
        """Largest rotation after a launch with a velocity [rad/s] (Eqs. 6 and 12).

        Returns peak rotation [rad]; NaN where the launch overturns the block.
        """
        return self._where_standing(self._peak_rotation, block, velocity)

    @elementwise(velocity=NON_NEGATIVE)
    def half_cycle_duration(self, block: Block, velocity: Number) -> Reals:
        """Time from a launch with a velocity [rad/s] to the next impact (Eqs. 7 and 9).

        Returns time [s]; NaN where the launch overturns the block.
        """
        return self._where_standing(self._half_cycle_duration, block, velocity)

    @elementwise(velocity=NON_NEGATIVE, time=FINITE)
    def motion(self, block: Block, velocity: Number, time: Number) -> tuple[Reals, Reals]:
        """Rotation and angular velocity at a time [s] after a launch [rad/s] (Eq. 5).

        As if there were no ground: after the next impact, at `half_cycle_duration`, the
        rotation is negative. From `critical_velocity` on the block overturns.

        Returns both [rad], [rad/s]; NaN where the linearized motion, which grows without
        bound, leaves the range of floating-point numbers.
        """
        x = velocity / self._critical_velocity(block)
        x, time = jnp.broadcast_arrays(x, time)
        return jax.jvp(lambda t: self._rotation(block, x, t), (time,), (jnp.ones_like(time),))

    @elementwise(velocity=NON_NEGATIVE, growth=GROWTH)
    def peak_amplification(self, block: Block, velocity: Number, growth: Number) -> Reals:
        """Compute how much higher a block rocks if launched ``1 + growth`` times as fast [rad/s].

        The quotient of two peaks would lose its derivatives where they are small, and its
        digits where they are almost equal.

        Returns ``peak_rotation(velocity * (1 + growth)) / peak_rotation(velocity)`` [-], at
        zero velocity ``(1 + growth)^2``; NaN where the faster launch overturns the block.
        """
        x = velocity / self._critical_velocity(block)
        stands = x * (1 + growth) < 1
        x = jnp.where(stands, x, 0)
        growth = jnp.where(stands, growth, 0)
        return jnp.where(stands, self._peak_amplification(block, x, growth), jnp.nan)

    def _where_standing(
        self, quantity: Callable[[Block, Reals, Reals], Reals], block: Block, velocity: Number
    ) -> Reals:
        x = velocity / self._critical_velocity(block)
        stands = x < 1
        x = jnp.where(stands, x, 0)
        velocity = jnp.where(stands, velocity, 0)
        intensity = velocity / block.pulse_velocity(1.0)
        return jnp.where(stands, quantity(block, x, intensity), jnp.nan)


class Linearized(RockingModel):
    """Free rocking of slender blocks, the equation of motion linearized (Eq. 4).

    At slenderness 3 its critical velocity is 0.43 % too large, its peak and duration 1.5
    to 1.9 % too small up to 0.9 of that velocity; the error falls as 1 / lambda^2.
    """

    name = "linearized"

    def _critical_velocity(self, block: Block) -> Reals:
        return block.critical_angle * block.frequency_parameter

    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # alpha_c x^2 / (1 + k), written so that `shape` tends to 1 for slender blocks.
        cotangent = 1 / block.slenderness
        square = 1 + cotangent**2
        shape = arctan_ratio(cotangent) * (square * jnp.sqrt(square))  # a power takes longer
        return _weight_of(intensity, block) ** 2 / (shape * (1 + _barrier(x)))

    def _rotation_ratio(self, block: Block, x: Reals) -> Reals:
        return x**2 / (1 + _barrier(x))

    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals:
        slower = _barrier(x)
        faster = _barrier(x * (1 + growth))
        return 1 + growth * (2 + growth) * (1 + slower) / (slower + faster)

    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # 2 x / p = 2 I cos(alpha_c) / (g alpha_c)
        cosine = block.slenderness / diagonal_ratio(block)
        weak_limit = 2 * intensity * cosine / (block.gravity * block.critical_angle)
        return weak_limit * artanh_ratio(x)

    def _rotation(self, block: Block, x: Reals, time: Reals) -> Reals:
        half = block.frequency_parameter * time / 2
        representable = abs(half) < 0.49 * jnp.log(jnp.finfo(half.dtype).max)
        half = jnp.where(representable, half, 0)
        product = jnp.sinh(half) * (x * jnp.cosh(half) - jnp.sinh(half))
        return jnp.where(representable, 2 * block.critical_angle * product, jnp.nan)

    def _time_from_ground(self, block: Block, rotation: Reals, x: Reals, q: Reals) -> Reals:
        # 1 - alpha / alpha_c + velocity / v_c decays as exp(-p t), from 1 + x on.
        ratio = rotation / block.critical_angle
        return jnp.log1p((x - q + ratio) / (1 - ratio + q)) / block.frequency_parameter


class Nonlinear(RockingModel):
    """Free rocking of any block, the equation of motion (Eq. 1) in full.

    Durations are Carlson's elliptic integral R_F, rotations over time Jacobi's functions.
    """

    name = "nonlinear"

    def _critical_velocity(self, block: Block) -> Reals:
        return 2 * block.frequency_parameter * _of_half(block)[0]

    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # sin(peak / 2) = tau x^2 / (w + k), and tau x^2 = weight^2 cos(alpha_c)^2 / 2
        cosine_squared = 1 / (1 + block.slenderness**-2)
        tallness = 2 * (_stiffening(block, x)[1] + _barrier(x))
        return 2 * arcsin(_weight_of(intensity, block) ** 2 * cosine_squared / tallness)

    def _rotation_ratio(self, block: Block, x: Reals) -> Reals:
        tau, w = _stiffening(block, x)
        return 2 * arcsin(quotient(tau * x**2, w + _barrier(x))) / block.critical_angle

    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals:
        faster = x * (1 + growth)
        k = _barrier(x)
        k_faster = _barrier(faster)
        tau, w = _stiffening(block, x)
        _, w_faster = _stiffening(block, faster)
        gain = growth * (2 + growth)
        crossed = k * w_faster + k_faster * w
        peak = arcsin_ratio(tau * x**2 / (w + k))
        rise = arcsin_ratio(tau * x**2 * gain / crossed)
        return 1 + gain * (w + k) / crossed * rise / peak

    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # 2 x / (p cos(alpha_c / 2)) = 2 I lambda / g
        w = _stiffening(block, x)[1]
        k_squared = one_minus_square(x)
        integral = carlson_rf(jnp.ones_like(w), k_squared, k_squared / w**2)
        return 2 * intensity * block.slenderness / (block.gravity * w) * integral

    def _rotation(self, block: Block, x: Reals, time: Reals) -> Reals:
        sine, cosine = _of_half(block)
        m1 = sine**2 * one_minus_square(x)
        sn, cn, dn = jacobi(block.frequency_parameter * time, m1)
        # r is sin((alpha_c - alpha) / 2) over its value at rest, `fall` is 1 - r: small
        # rotations keep their digits.
        denominator = dn + x * cosine * sn * cn
        r = (1 - x**2 * sn**2) / denominator
        fall = sn * (x * cosine * cn - ((1 - m1) / (1 + dn) - x**2) * sn) / denominator
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
        moves = x > 0
        scale = jnp.where(moves, x, 1)
        sine, cosine = _of_half(block)
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


def as_model(model: Any) -> RockingModel:
    """Return the model itself, from its name too; anything else is a `ValueError`."""
    if isinstance(model, RockingModel):
        return model
    for kind in (Linearized, Nonlinear):
        if model == kind.name:
            return kind()
    raise ValueError(
        'model must be Linearized(), Nonlinear(), "linearized" or "nonlinear",'
        f" got {describe(model)}"
    )


def _barrier(x: Reals) -> Reals:
    """Square root of the missing energy, k = sqrt(1 - x^2)."""
    return jnp.sqrt(one_minus_square(x))


def _weight_of(intensity: Reals, block: Block) -> Reals:
    """Express a pulse as a pure number; its square is twice the peak of a weak one."""
    return intensity / jnp.sqrt(block.gravity * block.half_width * block.inertia_ratio)


def _of_half(block: Block) -> tuple[Reals, Reals]:
    """Sine and cosine of half the critical angle."""
    h = diagonal_ratio(block)
    slenderness = block.slenderness
    return jnp.sqrt(0.5 / (h * (h + slenderness))), jnp.sqrt(0.5 * (1 + slenderness / h))


def _stiffening(block: Block, x: Reals) -> tuple[Reals, Reals]:
    """Tau = 1 / (h + lambda), and w = sqrt(1 + tau^2 x^2), which is 1 if linearized."""
    tau = 1 / (diagonal_ratio(block) + block.slenderness)
    return tau, jnp.sqrt(1 + (tau * x) ** 2)
