"""Rocking of rigid blocks on JAX: resonance spectra, sensitivities, inverse design.

All functions are elementwise: arguments are numbers or arrays that broadcast against each
other, answers have the shape that results, ``(...)`` in the docstrings, everything is in SI
units and radians. An argument outside of what is allowed raises `ValueError` where it is
concrete, and gives NaN with derivative zero where it is traced.

Two models describe the motion, `Linearized` and `Nonlinear`; every function that needs one takes
it as ``model=``, itself or by its name. The defaults are the paper's own: the closed forms
(half-cycle map, limits, critical intensities, pulse trains) are linearized, the equation of
driven motion is nonlinear.

What is here is what most scenes need. Result classes and further tools are in the packages:
`resonance`, `ground_motion`, `dynamics`, `overturning`, `sensitivity`, `accuracy`, `spectra`,
`plot`, `reports`.

JAX has threads, which a process made by `os.fork` lacks: it can hang at the first computation.
Processes beside each other are started with "spawn" or "forkserver", as in
``multiprocessing.get_context("spawn").Pool()``.
"""

from typing import TYPE_CHECKING, Any

from .host import signals  # before JAX, so that a command can be interrupted while that loads

# isort: split
from . import (
    accuracy,
    dynamics,
    ground_motion,
    overturning,
    reports,
    resonance,
    sensitivity,
    spectra,
)
from .accuracy import choose, model_error, respond_within
from .block import Block
from .dynamics import (
    DrivenScene,
    Status,
    critical_pulsed_amplitude,
    pulsed_phase,
    respond,
    respond_batch,
)
from .former_names import found
from .ground_motion import (
    Cosine,
    HalfSine,
    Record,
    Rectangular,
    Ricker,
    Sine,
    example_record,
    read_record,
)
from .impact import housner_restitution
from .overturning import (
    critical_amplitude,
    critical_duration,
    overturning_boundaries,
    survival_windows,
)
from .reports import assess
from .resonance import (
    Linearized,
    Nonlinear,
    Scene,
    amplification,
    critical_intensity,
    critical_restitution,
    critical_slenderness,
    critical_width,
    half_cycle_velocity,
    launch_velocity,
    next_velocity,
    overturning_half_cycle,
    overturning_margin,
    respond_to_train,
    rotation_ratio,
    stabilized_period,
    stabilized_rotation,
    stabilized_velocity,
    worst_train,
)
from .sensitivity import sensitivities, tornado, value_and_slopes
from .spectra import (
    overturning_map,
    overturning_spectrum,
    resonance_spectrum,
    rocking_spectrum,
    write_table,
)

if TYPE_CHECKING:
    from . import plot

__all__ = [
    "Block",
    "Cosine",
    "DrivenScene",
    "HalfSine",
    "Linearized",
    "Nonlinear",
    "Record",
    "Rectangular",
    "Ricker",
    "Scene",
    "Sine",
    "Status",
    "accuracy",
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
    "dynamics",
    "example_record",
    "ground_motion",
    "half_cycle_velocity",
    "housner_restitution",
    "launch_velocity",
    "model_error",
    "next_velocity",
    "overturning",
    "overturning_boundaries",
    "overturning_half_cycle",
    "overturning_map",
    "overturning_margin",
    "overturning_spectrum",
    "plot",
    "pulsed_phase",
    "read_record",
    "reports",
    "resonance",
    "resonance_spectrum",
    "respond",
    "respond_batch",
    "respond_to_train",
    "respond_within",
    "rocking_spectrum",
    "rotation_ratio",
    "sensitivities",
    "sensitivity",
    "signals",
    "spectra",
    "stabilized_period",
    "stabilized_rotation",
    "stabilized_velocity",
    "survival_windows",
    "tornado",
    "value_and_slopes",
    "worst_train",
    "write_table",
]


def __getattr__(name: str) -> Any:
    return found(name)


def __dir__() -> list[str]:
    return __all__
