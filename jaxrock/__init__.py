"""Rocking of rigid blocks on JAX: resonance spectra, sensitivities, inverse design.

All functions are elementwise: arguments are numbers or arrays that broadcast against each
other, answers have the shape that results, everything is in SI units and radians. An argument
outside of what is allowed raises `ValueError` where it is concrete, and gives NaN with
derivative zero where it is traced.
"""

from .assessment import assess
from .block import Block, housner_restitution
from .critical import critical_intensity
from .free import Linearized, Nonlinear
from .oscillator import (
    Oscillator,
    damping_from_decay,
    equivalent_damping,
    equivalent_damping_as_printed,
)
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
from .spectra import resonance_spectrum, write_table

__all__ = [
    "Block",
    "Linearized",
    "Nonlinear",
    "Oscillator",
    "Scene",
    "amplification",
    "assess",
    "critical_intensity",
    "damping_from_decay",
    "equivalent_damping",
    "equivalent_damping_as_printed",
    "half_cycle_velocity",
    "housner_restitution",
    "launch_velocity",
    "next_velocity",
    "overturning_half_cycle",
    "overturning_margin",
    "resonance_spectrum",
    "rotation_ratio",
    "stabilized_period",
    "stabilized_rotation",
    "stabilized_velocity",
    "write_table",
]
