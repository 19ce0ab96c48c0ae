"""A block on moving ground, the subject of every driven computation."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..ground_motion import Motion
from ..impact import read_restitution
from ..validation import (
    FINITE,
    POSITIVE,
    UNIT_INTERVAL,
    AnyArray,
    Checked,
    Domain,
    Number,
    Reals,
    as_field,
    is_traced,
    quantity,
)

# A block that lies on its side has turned by pi / 2. In single precision that is rounded up to
# more than the pi / 2 of double precision.
UP_TO_ITS_SIDE = Domain(
    "between -pi / 2 and pi / 2", lambda x: abs(x) <= jnp.pi / 2 + 1e-6, 0.0
)


def is_before_wall(rotation: AnyArray, velocity: AnyArray) -> AnyArray | np.bool_:
    """Return where a one-sided block is neither behind its wall nor moves into it.

    A block that moves into the wall would rebound at once: the state after this impact has to
    be given instead.
    """
    return (rotation > 0) | ((rotation == 0) & (velocity >= 0))


def check_initial_state(block: Block, rotation: Number, velocity: Number) -> None:
    """Raise `ValueError` if a concrete state of a one-sided block is not before its wall."""
    if not block.one_sided or is_traced((rotation, velocity)):
        return
    state = np.asarray(rotation), np.asarray(velocity)
    if not np.all(is_before_wall(*state)):
        raise ValueError(
            "rotation of a one-sided block must be greater than 0, or 0 with a velocity of at"
            f" least 0, got {state[0]} rad and {state[1]} rad/s"
        )


class Driven(Checked):
    """A block, a ground motion, how long the block is followed, and its initial state."""

    block: Block
    restitution: Reals = quantity(UNIT_INTERVAL, "")
    # Type checkers take the declaration of the restitution for a default value.
    motion: Motion  # pyright: ignore[reportGeneralTypeIssues]
    duration: Reals = quantity(POSITIVE, "s")
    rotation: Reals = quantity(UP_TO_ITS_SIDE, "rad")
    velocity: Reals = quantity(FINITE, "rad/s")

    def __init__(
        self,
        block: Block,
        restitution: Number,
        motion: Motion,
        duration: Number,
        rotation: Number,
        velocity: Number,
    ):
        self.block = block
        self.restitution = read_restitution(block, restitution)
        self.motion = motion
        self.duration = as_field(Driven, "duration", duration)
        self.rotation = as_field(Driven, "rotation", rotation)
        self.velocity = as_field(Driven, "velocity", velocity)
        check_initial_state(block, self.rotation, self.velocity)

    def bucketed(self) -> "Driven":
        """Pad the motion to one of few shapes, so that few programs are compiled."""
        return eqx.tree_at(lambda driven: driven.motion, self, self.motion.bucketed())
