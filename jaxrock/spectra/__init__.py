"""Spectra and maps: labelled datasets over grids of blocks."""

from .harmonic import add_size as add_size
from .harmonic import describe_regions as describe_regions
from .harmonic import harmonic_spectrum
from .harmonic import tabulate_regions as tabulate_regions
from .overturning import overturning_map
from .resonance import resonance_spectrum
from .rocking import rocking_spectrum

__all__ = ["harmonic_spectrum", "overturning_map", "resonance_spectrum", "rocking_spectrum"]
