"""Grids of blocks to labelled datasets.

Names beside those in ``__all__`` are for the other packages.
"""

from .closed_form import RESONANCE_AXES as RESONANCE_AXES
from .closed_form import axis as axis
from .closed_form import overturned_share as overturned_share
from .closed_form import resonance_spectrum, write_table
from .driven import ROCKING_AXES as ROCKING_AXES
from .driven import overturning_map, overturning_spectrum, rocking_spectrum

__all__ = [
    "overturning_map",
    "overturning_spectrum",
    "resonance_spectrum",
    "rocking_spectrum",
    "write_table",
]
