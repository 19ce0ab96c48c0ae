"""The equation of driven motion (Eq. 1), written once for all integrators.

Counted from the side s = +1 or -1 on which the block stands: the *lean* is s alpha, 0 on
the ground and positive above it, and ``push`` is s times the horizontal acceleration of the
ground over g. With ``lift``, the vertical acceleration over g,

    lean'' = -p^2 [(1 + lift) sin(alpha_c - lean) - push cos(alpha_c - lean)]

and, linearized in the form of the literature, sin(x) = x and cos(x) = 1. Its limit for
short pulses is not that of Eq. 2: the cosine of alpha_c is missing there.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..block import Block
from ..resonance import Linearized, RockingModel
from ..validation import Reals


def uplift_acceleration(block: Block, model: RockingModel) -> Reals:
    """Acceleration of the ground that just lifts the block [m/s2].

    ``g tan(alpha_c)``; linearized, ``g alpha_c``.
    """
    linearized = isinstance(model, Linearized)
    return block.gravity * (block.critical_angle if linearized else 1 / block.slenderness)


class Equation(eqx.Module):
    """What integrators need of a block."""

    square: Reals  # p^2
    critical_angle: Reals
    critical_velocity: Reals
    gravity: Reals
    tangent: Reals  # of the critical angle: the push that just lifts the block
    model: RockingModel

    @property
    def linearized(self) -> bool:
        """Whether sin(x) is x and cos(x) is 1."""
        return isinstance(self.model, Linearized)

    @classmethod
    def of(cls, block: Block, model: RockingModel) -> "Equation":
        """The equation of a block."""
        angle = block.critical_angle
        return cls(
            square=block.frequency_parameter**2,
            critical_angle=angle,
            critical_velocity=model.critical_velocity(block),
            gravity=jnp.broadcast_to(block.gravity, angle.shape),
            tangent=angle if isinstance(model, Linearized) else 1 / block.slenderness,
            model=model,
        )

    def lean_acceleration(self, sine: Any, cosine: Any, push: Any, lift: Any) -> Any:
        """The right-hand side, of numbers or of power series in time."""
        return (cosine * push - sine * (lift + 1.0)) * self.square

    def acceleration(self, lean: Reals, push: Reals, lift: Reals) -> Reals:
        """Second derivative of the lean in time [rad/s2]."""
        tilt = self.critical_angle - lean
        if self.linearized:
            return self.lean_acceleration(tilt, jnp.ones_like(tilt), push, lift)
        return self.lean_acceleration(jnp.sin(tilt), jnp.cos(tilt), push, lift)

    def lifting(self, push: Reals, lift: Reals) -> Reals:
        """What the push has over what lifts the block from the ground: positive lifts."""
        return push - (1 + lift) * self.tangent

    def returning_speed(self, lean: Reals) -> Reals:
        """Speed at which a block in free motion just fails to come back from a lean.

        Negative beyond the critical angle: there it has to come back as fast as that, at
        least [rad/s].
        """
        rest = self.critical_angle - lean
        root = jnp.sqrt(self.square)
        return root * rest if self.linearized else 2 * root * jnp.sin(rest / 2)

    def landing_speed(self, lean: Reals, speed: Reals) -> Reals:
        """Speed with which free motion through this state meets the ground [rad/s].

        0 where it has less energy than the ground has.
        """
        # The fall from the lean, as a product: as a difference it would not vanish with it.
        if self.linearized:
            fall = lean * (2 * self.critical_angle - lean)
        else:
            fall = 4 * jnp.sin(self.critical_angle - lean / 2) * jnp.sin(lean / 2)
        energy = speed**2 + self.square * fall
        positive = energy > 0
        return jnp.where(positive, jnp.sqrt(jnp.where(positive, energy, 1)), 0)
