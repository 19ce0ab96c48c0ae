"""Grids of blocks to labelled datasets.

Names beside those in ``__all__`` are for the other packages.
"""

from .axes import axis as axis
from .driven import overturning_spectrum, rocking_spectrum
from .grid import Grid as Grid
from .grid import along as along
from .harmonic import harmonic_spectrum
from .overturning_map import overturning_map
from .resonance import RESONANCE_AXES as RESONANCE_AXES
from .resonance import resonance_spectrum
from .tables import overturned_share as overturned_share
from .tables import write_table

__all__ = [
    "harmonic_spectrum",
    "overturning_map",
    "overturning_spectrum",
    "resonance_spectrum",
]
__all__ += ["rocking_spectrum", "write_table"]
