"""Restitutions of the blocks that a spectrum makes."""

import numpy as np

from ..block import Block
from ..grids import Values
from ..impact import ONE_SIDED_RESTITUTION, compute_restitution_by_size
from ..validation import as_real, check


def estimate_restitution(block: Block) -> np.ndarray | np.floating:
    """Compute the restitutions that follow from size; 0 for blocks that an impact stops."""
    return np.maximum(compute_restitution_by_size(block), 0)


def take_magnitudes(restitution: Values) -> np.ndarray:
    """Take the magnitudes of restitutions of one-sided blocks, along an axis of a spectrum."""
    # Raises for anything but allowed numbers, which axes of magnitudes would not know.
    check("restitution", as_real("restitution", restitution, unit=""), ONE_SIDED_RESTITUTION)
    return np.abs(np.asarray(restitution, dtype=float))
