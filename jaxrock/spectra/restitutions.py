"""Restitutions of the blocks that a spectrum makes."""

import numpy as np

from ..block import Block
from ..grids import Values
from ..impact import housner_restitution, one_sided_restitution
from ..validation import as_real


def estimate_restitution(block: Block) -> np.ndarray | np.floating:
    """Compute Housner's restitution, or the magnitude of the one that follows with a wall.

    It is 0 for stocky blocks, which an impact stops.
    """
    if block.one_sided:
        return np.maximum(-one_sided_restitution(block), 0)
    return np.maximum(housner_restitution(block), 0)


def take_magnitudes(restitution: Values) -> np.ndarray:
    """Take the magnitudes of restitutions of one-sided blocks, along an axis of a spectrum."""
    as_real("restitution", restitution, unit="")  # raises for anything but numbers
    return np.abs(np.asarray(restitution, dtype=float))
