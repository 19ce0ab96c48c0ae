"""Grids of blocks to labelled datasets.

Names beside those in ``__all__`` are for the other packages.
"""

from .closed_form import RESONANCE_AXES as RESONANCE_AXES
from .closed_form import resonance_spectrum
from .driven import overturning_map, overturning_spectrum, rocking_spectrum
from .grid import axis as axis
from .grid import overturned_share as overturned_share
from .grid import write_table

__all__ = ["overturning_map", "overturning_spectrum", "resonance_spectrum", "rocking_spectrum"]
__all__ += ["write_table"]
