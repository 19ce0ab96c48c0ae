"""The paper: free rocking, the half-cycle map and its limits, inverse design, pulse trains."""

from . import elastic_oscillator as elastic_oscillator
from .critical_values import CriticalValues, critical_values
from .elastic_oscillator import equivalent_damping
from .free_rocking import Linearized, Nonlinear
from .free_rocking import ModelLike as ModelLike
from .free_rocking import as_model as as_model
from .half_cycle_map import (
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
from .inverse_design import (
    critical_intensity,
    critical_restitution,
    critical_slenderness,
    critical_width,
)
from .pulse_train import TrainResponse, respond_to_train
from .rocking_model import RockingModel
from .scene import Scene
from .worst_trains import WorstTrain, worst_train

__all__ = [
    "CriticalValues",
    "Linearized",
    "Nonlinear",
    "RockingModel",
    "Scene",
    "TrainResponse",
    "WorstTrain",
    "amplification",
    "critical_intensity",
    "critical_restitution",
    "critical_slenderness",
    "critical_values",
    "critical_width",
    "equivalent_damping",
    "half_cycle_velocity",
    "launch_velocity",
    "next_velocity",
    "overturning_half_cycle",
    "overturning_margin",
    "respond_to_train",
    "rotation_ratio",
    "stabilized_period",
    "stabilized_rotation",
    "stabilized_velocity",
    "worst_train",
]
