"""The states of blocks at time 0, on the sides on which they stand."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ...validation import Reals
from ..equation import Equation
from .ground_input import PerBlock
from .taylor import tilt_sine_cosine


class InitialState(NamedTuple):
    """The state of each block at time 0, from the side on which it stands."""

    side: PerBlock  # 1 or -1
    rotation: PerBlock
    velocity: PerBlock
    elapsed: PerBlock  # time since the start of the motion; negative before it

    @classmethod
    def of(
        cls, equation: Equation, rotation: Reals, velocity: Reals, start: Reals
    ) -> "InitialState":
        """Take the side from the sign of the rotation, or where that is 0 of the velocity."""
        towards = jnp.where(rotation == 0, velocity, rotation)
        side = jnp.where(towards < 0, -1, 1).astype(towards.dtype)
        rotation = side * rotation
        velocity = side * velocity

        # A start at time 0 cannot move to an earlier time. The derivative is for a later start,
        # as in `respond`: until then the block moves freely, for a delay that is 0 and has a
        # derivative. The terms of second order serve second derivatives.
        begins = start == 0
        delay = start - jax.lax.stop_gradient(start)
        delay = jnp.where(begins & (towards != 0), delay, 0)
        tilt = equation.critical_angle - rotation - 0.5 * delay * velocity
        push = jnp.zeros_like(tilt)
        acceleration = equation.right_hand_side(*tilt_sine_cosine(equation, tilt), push, 0.0)
        return cls(
            side=side,
            rotation=rotation + delay * (velocity + 0.5 * delay * acceleration),
            velocity=velocity + delay * acceleration,
            elapsed=jnp.where(begins, 0, -start),
        )
