"""Spectra and maps: labelled datasets over grids of blocks."""

from .driven import overturning_spectrum, rocking_spectrum
from .harmonic import add_size, harmonic_spectrum
from .harmonic import describe_regions as describe_regions
from .harmonic import lowest_stable_amplitude as lowest_stable_amplitude
from .harmonic import tabulate_regions as tabulate_regions
from .overturning_map import overturning_map
from .resonance import RESONANCE_AXES as RESONANCE_AXES
from .resonance import resonance_spectrum

__all__ = [
    "add_size",
    "harmonic_spectrum",
    "overturning_map",
    "overturning_spectrum",
    "resonance_spectrum",
    "rocking_spectrum",
]
