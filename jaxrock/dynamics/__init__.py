"""Driven motion: one block through every impact, and many blocks side by side.

Names beside those in ``__all__`` are for the other packages.
"""

from .batch_ground import Batch as Batch
from .batch_ground import GroundMotions as GroundMotions
from .batch_ground import ground_of as ground_of
from .driven_scene import DrivenScene
from .equation import Equation as Equation
from .equation import uplift_acceleration as uplift_acceleration
from .harmonic_departure import peak_after_launch as peak_after_launch
from .harmonic_linearized import least_harmonic_amplitude, symmetry_breaking_amplitude
from .harmonic_orbit import HarmonicOrbit, harmonic_orbit
from .overturning_criterion import TOPPLED_ROTATION as TOPPLED_ROTATION
from .overturning_criterion import free_motion_margin
from .repeated_pulses import PulsedPhase, pulsed_next_velocity, pulsed_phase
from .repeated_pulses_threshold import PulsedThreshold, critical_pulsed_amplitude
from .respond_many import BatchResponse, respond_batch
from .respond_many import check_batch as check_batch
from .respond_many import compiler_options as compiler_options
from .respond_many import follow_batch as follow_batch
from .respond_one import respond
from .response import Response, Status

__all__ = [
    "BatchResponse",
    "DrivenScene",
    "HarmonicOrbit",
    "PulsedPhase",
    "PulsedThreshold",
    "Response",
    "Status",
    "critical_pulsed_amplitude",
    "free_motion_margin",
    "harmonic_orbit",
    "least_harmonic_amplitude",
    "pulsed_next_velocity",
    "pulsed_phase",
    "respond",
    "respond_batch",
    "symmetry_breaking_amplitude",
]
