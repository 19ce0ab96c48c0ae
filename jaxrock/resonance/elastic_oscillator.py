"""The elastic damped oscillator under the same input (section IV of the paper).

It serves as a comparison: this is what resonance does to a system that has a natural
frequency. Each pulse comes when the oscillator passes zero, every half of its damped period.
"""

import jax.numpy as jnp

from ..host import Printed, format_number
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
    as_field,
    elementwise,
    quantity,
)


class Oscillator(Printed, Checked):
    """A linear elastic oscillator with viscous damping (Eq. 15).

    Parameters
    ----------
    angular_frequency : array_like
        omega, undamped [rad/s], finite and greater than 0.
    damping_ratio : array_like
        xi, fraction of critical damping [-], at least 0 and less than 1.

    Examples
    --------
    >>> from jaxrock.resonance import Oscillator
    >>> print(f"{Oscillator(angular_frequency=6.28, damping_ratio=0.05).amplification:.2f}")
    6.87
    """

    angular_frequency: Reals = quantity(POSITIVE, "rad/s")
    damping_ratio: Reals = quantity(BELOW_ONE, "")

    def __init__(self, angular_frequency: Number, damping_ratio: Number):
        self.angular_frequency = as_field(Oscillator, "angular_frequency", angular_frequency)
        self.damping_ratio = as_field(Oscillator, "damping_ratio", damping_ratio)

    def __str__(self) -> str:
        return (
            f"angular frequency {format_number(self.angular_frequency, 'rad/s')},"
            f" damping ratio {format_number(self.damping_ratio)}"
        )

    @property
    def _damped_share(self) -> Reals:
        """Damped over undamped angular frequency, sqrt(1 - xi^2) (Eq. 16) [-]."""
        return jnp.sqrt(one_minus_square(self.damping_ratio))

    @property
    def _decrement(self) -> Reals:
        """Logarithmic decrement over a half-cycle, -ln(B) (Eq. 18) [-]."""
        return jnp.pi * self.damping_ratio / self._damped_share

    @property
    @elementwise()
    def damped_frequency(self) -> Reals:
        """Damped angular frequency, Omega = omega sqrt(1 - xi^2) (Eq. 16) [rad/s]."""
        return self.angular_frequency * self._damped_share

    @property
    @elementwise()
    def velocity_decay(self) -> Reals:
        """Velocity after a half-cycle over the velocity before it, B (Eq. 18) [-].

        It is ``exp(-pi xi / sqrt(1 - xi^2))``, and plays the part that the coefficient of
        restitution plays for the block.
        """
        return jnp.exp(-self._decrement)

    @property
    @elementwise()
    def amplification(self) -> Reals:
        """Stabilized over first displacement, after one pulse: psi = 1 / (1 - B) (Eq. 23) [-].

        It is inf without damping.
        """
        # From the decrement, not from B: with little damping B is close to 1, and 1 - B would
        # lose the digits that matter.
        share = decaying_share_of_one(self._decrement, jnp.inf)
        return quotient_or_infinite(jnp.ones_like(share), share)

    @elementwise(velocity=FINITE, time=FINITE)
    def motion(self, velocity: Number, time: Number) -> tuple[Reals, Reals]:
        """Compute displacement and velocity at a time after the displacement is 0 (Eq. 16).

        Parameters
        ----------
        velocity : array_like
            Velocity at zero displacement [m/s], finite.
        time : array_like
            Time since then [s], finite.

        Returns
        -------
        displacement, velocity : Array, shape (...)
            Displacement [m] and its rate [m/s].

        Raises
        ------
        ValueError
            If a concrete `velocity` or `time` is out of range. A traced one gives NaN.
        """
        # The displacement is v exp(-xi omega t) sin(Omega t) / Omega; the velocity is its
        # derivative.
        loss = self.damping_ratio * self.angular_frequency
        frequency = self.damped_frequency
        decay = jnp.exp(-loss * time) * velocity
        sine = jnp.sin(frequency * time)
        cosine = jnp.cos(frequency * time)
        return decay * sine / frequency, decay * (cosine - loss / frequency * sine)

    @elementwise(intensity=NON_NEGATIVE, half_cycle=COUNT)
    def half_cycle_velocity(self, intensity: Number, half_cycle: Number) -> Reals:
        """Compute the velocity at the beginning of a half-cycle (Eqs. 14, 20 and 21).

        It follows from the recursion of Eq. 20. The closed sum printed there lacks its last
        term, like the sum printed in Eq. 8.

        Parameters
        ----------
        intensity : array_like
            I, change of velocity in each pulse [m/s], finite and at least 0.
        half_cycle : array_like
            i, a whole number from 1 on, or inf.

        Returns
        -------
        velocity : Array, shape (...)
            ``I (1 - B^i) / (1 - B)`` [m/s].

        Raises
        ------
        ValueError
            If a concrete `intensity` or `half_cycle` is out of range. A traced one gives NaN.
        """
        share = decaying_share_of_one(self._decrement, half_cycle)
        return quotient_or_infinite(jnp.asarray(intensity), share)

    @elementwise(velocity=NON_NEGATIVE)
    def quarter_cycle_displacement(self, velocity: Number) -> Reals:
        """Compute the displacement at a quarter of the damped period, as printed in Eq. 22.

        This is not the maximum, which comes earlier: see `peak_displacement`.

        Parameters
        ----------
        velocity : array_like
            Velocity at zero displacement [m/s], finite and at least 0.

        Returns
        -------
        displacement : Array, shape (...)
            ``v exp(-pi xi / (2 sqrt(1 - xi^2))) / Omega`` [m].

        Raises
        ------
        ValueError
            If a concrete `velocity` is out of range. A traced one gives NaN.
        """
        return jnp.exp(-self._decrement / 2) / self.damped_frequency * velocity

    @elementwise(velocity=NON_NEGATIVE)
    def peak_displacement(self, velocity: Number) -> Reals:
        """Compute the largest displacement, where ``tan(Omega t) = Omega / (xi omega)``.

        Parameters
        ----------
        velocity : array_like
            Velocity at zero displacement [m/s], finite and at least 0.

        Returns
        -------
        displacement : Array, shape (...)
            [m]

        Raises
        ------
        ValueError
            If a concrete `velocity` is out of range. A traced one gives NaN.
        """
        # The angle of a right triangle instead of a quotient: without damping it is pi / 2.
        phase = jnp.arctan2(self._damped_share, self.damping_ratio)
        decay = jnp.exp(-self.damping_ratio / self._damped_share * phase)
        return decay / self.angular_frequency * velocity


@elementwise(restitution=UNIT_INTERVAL)
def equivalent_damping(restitution: Number) -> Reals:
    """Compute the viscous damping ratio that is equivalent to a coefficient of restitution.

    Makris and Konstantinidis (2003, https://doi.org/10.1002/eqe.239) fit
    ``beta = -0.34 ln(r)``, where r is the kinetic energy after an impact over the kinetic
    energy before it. It is the square of C, the ratio of the velocities.

    Parameters
    ----------
    restitution : array_like
        C [-], between 0 and 1.

    Returns
    -------
    damping_ratio : Array, shape (...)
        ``-0.68 ln(C)`` [-], inf for C = 0.

    Raises
    ------
    ValueError
        If a concrete `restitution` is out of range. A traced one gives NaN.
    """
    # 0.68 = 2 * 0.34, since ln(C^2) = 2 ln(C).
    return 0.68 * minus_log(jnp.asarray(restitution))


@elementwise(restitution=UNIT_INTERVAL)
def equivalent_damping_as_printed(restitution: Number) -> Reals:
    """Compute the damping ratio as printed in Eq. 13: half of `equivalent_damping`.

    Eq. 13 takes C itself where its source takes the ratio of kinetic energies, C squared.

    Parameters
    ----------
    restitution : array_like
        C [-], between 0 and 1.

    Returns
    -------
    beta : Array, shape (...)
        ``-0.34 ln(C)`` [-], inf for C = 0.

    Raises
    ------
    ValueError
        If a concrete `restitution` is out of range. A traced one gives NaN.
    """
    return 0.34 * minus_log(jnp.asarray(restitution))


@elementwise(velocity_decay=UNIT_INTERVAL)
def damping_from_decay(velocity_decay: Number) -> Reals:
    """Compute the damping ratio of a lightly damped oscillator, ``-ln(B) / pi`` (Eq. 19).

    Parameters
    ----------
    velocity_decay : array_like
        B [-], between 0 and 1.

    Returns
    -------
    xi : Array, shape (...)
        Damping ratio [-], with ``sqrt(1 - xi^2)`` approximated by 1; inf for B = 0.

    Raises
    ------
    ValueError
        If a concrete `velocity_decay` is out of range. A traced one gives NaN.
    """
    return minus_log(jnp.asarray(velocity_decay)) / jnp.pi
