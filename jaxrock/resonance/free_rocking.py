"""Free rocking between two impacts, in closed form: two models.

`Linearized` is exact for slender blocks (Eq. 4), `Nonlinear` for any block (Eq. 1
without input). Both answer the same questions. Free rocking conserves energy, so a
block lands as fast as it took off, and all of it depends on ``x = velocity /
critical_velocity``: the block stands while x < 1, and overturns from 1 on.

Notation in the code: ``h = sqrt(1 + lambda^2)`` is R / b, ``k = sqrt(1 - x^2)`` is the
square root of the energy left to the barrier (as a share of it), and ``tau =
tan(alpha_c / 2)``.
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp

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
from ..validation import FINITE, GROWTH, NON_NEGATIVE, Number, Reals, elementwise


class RockingModel(eqx.Module):
    """What both models can answer; see `Linearized` and `Nonlinear`.

    A model is written in terms of x and of the pulse that gives the launch velocity to the
    block at rest. The pulse, and not the velocity, because velocity and peak, velocity
    and duration depend on slenderness and width in opposite ways: their slopes cancel.
    """

    name: ClassVar[str]  # in datasets and options

    @abc.abstractmethod
    def _critical_velocity(self, block: Block) -> Reals: ...

    @abc.abstractmethod
    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals: ...

    @abc.abstractmethod
    def _rotation_ratio(self, block: Block, x: Reals) -> Reals: ...

    @abc.abstractmethod
    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals: ...

    @abc.abstractmethod
    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals: ...

    @abc.abstractmethod
    def _rotation(self, block: Block, x: Reals, time: Reals) -> Reals: ...

    @abc.abstractmethod
    def _time_from_ground(self, block: Block, rotation: Reals, x: Reals, q: Reals) -> Reals:
        """From the launch to a state on the way up, q = velocity / critical velocity there.

        By symmetry also from a state on the way down to the impact, where x may exceed 1.
        """

    @elementwise()
    def critical_velocity(self, block: Block) -> Reals:
        """Launch velocity that just overturns the block.

        Parameters
        ----------
        block : Block

        Returns
        -------
        velocity : Array, shape (...)
            ``alpha_c p`` (`Linearized`) or ``2 p sin(alpha_c / 2)`` (`Nonlinear`) [rad/s].
        """
        return self._critical_velocity(block)

    @elementwise(velocity=NON_NEGATIVE)
    def peak_rotation(self, block: Block, velocity: Number) -> Reals:
        """Largest rotation after a launch (Eqs. 6 and 12).

        Parameters
        ----------
        block : Block
        velocity : array_like
            Launch velocity [rad/s], finite and at least 0.

        Returns
        -------
        rotation : Array, shape (...)
            Peak rotation [rad]; NaN where the launch overturns the block.

        Raises
        ------
        ValueError
            If a concrete velocity is not finite or negative; traced, it gives NaN.
        """
        return self._where_standing(self._peak_rotation, block, velocity)

    @elementwise(velocity=NON_NEGATIVE)
    def half_cycle_duration(self, block: Block, velocity: Number) -> Reals:
        """Time from a launch to the next impact (Eqs. 7 and 9).

        Parameters
        ----------
        block : Block
        velocity : array_like
            Of the launch [rad/s], finite and at least 0.

        Returns
        -------
        duration : Array, shape (...)
            Time [s]; NaN where the launch overturns the block.

        Raises
        ------
        ValueError
            As `peak_rotation`.
        """
        return self._where_standing(self._half_cycle_duration, block, velocity)

    @elementwise(velocity=NON_NEGATIVE, time=FINITE)
    def motion(self, block: Block, velocity: Number, time: Number) -> tuple[Reals, Reals]:
        """Rotation and angular velocity at a time after the launch (Eq. 5).

        The solution without the ground: past the next impact, at `half_cycle_duration`,
        it goes on below zero. A launch faster than `critical_velocity` carries the block
        over.

        Parameters
        ----------
        block : Block
        velocity : array_like
            Launch velocity [rad/s], finite and at least 0.
        time : array_like
            Time since the launch [s], finite.

        Returns
        -------
        rotation, velocity : Array, shape (...)
            Rotation [rad] and angular velocity [rad/s]; NaN where the linearized motion,
            which grows without bound, leaves the range of floating-point numbers.

        Raises
        ------
        ValueError
            If a concrete velocity or time is out of range; traced, it gives NaN.
        """
        x = velocity / self._critical_velocity(block)
        x, time = jnp.broadcast_arrays(x, time)
        return jax.jvp(lambda t: self._rotation(block, x, t), (time,), (jnp.ones_like(time),))

    @elementwise(velocity=NON_NEGATIVE, growth=GROWTH)
    def peak_amplification(self, block: Block, velocity: Number, growth: Number) -> Reals:
        """How many times higher a block rocks if launched ``1 + growth`` times as fast.

        As a function of its own because the quotient of two peaks loses its derivatives
        where they are small, and its digits where they are almost equal.

        Parameters
        ----------
        block : Block
        velocity : array_like
            Slower launch velocity [rad/s], finite and at least 0.
        growth : array_like
            Relative increase of the launch velocity [-], at least 0.

        Returns
        -------
        amplification : Array, shape (...)
            ``peak_rotation(velocity * (1 + growth)) / peak_rotation(velocity)`` [-], with
            its limit ``(1 + growth)^2`` at zero velocity; NaN where the faster launch
            overturns the block.

        Raises
        ------
        ValueError
            If a concrete velocity or growth is out of range; traced, it gives NaN.
        """
        x = velocity / self._critical_velocity(block)
        stands = x * (1 + growth) < 1
        x, growth = jnp.where(stands, x, 0), jnp.where(stands, growth, 0)
        return jnp.where(stands, self._peak_amplification(block, x, growth), jnp.nan)

    def _where_standing(
        self, answer: Callable[[Block, Reals, Reals], Reals], block: Block, velocity: Number
    ) -> Reals:
        x = velocity / self._critical_velocity(block)
        stands = x < 1
        x, velocity = jnp.where(stands, x, 0), jnp.where(stands, velocity, 0)
        intensity = velocity / block.pulse_velocity(1.0)
        return jnp.where(stands, answer(block, x, intensity), jnp.nan)


class Linearized(RockingModel):
    """Free rocking of slender blocks, the equation of motion linearized (Eq. 4).

    At slenderness 3 its critical velocity is 0.43 % too large, its peak and duration 1.5
    to 1.9 % too small up to 0.9 of that velocity; the error falls as 1 / lambda^2.
    """

    name = "linearized"

    def _critical_velocity(self, block: Block) -> Reals:
        return block.critical_angle * block.frequency_parameter

    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # alpha_c x^2: what depends on the slenderness tends to 1 with it.
        cotangent = 1 / block.slenderness
        shape = arctan_ratio(cotangent) * (1 + cotangent**2) ** 1.5
        return _weight_of(intensity, block) ** 2 / (shape * (1 + _barrier(x)))

    def _rotation_ratio(self, block: Block, x: Reals) -> Reals:
        return x**2 / (1 + _barrier(x))

    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals:
        before, after = _barrier(x), _barrier(x * (1 + growth))
        return 1 + growth * (2 + growth) * (1 + before) / (before + after)

    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # 2 x / p = 2 I cos(alpha_c) / (g alpha_c)
        cosine = block.slenderness / diagonal_ratio(block)
        weak = 2 * intensity * cosine / (block.gravity * block.critical_angle)
        return weak * artanh_ratio(x)

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

    From the conservation of energy and Carlson's elliptic integral R_F; the path over
    time by Jacobi's elliptic functions.
    """

    name = "nonlinear"

    def _critical_velocity(self, block: Block) -> Reals:
        return 2 * block.frequency_parameter * _sine_of_half(block)

    def _peak_rotation(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # sin(peak / 2) = tau x^2 / (w + k), and tau x^2 = weight^2 cos(alpha_c)^2 / 2
        cosine_squared = 1 / (1 + block.slenderness**-2)
        tallness = 2 * (_stiffening(block, x) + _barrier(x))
        return 2 * arcsin(_weight_of(intensity, block) ** 2 * cosine_squared / tallness)

    def _rotation_ratio(self, block: Block, x: Reals) -> Reals:
        height = _tangent_of_half(block) * x**2
        sine = quotient(height, _stiffening(block, x) + _barrier(x))
        return 2 * arcsin(sine) / block.critical_angle

    def _peak_amplification(self, block: Block, x: Reals, growth: Reals) -> Reals:
        tau = _tangent_of_half(block)
        x_after = x * (1 + growth)
        before, after = _barrier(x), _barrier(x_after)
        w_before, w_after = _stiffening(block, x), _stiffening(block, x_after)
        gain = growth * (2 + growth)
        crossed = before * w_after + after * w_before
        peak = arcsin_ratio(tau * x**2 / (w_before + before))
        rise = arcsin_ratio(tau * x**2 * gain / crossed)
        return 1 + gain * (w_before + before) / crossed * rise / peak

    def _half_cycle_duration(self, block: Block, x: Reals, intensity: Reals) -> Reals:
        # 2 x / (p cos(alpha_c / 2)) = 2 I lambda / g
        w = _stiffening(block, x)
        left = one_minus_square(x)
        integral = carlson_rf(jnp.ones_like(w), left, left / w**2)
        return 2 * intensity * block.slenderness / (block.gravity * w) * integral

    def _rotation(self, block: Block, x: Reals, time: Reals) -> Reals:
        sine = _sine_of_half(block)
        cosine = jnp.sqrt(0.5 * (1 + block.slenderness / diagonal_ratio(block)))
        m1 = sine**2 * one_minus_square(x)
        sn, cn, dn = jacobi(block.frequency_parameter * time, m1)
        # r is sin((alpha_c - alpha) / 2) over its value at rest, `fall` is 1 - r.
        across = dn + x * cosine * sn * cn
        r = (1 - x**2 * sn**2) / across
        fall = sn * (x * cosine * cn - ((1 - m1) / (1 + dn) - x**2) * sn) / across
        before = r > 0
        r_after = jnp.where(before, 0, r)
        r, fall = jnp.where(before, r, 1), jnp.where(before, fall, 0)
        side = jnp.sqrt(1 - sine**2 * r**2) + r * cosine
        rotation = 2 * jnp.arcsin(sine * fall * (1 + r) / side)
        beyond = block.critical_angle - 2 * jnp.arcsin(sine * r_after)
        return jnp.where(before, rotation, beyond)

    def _time_from_ground(self, block: Block, rotation: Reals, x: Reals, q: Reals) -> Reals:
        # With y = sin((alpha_c - alpha) / 2)^2 it is the integral of
        # dy / (2 p sqrt(y (1 - y) (y - m))), m = sin(alpha_c / 2)^2 (1 - x^2), up to the ground
        # (DLMF 19.29.4); velocity = 2 p sqrt(y - m). Both roots of y - m are taken over x.
        moves = x > 0
        scale = jnp.where(moves, x, 1)
        sine = _sine_of_half(block)
        cosine = jnp.sqrt(0.5 * (1 + block.slenderness / diagonal_ratio(block)))
        to_barrier = 0.5 * (block.critical_angle - rotation)
        sine_there, cosine_there = jnp.sin(to_barrier), jnp.cos(to_barrier)
        root, root_there = sine, sine * jnp.where(moves, q / scale, 1)
        fall = jnp.sin(block.critical_angle - 0.5 * rotation) * jnp.sin(0.5 * rotation)
        integral = carlson_rf(
            (sine * cosine * root_there + sine_there * cosine_there * root) ** 2,
            (sine * root * cosine_there + sine_there * root_there * cosine) ** 2,
            (cosine * root * sine_there + cosine_there * root_there * sine) ** 2,
        )
        return fall / scale * integral / block.frequency_parameter


ModelLike = RockingModel | Literal["linearized", "nonlinear"]


def as_model(model: Any) -> RockingModel:
    """The model, given itself or by its name; anything else is a `ValueError`."""
    if isinstance(model, RockingModel):
        return model
    for kind in (Linearized, Nonlinear):
        if model == kind.name:
            return kind()
    raise ValueError(
        f'model must be Linearized(), Nonlinear(), "linearized" or "nonlinear", got {model!r:.60}'
    )


def _barrier(x: Reals) -> Reals:
    """Square root of the energy left to the barrier, k = sqrt(1 - x^2)."""
    return jnp.sqrt(one_minus_square(x))


def _weight_of(intensity: Reals, block: Block) -> Reals:
    """A pulse as a pure number; its square is twice the peak it causes, if it is weak."""
    return intensity / jnp.sqrt(block.gravity * block.half_width / 0.75)


def _tangent_of_half(block: Block) -> Reals:
    """Tangent of half the critical angle, tau = 1 / (h + lambda)."""
    return 1 / (diagonal_ratio(block) + block.slenderness)


def _sine_of_half(block: Block) -> Reals:
    """Sine of half the critical angle."""
    h = diagonal_ratio(block)
    return jnp.sqrt(0.5 / (h * (h + block.slenderness)))


def _stiffening(block: Block, x: Reals) -> Reals:
    """What is 1 in the linearized equation, w = sqrt(1 + tau^2 x^2)."""
    return jnp.sqrt(1 + (_tangent_of_half(block) * x) ** 2)
