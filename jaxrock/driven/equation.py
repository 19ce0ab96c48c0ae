"""The equation of driven motion (Eq. 1), written once for all integrators.

In this package the rotation is counted from the side s = +1 or -1 on which the block stands:
it is s alpha, 0 on the ground and positive above it. A one-sided block has the side +1 alone.
``push`` is s times the horizontal acceleration of the ground over g, ``lift`` the vertical
acceleration over g:

    rotation'' = -p^2 [(1 + lift) sin(alpha_c - rotation) - push cos(alpha_c - rotation)]

In the linearized equation of the literature sin(x) = x and cos(x) = 1. Its limit for short
pulses is not Eq. 2: in Eq. 2 the pulse is multiplied by cos(alpha_c), here by 1.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..resonance import Linearized, Nonlinear, RockingModel
from ..validation import Reals, describe


def is_linearized(model: RockingModel) -> bool:
    """Return whether a model is linearized; a `ValueError` for a user's own model."""
    # Subclasses are refused as well: they change free rocking, but not this equation.
    if type(model) not in (Linearized, Nonlinear):
        raise ValueError(
            f"model must be Linearized or Nonlinear for driven motion, got {describe(model)}"
        )
    return isinstance(model, Linearized)


def uplift_acceleration(block: Block, model: RockingModel) -> Reals:
    """Ground acceleration that just lifts the block [m/s2].

    It is g tan(alpha_c), and linearized g alpha_c.
    """
    tangent = block.critical_angle if is_linearized(model) else 1 / block.slenderness
    return block.gravity * tangent


class Equation(eqx.Module):
    """The equation of motion of a block, on the side on which it stands."""

    p_squared: Reals  # [1/s2]
    critical_angle: Reals  # [rad]
    critical_velocity: Reals  # that overturns a block from the ground [rad/s]
    gravity: Reals  # [m/s2]
    inertia_ratio: Reals  # used for the forces at the base only
    tangent: Reals  # tangent of the critical angle: the push that just lifts the block
    model: RockingModel
    one_sided: bool = eqx.field(static=True)  # whether a wall stands on the side -1
    velocity_unit: Reals | None = None  # [rad/s], for an impact law, if it is another one

    @property
    def linearized(self) -> bool:
        """True where sin(x) = x and cos(x) = 1."""
        return is_linearized(self.model)

    @classmethod
    def of(cls, block: Block, model: RockingModel) -> "Equation":
        """Make the equation of a block."""
        angle = block.critical_angle
        # All fields have one shape, so that blocks can be stacked.
        return cls(
            p_squared=block.frequency_parameter**2,
            critical_angle=angle,
            critical_velocity=model.critical_velocity(block),
            gravity=jnp.broadcast_to(block.gravity, angle.shape),
            inertia_ratio=jnp.broadcast_to(block.inertia_ratio, angle.shape),
            tangent=angle if is_linearized(model) else 1 / block.slenderness,
            model=model,
            one_sided=block.one_sided,
        )

    def right_hand_side(
        self, sine: Reals, cosine: Reals, push: Reals, lift: Reals | float
    ) -> Reals:
        """Compute the angular acceleration from sine and cosine of the tilt from balance."""
        return (cosine * push - sine * (lift + 1.0)) * self.p_squared

    def acceleration(self, rotation: Reals, push: Reals, lift: Reals) -> Reals:
        """Angular acceleration [rad/s2]."""
        tilt = self.critical_angle - rotation
        if self.linearized:
            return self.right_hand_side(tilt, jnp.ones_like(tilt), push, lift)
        return self.right_hand_side(jnp.sin(tilt), jnp.cos(tilt), push, lift)

    def expand_acceleration(
        self, rotation: Reals, velocity: Reals, push: Reals, lift: Reals
    ) -> tuple[Reals, Reals, Reals]:
        """Angular acceleration and its first two derivatives in time, along the motion.

        `push` and `lift`, of shape (3,), hold the input and its derivatives likewise.
        """
        tilt = self.critical_angle - rotation
        sine, cosine = (tilt, 1.0) if self.linearized else (jnp.sin(tilt), jnp.cos(tilt))
        bent = 0.0 if self.linearized else 1.0
        weight = lift + np.array([1.0, 0, 0], lift.dtype)
        # The right-hand side and its slope over the rotation, for each derivative of the input.
        values = (cosine * push - sine * weight) * self.p_squared
        slopes = (bent * sine * push + cosine * weight) * self.p_squared
        jerk = values[1] + velocity * slopes[0]
        snap = values[2] + 2 * velocity * slopes[1] + values[0] * slopes[0]
        return values[0], jerk, snap - bent * velocity**2 * values[0]

    def uplift_excess(self, push: Reals, lift: Reals) -> Reals:
        """Push in excess of the push that just lifts the block; a positive excess lifts it."""
        return push - (1 + lift) * self.tangent

    def returning_velocity(self, rotation: Reals) -> Reals:
        """Outward velocity at which a block in free motion just fails to come back [rad/s].

        Negative beyond the critical angle: from there it must move back at least as fast.
        """
        remaining = self.critical_angle - rotation
        p = jnp.sqrt(self.p_squared)
        return p * remaining if self.linearized else 2 * p * jnp.sin(remaining / 2)

    def landing_velocity(self, rotation: Reals, velocity: Reals) -> Reals:
        """Magnitude of the velocity that a block would have on the ground, by energy [rad/s].

        It is 0 where the energy does not suffice. It is defined for a block that overturns as
        well, although that never lands.
        """
        # The fall is computed as a product: the rounding error of a difference would not
        # vanish with the fall.
        if self.linearized:
            fall = rotation * (2 * self.critical_angle - rotation)
        else:
            fall = 4 * jnp.sin(self.critical_angle - rotation / 2) * jnp.sin(rotation / 2)
        energy = velocity**2 + self.p_squared * fall
        # Where the root is not used, it is taken of 1: the root of 0 has an infinite
        # derivative.
        positive = energy > 0
        return jnp.where(positive, jnp.sqrt(jnp.where(positive, energy, 1)), 0)
