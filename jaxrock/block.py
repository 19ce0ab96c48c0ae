"""The block: its geometry, and what follows from geometry and gravity alone."""

import jax.numpy as jnp

from .host import shown
from .numerics import angle
from .validation import (
    NON_NEGATIVE,
    POSITIVE,
    Checked,
    Number,
    Reals,
    as_real,
    check,
    elementwise,
    quantity,
)


class Block(Checked):
    """A rigid, homogeneous, rectangular block standing on a rigid base (Fig. 1).

    Parameters
    ----------
    half_width, slenderness, gravity : array_like
        b, half the width of the base [m], lambda = a / b, height over width [-], and g,
        acceleration of gravity [m/s2]; finite and greater than 0. They broadcast.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{block.critical_angle:.4f} rad")
    0.1974 rad
    """

    half_width: Reals = quantity(POSITIVE)
    slenderness: Reals = quantity(POSITIVE)
    gravity: Reals = quantity(POSITIVE)

    def __init__(self, half_width: Number, slenderness: Number, gravity: Number = 9.81):
        self.half_width = as_real("half_width", half_width)
        self.slenderness = as_real("slenderness", slenderness)
        self.gravity = as_real("gravity", gravity)

    def __str__(self) -> str:
        return (
            f"half-width {shown(self.half_width, 'm')}, slenderness {shown(self.slenderness)},"
            f" gravity {shown(self.gravity, 'm/s2')}"
        )

    @classmethod
    def from_size(cls, width: Number, height: Number, gravity: Number = 9.81) -> "Block":
        """The block of a given full width 2b [m] and height 2a [m].

        Parameters
        ----------
        width, height, gravity : array_like

        Returns
        -------
        Block

        Raises
        ------
        ValueError
            If a concrete value is not finite and greater than 0.
        """
        width, height = as_real("width", width), as_real("height", height)
        check("width", width, POSITIVE)
        check("height", height, POSITIVE)
        return cls(width / 2, height / width, gravity)

    @property
    @elementwise()
    def half_height(self) -> Reals:
        """Half the height, a = lambda b [m]."""
        return self.slenderness * self.half_width

    @property
    @elementwise()
    def half_diagonal(self) -> Reals:
        """Distance from the centre to a corner, R = sqrt(a^2 + b^2) [m]."""
        return self.half_width * diagonal_ratio(self)

    @property
    @elementwise()
    def critical_angle(self) -> Reals:
        """Rotation of unstable equilibrium, alpha_c = arctan(1 / lambda) [rad]."""
        return angle(1.0, self.slenderness)

    @property
    @elementwise()
    def frequency_parameter(self) -> Reals:
        """Rate of free rocking near equilibrium, p = sqrt(3 g / (4 R)) [1/s]."""
        return jnp.sqrt(0.75 * self.gravity / (self.half_width * diagonal_ratio(self)))

    @elementwise(intensity=NON_NEGATIVE)
    def pulse_velocity(self, intensity: Number) -> Reals:
        """Angular velocity that an instantaneous pulse gives to the block at rest (Eq. 2).

        By conservation of angular momentum about the corner, for any slenderness.

        Parameters
        ----------
        intensity : array_like
            I, change of the ground velocity [m/s], at least 0.

        Returns
        -------
        velocity : Array, shape (...)
            ``3 lambda I / (4 b (1 + lambda^2))`` [rad/s].
        """
        shape = self.slenderness / (1 + self.slenderness**2)
        return 0.75 * shape * intensity / self.half_width


def diagonal_ratio(block: Block) -> Reals:
    """R / b = sqrt(1 + lambda^2); ``1 / (R / b)`` is sin(alpha_c)."""
    return jnp.sqrt(1 + block.slenderness**2)
