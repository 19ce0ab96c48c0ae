"""Steady driven rocking: under pulses of finite duration, and on a harmonic floor.

Both are fixed points of a map from one half-period to the next, whose derivatives decide
stability.
"""

from .harmonic_linearized import least_harmonic_amplitude, symmetry_breaking_amplitude
from .harmonic_orbit import HarmonicOrbit, harmonic_orbit
from .repeated_pulses import PulsedPhase, pulsed_phase
from .repeated_pulses_threshold import PulsedThreshold, critical_pulsed_amplitude

__all__ = [
    "HarmonicOrbit",
    "PulsedPhase",
    "PulsedThreshold",
    "critical_pulsed_amplitude",
    "harmonic_orbit",
    "least_harmonic_amplitude",
    "pulsed_phase",
    "symmetry_breaking_amplitude",
]
