"""Rocking of rigid blocks on JAX: resonance spectra, sensitivities, inverse design."""

from .block import Block, housner_restitution
from .critical import critical_intensity
from .free import Linearized, Nonlinear
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
