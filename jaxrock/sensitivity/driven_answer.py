"""What an answer of a block on moving ground depends on."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..driven import check_batch
from ..ground_motion import Harmonic, Motion, Pulse, Suite
from ..validation import Number, as_field

# The highest rotation may come after the end of the ground motion [s].
BEYOND = 10.0


def gather_parameters(
    block: Block, restitution: Number, motion: Motion | Suite
) -> dict[str, Any]:
    """Gather what may vary; a factor on any motion is among it, besides its own numbers.

    Raises
    ------
    ValueError
        If an argument is out of range or not single.
    """
    restitution, _ = check_batch(block, restitution, motion, None)
    at = {name: getattr(motion, name) for name in name_fields(motion)}
    at |= {"block": block, "restitution": restitution, "factor": 1.0}
    if any(np.ndim(leaf) for leaf in jax.tree.leaves(at)):
        raise ValueError("block, restitution and motion must be single, got arrays")
    return at


def change_motion(motion: Any, at: Mapping[str, Any]) -> Any:
    """Replace the numbers of a motion by those that `gather_parameters` names."""
    for name in name_fields(motion):
        value = as_field(type(motion), name, at[name])
        motion = eqx.tree_at(lambda part, name=name: getattr(part, name), motion, value)
    return motion


def name_fields(motion: Motion | Suite) -> tuple[str, ...]:
    """Name the numbers of a motion that may vary."""
    if isinstance(motion, Pulse):
        return ("amplitude", "duration")
    return ("amplitude", "frequency") if isinstance(motion, Harmonic) else ()


def choose_duration(motion: Motion, answer: str) -> Number | None:
    """Choose how long to simulate: the margin is known at the end of the motion, by energy."""
    return None if answer == "margin" else motion.end + BEYOND
