"""Grids of blocks to labelled datasets.

Names beside those in ``__all__`` are for the other packages.
"""

from .driven import overturning_map, overturning_spectrum, rocking_spectrum
from .grid import axis as axis
from .grid import overturned_share as overturned_share
from .grid import write_table
from .harmonic import harmonic_spectrum
from .resonance import RESONANCE_AXES as RESONANCE_AXES
from .resonance import resonance_spectrum

__all__ = ["harmonic_spectrum", "overturning_map", "overturning_spectrum", "resonance_spectrum"]
__all__ += ["rocking_spectrum", "write_table"]
