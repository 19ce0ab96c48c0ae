"""The elastic damped oscillator under the same input (section IV of the paper).

For comparison: what resonance does to a system that has a natural frequency. Each pulse
comes when the oscillator passes zero, every half of its damped period.
"""

import jax.numpy as jnp

from ..host import Printed, shown
from ..numerics import decaying_share_of_one, minus_log, one_minus_square, quotient_or_infinite
from ..validation import (
    BELOW_ONE,
    COUNT,
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Checked,
    Number,
    Reals,
    as_real,
    elementwise,
    quantity,
)


class Oscillator(Printed, Checked):
    """A linear elastic oscillator with viscous damping (Eq. 15).

    Parameters
    ----------
    angular_frequency, damping_ratio : array_like
        omega, undamped [rad/s], greater than 0, and xi, share of critical damping [-], at
        least 0 and below 1.

    Examples
    --------
    >>> from jaxrock.resonance import Oscillator
    >>> print(f"{Oscillator(angular_frequency=6.28, damping_ratio=0.05).amplification:.2f}")
    6.87
    """

    angular_frequency: Reals = quantity(POSITIVE)
    damping_ratio: Reals = quantity(BELOW_ONE)

    def __init__(self, angular_frequency: Number, damping_ratio: Number):
        self.angular_frequency = as_real("angular_frequency", angular_frequency)
        self.damping_ratio = as_real("damping_ratio", damping_ratio)

    def __str__(self) -> str:
        return (
            f"angular frequency {shown(self.angular_frequency, 'rad/s')},"
            f" damping ratio {shown(self.damping_ratio)}"
        )

    @property
    def _damped_share(self) -> Reals:
        return jnp.sqrt(one_minus_square(self.damping_ratio))

    @property
    def _decrement(self) -> Reals:
        """-ln(B)."""
        return jnp.pi * self.damping_ratio / self._damped_share

    @property
    @elementwise()
    def damped_frequency(self) -> Reals:
        """Damped angular frequency, Omega = omega sqrt(1 - xi^2) (Eq. 16) [rad/s]."""
        return self.angular_frequency * self._damped_share

    @property
    @elementwise()
    def velocity_decay(self) -> Reals:
        """Ratio of velocities over a half-cycle, B = exp(-pi xi / sqrt(1 - xi^2)) (Eq. 18) [-].

        What the coefficient of restitution is to the block.
        """
        return jnp.exp(-self._decrement)

    @property
    @elementwise()
    def amplification(self) -> Reals:
        """Stabilized displacement over the first, psi = 1 / (1 - B) (Eq. 23) [-]; inf undamped."""
        share = decaying_share_of_one(self._decrement, jnp.inf)
        return quotient_or_infinite(jnp.ones_like(share), share)

    @elementwise(velocity=FINITE, time=FINITE)
    def motion(self, velocity: Number, time: Number) -> tuple[Reals, Reals]:
        """Displacement [m] and velocity [m/s] at a time after it passed zero (Eq. 16).

        Parameters
        ----------
        velocity, time : array_like
            At zero displacement [m/s], and time since then [s].

        Returns
        -------
        displacement, velocity : Array, shape (...)
        """
        loss = self.damping_ratio * self.angular_frequency
        frequency = self.damped_frequency
        decay = jnp.exp(-loss * time) * velocity
        sine = jnp.sin(frequency * time)
        cosine = jnp.cos(frequency * time)
        return decay * sine / frequency, decay * (cosine - loss / frequency * sine)

    @elementwise(intensity=NON_NEGATIVE, half_cycle=COUNT)
    def half_cycle_velocity(self, intensity: Number, half_cycle: Number) -> Reals:
        """Velocity at the beginning of a half-cycle (Eqs. 14, 20 and 21).

        From the recursion of Eq. 20; its closed sum lacks the last term, as that of Eq. 8.

        Parameters
        ----------
        intensity, half_cycle : array_like
            I, change of velocity in each pulse [m/s], at least 0; i, from 1 on, or inf.

        Returns
        -------
        velocity : Array, shape (...)
            ``I (1 - B^i) / (1 - B)`` [m/s].
        """
        share = decaying_share_of_one(self._decrement, half_cycle)
        return quotient_or_infinite(jnp.asarray(intensity), share)

    @elementwise(velocity=NON_NEGATIVE)
    def quarter_cycle_displacement(self, velocity: Number) -> Reals:
        """Displacement at a quarter of the damped period, as printed in Eq. 22.

        Not the maximum, which comes earlier: see `peak_displacement`.

        Parameters
        ----------
        velocity : array_like
            Where the displacement is 0 [m/s], at least 0.

        Returns
        -------
        displacement : Array, shape (...)
            ``v exp(-pi xi / (2 sqrt(1 - xi^2))) / Omega`` [m].
        """
        return jnp.exp(-self._decrement / 2) / self.damped_frequency * velocity

    @elementwise(velocity=NON_NEGATIVE)
    def peak_displacement(self, velocity: Number) -> Reals:
        """Largest displacement [m], where ``tan(Omega t) = Omega / (xi omega)``.

        Parameters
        ----------
        velocity : array_like
            Where the displacement is 0 [m/s], at least 0.

        Returns
        -------
        displacement : Array, shape (...)
        """
        phase = jnp.arctan2(self._damped_share, self.damping_ratio)
        decay = jnp.exp(-self.damping_ratio / self._damped_share * phase)
        return decay / self.angular_frequency * velocity


@elementwise(restitution=UNIT_INTERVAL)
def equivalent_damping(restitution: Number) -> Reals:
    """Viscous damping ratio [-] equivalent to a coefficient of restitution, as its source means it.

    Makris and Konstantinidis fit ``beta = -0.34 ln(r)`` with r the ratio of kinetic energies
    over an impact, which is the square of the ratio of velocities C.

    Parameters
    ----------
    restitution : array_like
        C [-], between 0 and 1.

    Returns
    -------
    damping_ratio : Array, shape (...)
        ``-0.68 ln(C)``, inf for C = 0.
    """
    return 0.68 * minus_log(jnp.asarray(restitution))


@elementwise(restitution=UNIT_INTERVAL)
def equivalent_damping_as_printed(restitution: Number) -> Reals:
    """Half of `equivalent_damping` [-], as printed in Eq. 13.

    Parameters
    ----------
    restitution : array_like
        C [-], between 0 and 1.

    Returns
    -------
    beta : Array, shape (...)
    """
    return 0.34 * minus_log(jnp.asarray(restitution))


@elementwise(velocity_decay=UNIT_INTERVAL)
def damping_from_decay(velocity_decay: Number) -> Reals:
    """Damping ratio [-] of a lightly damped oscillator, ``-ln(B) / pi`` (Eq. 19).

    Parameters
    ----------
    velocity_decay : array_like
        B [-], between 0 and 1.

    Returns
    -------
    xi : Array, shape (...)
        Which takes ``sqrt(1 - xi^2)`` for 1.
    """
    return minus_log(jnp.asarray(velocity_decay)) / jnp.pi
