"""Restitutions of the blocks that a spectrum makes."""

import numpy as np

from ..block import Block
from ..grids import Values
from ..impact import compute_restitution_by_size
from ..validation import as_real


def estimate_restitution(block: Block) -> np.ndarray | np.floating:
    """Compute the restitutions that follow from size; 0 for blocks that an impact stops."""
    return np.maximum(compute_restitution_by_size(block), 0)


def take_magnitudes(restitution: Values) -> np.ndarray:
    """Take the magnitudes of restitutions of one-sided blocks, along an axis of a spectrum."""
    as_real("restitution", restitution, unit="")  # raises for anything but numbers
    return np.abs(np.asarray(restitution, dtype=float))
