"""Rocking of rigid blocks on JAX: resonance spectra, sensitivities, inverse design.

All functions are elementwise: arguments are numbers or arrays that broadcast against each
other, answers have the shape that results, everything is in SI units and radians. An argument
outside of what is allowed raises `ValueError` where it is concrete, and gives NaN with
derivative zero where it is traced.
"""

from .assessment import assess
from .batch import BatchResponse, respond_batch
from .block import Block, housner_restitution
from .critical import critical_intensity
from .fate import fate_margin
from .free import Linearized, Nonlinear
from .motion import Cosine, HalfSine, Motion, Pulse, Record, Rectangular, Ricker, Sine
from .oscillator import (
    Oscillator,
    damping_from_decay,
    equivalent_damping,
    equivalent_damping_as_printed,
)
from .pulsed import PulsedPhase, pulsed_next_velocity, pulsed_phase
from .records import example_record, from_obspy, read_record
from .resonance import (
    Scene,
    amplification,
    half_cycle_velocity,
    launch_velocity,
    next_velocity,
    overturning_half_cycle,
    overturning_margin,
    rotation_ratio,
    stabilized_period,
    stabilized_rotation,
    stabilized_velocity,
)
from .response import Response, Status, respond
from .spectra import resonance_spectrum, write_table
from .spectra_driven import overturning_spectrum, rocking_spectrum
from .windows import SurvivalWindows, survival_windows

__all__ = [
    "BatchResponse",
    "Block",
    "Cosine",
    "HalfSine",
    "Linearized",
    "Motion",
    "Nonlinear",
    "Oscillator",
    "Pulse",
    "PulsedPhase",
    "Record",
    "Rectangular",
    "Response",
    "Ricker",
    "Scene",
    "Sine",
    "Status",
    "SurvivalWindows",
    "amplification",
    "assess",
    "critical_intensity",
    "damping_from_decay",
    "equivalent_damping",
    "equivalent_damping_as_printed",
    "example_record",
    "fate_margin",
    "from_obspy",
    "half_cycle_velocity",
    "housner_restitution",
    "launch_velocity",
    "next_velocity",
    "overturning_half_cycle",
    "overturning_margin",
    "overturning_spectrum",
    "pulsed_next_velocity",
    "pulsed_phase",
    "read_record",
    "resonance_spectrum",
    "respond",
    "respond_batch",
    "rocking_spectrum",
    "rotation_ratio",
    "stabilized_period",
    "stabilized_rotation",
    "stabilized_velocity",
    "survival_windows",
    "write_table",
]
