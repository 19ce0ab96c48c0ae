"""The elastic damped oscillator under the same input, and the damping equivalent to impacts.

The oscillator serves as a comparison (section IV of the paper): this is what resonance does to a
system that has a natural frequency. Each pulse comes when the oscillator passes zero, every half
of its damped period. Only the recomputed paper needs its formulas; they check nothing.
"""

import jax.numpy as jnp

from ..numerics import minus_log
from ..validation import UNIT_INTERVAL, Booleans, Number, Reals, elementwise


def velocity_decay(damping_ratio: Number) -> Reals:
    """Compute the velocity after a half-cycle over the velocity before it, B (Eq. 18) [-].

    It plays the part that the coefficient of restitution plays for the block.
    """
    return jnp.exp(-jnp.pi * damping_ratio / jnp.sqrt(1 - damping_ratio**2))


def damping_from_decay(velocity_decay: Number) -> Reals:
    """Compute the damping ratio if there is little of it, -ln(B) / pi (Eq. 19) [-]."""
    return minus_log(jnp.asarray(velocity_decay)) / jnp.pi


def elastic_amplification(damping_ratio: Number) -> Reals:
    """Compute stabilized over first displacement, psi = 1 / (1 - B) (Eq. 23) [-]."""
    return 1 / (1 - velocity_decay(damping_ratio))


def quarter_cycle_displacement(damping_ratio: Number) -> Reals:
    """Compute the displacement [m] as printed in Eq. 22, for v = 1 m/s and omega = 1 rad/s."""
    return jnp.sqrt(velocity_decay(damping_ratio) / (1 - damping_ratio**2))


def peak_displacement(damping_ratio: Number) -> Reals:
    """Compute the largest displacement of the same oscillator [m], which comes earlier."""
    root = jnp.sqrt(1 - damping_ratio**2)
    return jnp.exp(-jnp.arctan2(root, damping_ratio) * damping_ratio / root)


@elementwise(restitution=UNIT_INTERVAL)
def equivalent_damping(restitution: Number, as_printed: Booleans | bool = False) -> Reals:
    """Compute the viscous damping ratio that is equivalent to a coefficient of restitution.

    Makris and Konstantinidis (2003, https://doi.org/10.1002/eqe.239) fit
    ``beta = -0.34 ln(r)``, where r is the kinetic energy after an impact over the kinetic
    energy before it. It is the square of C, the ratio of the velocities.

    Parameters
    ----------
    restitution : array_like
        C [-], between 0 and 1.
    as_printed : bool
        Whether to take C itself where the source takes the ratio of kinetic energies, as Eq. 13
        is printed: half of the damping.

    Returns
    -------
    damping_ratio : Array, shape (...)
        ``-0.68 ln(C)`` [-], or ``-0.34 ln(C)`` as printed; inf for C = 0.

    Raises
    ------
    ValueError
        If a concrete `restitution` is out of range. A traced one gives NaN.
    """
    # 0.68 = 2 * 0.34, since ln(C^2) = 2 ln(C).
    return jnp.where(as_printed, 0.34, 0.68) * minus_log(jnp.asarray(restitution))
