"""The questions that a model of free rocking answers, and the functions it provides."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..validation import FINITE, NON_NEGATIVE, Number, Reals, elementwise


class RockingModel(eqx.Module):
    """A model of free rocking: `Linearized`, `Nonlinear`, or a third one of the same kind.

    The public methods check their arguments. Where a launch overturns the block, peaks and
    durations are NaN, and `motion` is still defined. The methods are the same for all models.
    A model provides a `name` and seven functions, which broadcast, check nothing, and are
    called by the other closed forms and by `accuracy`. They take ``x``, the launch velocity
    over the critical one [-]; ``intensity``, I of the pulse that gives this velocity to the
    block at rest [m/s]; ``time`` since the launch [s]. Their derivatives, as JAX takes them,
    have to be finite in the whole domain.

    ==================================================  ====================  ================
    function                                            value                 domain
    ==================================================  ====================  ================
    ``_critical_velocity(block)``                       v_c [rad/s]           all blocks
    ``_peak_rotation(block, x, intensity)``             peak rotation [rad]   0 <= x < 1
    ``_rotation_ratio(block, x)``                       peak / alpha_c [-]    0 <= x < 1
    ``_peak_amplification(block, x, growth)``           peak after a launch   growth >= 0,
                                                        ``1 + growth`` times  x (1 + growth)
                                                        as fast / peak [-]    < 1
    ``_half_cycle_duration(block, x, intensity)``       time to impact [s]    0 <= x < 1
    ``_rotation(block, x, time)``                       rotation [rad]; < 0   x >= 0, all
                                                        after the impact      times
    ``_time_from_ground(block, rotation, x, q)``        time [s], see below   x >= 0, 0 <= q,
                                                                              q <= x
    ==================================================  ====================  ================

    ``_time_from_ground`` is the time from the launch to a rotation [rad] on the way up, where
    the velocity over v_c is q; by symmetry also the time from there down to the impact. x may
    exceed 1; the rotation is at least 0 and at most alpha_c.

    Notes
    -----
    The functions take x and the pulse instead of the velocity. In terms of the velocity,
    derivatives would lose digits in differences: slenderness and width act on the velocity and
    on peak and duration in opposite ways.
    """

    name: ClassVar[str]  # in datasets and options

    # Arguments, values and domains are in the table above.
    _critical_velocity: ClassVar[Callable[..., Reals]]
    _peak_rotation: ClassVar[Callable[..., Reals]]
    _rotation_ratio: ClassVar[Callable[..., Reals]]
    _peak_amplification: ClassVar[Callable[..., Reals]]
    _half_cycle_duration: ClassVar[Callable[..., Reals]]
    _rotation: ClassVar[Callable[..., Reals]]
    _time_from_ground: ClassVar[Callable[..., Reals]]

    @elementwise()
    def critical_velocity(self, block: Block) -> Reals:
        """Compute the launch velocity that just overturns the block.

        Parameters
        ----------
        block : Block

        Returns
        -------
        Array, shape (...)
            ``alpha_c p`` (`Linearized`) or ``2 p sin(alpha_c / 2)`` (`Nonlinear`) [rad/s].
        """
        return self._critical_velocity(block)

    @elementwise(velocity=NON_NEGATIVE)
    def peak_rotation(self, block: Block, velocity: Number) -> Reals:
        """Compute the largest rotation after a launch (Eqs. 6 and 12).

        Parameters
        ----------
        block : Block
        velocity : array_like
            Launch velocity [rad/s], finite and at least 0.

        Returns
        -------
        Array, shape (...)
            Peak rotation [rad]; NaN where the launch overturns the block.

        Raises
        ------
        ValueError
            If a concrete `velocity` is out of range. A traced one gives NaN.
        """
        return self._compute_where_standing(self._peak_rotation, block, velocity)

    @elementwise(velocity=NON_NEGATIVE)
    def half_cycle_duration(self, block: Block, velocity: Number) -> Reals:
        """Compute the time from a launch to the next impact (Eqs. 7 and 9).

        Parameters
        ----------
        block : Block
        velocity : array_like
            Launch velocity [rad/s], finite and at least 0.

        Returns
        -------
        Array, shape (...)
            Time [s]; NaN where the launch overturns the block.

        Raises
        ------
        ValueError
            If a concrete `velocity` is out of range. A traced one gives NaN.
        """
        return self._compute_where_standing(self._half_cycle_duration, block, velocity)

    @elementwise(velocity=NON_NEGATIVE, time=FINITE)
    def motion(self, block: Block, velocity: Number, time: Number) -> tuple[Reals, Reals]:
        """Compute rotation and angular velocity at a time after a launch (Eq. 5).

        The motion goes on as if there were no ground: after the next impact, at
        `half_cycle_duration`, the rotation is negative. From `critical_velocity` on the block
        overturns.

        Parameters
        ----------
        block : Block
        velocity : array_like
            Launch velocity [rad/s], finite and at least 0.
        time : array_like
            Time since the launch [s], finite.

        Returns
        -------
        tuple of Array, shape (...)
            Rotation [rad] and angular velocity [rad/s]; NaN where the linearized motion, which
            grows without bound, leaves the range of floating-point numbers.

        Raises
        ------
        ValueError
            If a concrete `velocity` or `time` is out of range. A traced one gives NaN.
        """
        x = velocity / self._critical_velocity(block)
        x, time = jnp.broadcast_arrays(x, time)
        # The velocity is the derivative of the rotation: no model states it a second time.
        return jax.jvp(lambda t: self._rotation(block, x, t), (time,), (jnp.ones_like(time),))

    def _compute_where_standing(
        self, quantity: Callable[[Block, Reals, Reals], Reals], block: Block, velocity: Number
    ) -> Reals:
        """Compute a quantity of block, x and pulse; NaN where the block overturns."""
        x = velocity / self._critical_velocity(block)
        stands = x < 1
        # Stand-ins where the block overturns: the derivative of `where` includes both
        # branches, and one that is NaN would spoil the sum.
        x = jnp.where(stands, x, 0)
        velocity = jnp.where(stands, velocity, 0)
        intensity = velocity / block.pulse_velocity(1.0)
        return jnp.where(stands, quantity(block, x, intensity), jnp.nan)
