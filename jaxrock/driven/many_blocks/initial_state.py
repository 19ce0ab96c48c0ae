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
        return cls(
            side, *_measure_from_start(side * rotation, side * velocity, equation, start)
        )


_State = tuple[Reals, Reals, Reals]  # rotation, velocity, and the time since the start


@jax.custom_jvp
def _measure_from_start(
    rotation: Reals, velocity: Reals, equation: Equation, start: Reals
) -> _State:
    """Return the state at time 0, with a one-sided derivative where the motion starts then.

    A start at time 0 cannot move to an earlier time. The derivative is for a later start, as in
    `respond`: until then the block moves freely.
    """
    del equation
    return rotation, velocity, -start


@_measure_from_start.defjvp
def _differentiate_state(
    primals: tuple[Reals, Reals, Equation, Reals],
    tangents: tuple[Reals, Reals, Equation, Reals],
) -> tuple[_State, _State]:
    """Differentiate `_measure_from_start`."""
    *_, equation, start = primals
    rotation_change, velocity_change, _, start_change = tangents
    # Once more by the function itself, for second derivatives.
    rotation, velocity, elapsed = _measure_from_start(*primals)
    tilt = equation.critical_angle - rotation
    push = jnp.zeros_like(tilt)
    acceleration = equation.right_hand_side(*tilt_sine_cosine(equation, tilt), push, 0.0)
    moves = (rotation != 0) | (velocity != 0)
    begins = start == 0
    delay = jnp.where(moves & begins, start_change, 0)
    changes = (
        rotation_change + delay * velocity,
        velocity_change + delay * acceleration,
        jnp.where(begins, 0, -start_change),
    )
    return (rotation, velocity, elapsed), changes
