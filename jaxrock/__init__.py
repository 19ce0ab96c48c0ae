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
`resonance`, `ground_motion`, `dynamics`, `overturning`, `sensitivity`, `accuracy`, `risk`,
`calibration`, `spectra`, `plot`, `reports`. ``jaxrock.__version__`` says which version this is.

JAX has threads, which a process made by `os.fork` lacks: it can hang at the first computation.
Processes beside each other are started with "spawn" or "forkserver", as in
``multiprocessing.get_context("spawn").Pool()``.
"""

import importlib
from typing import TYPE_CHECKING, Any

from .host import signals  # before JAX, so that a command can be interrupted while that loads

# isort: split
from . import (
    accuracy,
    calibration,
    dynamics,
    ground_motion,
    overturning,
    reports,
    resonance,
    risk,
    sensitivity,
    spectra,
)
from .accuracy import choose, model_error, respond_within
from .block import Block
from .calibration import fit_driven_rocking, fit_free_rocking
from .dynamics import (
    DrivenScene,
    Status,
    critical_pulsed_amplitude,
    harmonic_orbit,
    pulsed_phase,
    respond,
    respond_batch,
)
from .ground_motion import (
    Cosine,
    HalfSine,
    Harmonic,
    Record,
    Rectangular,
    Ricker,
    Sine,
    Still,
    Suite,
    example_record,
    example_suite,
    read_record,
    read_suite,
)
from .host import optional
from .host import version as _version
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
from .risk import Hazard, fragility, overturning_rate, read_hazard
from .sensitivity import sensitivities, tornado, value_and_slopes
from .spectra import (
    harmonic_spectrum,
    overturning_map,
    overturning_spectrum,
    resonance_spectrum,
    rocking_spectrum,
    write_table,
)

if TYPE_CHECKING:
    from . import cluster as cluster
    from . import plot

    __version__: str

__all__ = ["accuracy", "calibration", "dynamics", "ground_motion", "overturning", "plot"]
__all__ += ["reports", "resonance", "risk", "sensitivity", "signals", "spectra"]
__all__ += ["Block", "DrivenScene", "Linearized", "Nonlinear", "Scene", "Status"]
__all__ += ["Cosine", "HalfSine", "Harmonic", "Rectangular", "Ricker", "Sine", "Still"]
__all__ += ["Record", "example_record", "read_record"]
__all__ += ["Suite", "example_suite", "read_suite"]
__all__ += ["amplification", "overturning_half_cycle", "overturning_margin", "rotation_ratio"]
__all__ += ["stabilized_period", "stabilized_rotation", "stabilized_velocity"]
__all__ += ["half_cycle_velocity", "housner_restitution", "launch_velocity", "next_velocity"]
__all__ += ["critical_intensity", "critical_restitution", "critical_slenderness", "critical_width"]
__all__ += ["critical_pulsed_amplitude", "pulsed_phase", "respond_to_train", "worst_train"]
__all__ += ["respond", "respond_batch", "respond_within"]
__all__ += ["critical_amplitude", "critical_duration", "overturning_boundaries", "survival_windows"]
__all__ += ["Hazard", "fragility", "overturning_rate", "read_hazard"]
__all__ += ["assess", "choose", "model_error", "sensitivities", "tornado", "value_and_slopes"]
__all__ += ["fit_driven_rocking", "fit_free_rocking", "harmonic_orbit", "harmonic_spectrum"]
__all__ += ["overturning_map", "overturning_spectrum", "resonance_spectrum", "rocking_spectrum"]
__all__ += ["write_table"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name == "plot":  # imports matplotlib
        return importlib.import_module(".plot", __package__)
    if name == "cluster":  # imports Dask, which not every user has
        try:
            return optional(name)
        except ModuleNotFoundError as error:  # which `hasattr` would let through
            raise AttributeError(str(error)) from error
    raise AttributeError(f"module 'jaxrock' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "cluster"])  # not among what a star imports, which it may not find
