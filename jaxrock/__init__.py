"""Rocking of rigid blocks on JAX: resonance spectra, sensitivities, inverse design.

All functions are elementwise: arguments are numbers or arrays that broadcast against each
other, answers have the shape that results, ``(...)`` in the docstrings, everything is in SI
units and radians. An argument outside of what is allowed raises `ValueError` where it is
concrete, and gives NaN with derivative zero where it is traced.

JAX has threads, which a process made by `os.fork` lacks: it can hang at the first computation.
Processes beside each other are started with "spawn" or "forkserver", as in
``multiprocessing.get_context("spawn").Pool()``.
"""

from . import signals as signals
from .assessment import assess
from .batch import BatchResponse, respond_batch
from .block import Block, housner_restitution
from .boundaries import Boundaries, overturning_boundaries
from .critical import (
    critical_intensity,
    critical_restitution,
    critical_slenderness,
    critical_width,
)
from .critical_driven import (
    SurvivalWindows,
    critical_amplitude,
    critical_duration,
    survival_windows,
)
from .critical_pulsed import PulsedVerge, critical_pulsed_amplitude
from .fate import fate_margin
from .fidelity import Choice, DrivenScene, choose
from .free import Linearized, Nonlinear
from .model_error import ModelError, model_error
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
from .sensitivity import (
    GlobalSensitivities,
    Probability,
    Scatter,
    Sensitivities,
    Swing,
    failure_probability,
    global_sensitivities,
    monte_carlo,
    propagate,
    sensitivities,
    tornado,
)
from .slopes import value_and_slopes
from .spectra import resonance_spectrum, write_table
from .spectra_driven import overturning_map, overturning_spectrum, rocking_spectrum
from .timing import timing_costs
from .tradeoff import Tradeoff, measure_tradeoff
from .train import TrainResponse, respond_to_train
from .within import Within, respond_within
from .worst import WorstTrain, worst_train

__all__ = [
    "BatchResponse",
    "Block",
    "Boundaries",
    "Choice",
    "Cosine",
    "DrivenScene",
    "GlobalSensitivities",
    "HalfSine",
    "Linearized",
    "ModelError",
    "Motion",
    "Nonlinear",
    "Oscillator",
    "Probability",
    "Pulse",
    "PulsedPhase",
    "PulsedVerge",
    "Record",
    "Rectangular",
    "Response",
    "Ricker",
    "Scatter",
    "Scene",
    "Sensitivities",
    "Sine",
    "Status",
    "SurvivalWindows",
    "Swing",
    "Tradeoff",
    "TrainResponse",
    "Within",
    "WorstTrain",
    "amplification",
    "assess",
    "choose",
    "critical_amplitude",
    "critical_duration",
    "critical_intensity",
    "critical_pulsed_amplitude",
    "critical_restitution",
    "critical_slenderness",
    "critical_width",
    "damping_from_decay",
    "equivalent_damping",
    "equivalent_damping_as_printed",
    "example_record",
    "failure_probability",
    "fate_margin",
    "from_obspy",
    "global_sensitivities",
    "half_cycle_velocity",
    "housner_restitution",
    "launch_velocity",
    "measure_tradeoff",
    "model_error",
    "monte_carlo",
    "next_velocity",
    "overturning_boundaries",
    "overturning_half_cycle",
    "overturning_map",
    "overturning_margin",
    "overturning_spectrum",
    "propagate",
    "pulsed_next_velocity",
    "pulsed_phase",
    "read_record",
    "resonance_spectrum",
    "respond",
    "respond_batch",
    "respond_to_train",
    "respond_within",
    "rocking_spectrum",
    "rotation_ratio",
    "sensitivities",
    "stabilized_period",
    "stabilized_rotation",
    "stabilized_velocity",
    "survival_windows",
    "timing_costs",
    "tornado",
    "value_and_slopes",
    "worst_train",
    "write_table",
]
