"""What an answer of a block on moving ground depends on."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..driven import check_batch
from ..ground_motion import Harmonic, Motion, Pulse, Suite
from ..validation import POSITIVE, Number, as_field, as_real, check

# The highest rotation may come after the end of the ground motion [s].
BEYOND = 10.0


def gather_parameters(
    block: Block, restitution: Number, motion: Motion | Suite, scale: Number
) -> dict[str, Any]:
    """Gather what may vary; `scale` is a factor on any motion, besides its own numbers.

    Raises
    ------
    ValueError
        If an argument is out of range or not single.
    """
    restitution, _ = check_batch(block, restitution, motion, None)
    check("scale", as_real("scale", scale), POSITIVE)
    at = {name: getattr(motion, name) for name in name_fields(motion)}
    at |= {"block": block, "restitution": restitution, "scale": scale}
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
