"""Names that the package itself had in version 0.1, and where they are now."""

import importlib
import warnings
from typing import Any

_FORMER = {
    "accuracy": ("Choice", "ModelError", "Tradeoff", "measure_tradeoff"),
    "dynamics": ("BatchResponse", "PulsedPhase", "Response", "pulsed_next_velocity"),
    "ground_motion": ("Motion", "Pulse", "from_obspy"),
    "overturning": ("Boundaries", "SurvivalWindows"),
    "resonance": (
        "Oscillator",
        "TrainResponse",
        "WorstTrain",
        "damping_from_decay",
        "equivalent_damping",
        "equivalent_damping_as_printed",
        "timing_costs",
    ),
    "sensitivity": ("Sensitivities", "failure_probability", "monte_carlo", "propagate"),
}
_NEW = {name: (package, name) for package, names in _FORMER.items() for name in names} | {
    "GlobalSensitivities": ("sensitivity", "DerivativeBasedMeasures"),
    "Probability": ("sensitivity", "ReliabilityResult"),
    "PulsedVerge": ("dynamics", "PulsedThreshold"),
    "Scatter": ("sensitivity", "MomentEstimate"),
    "Swing": ("sensitivity", "TornadoBars"),
    "Within": ("accuracy", "EstimatedResponse"),
    "fate_margin": ("dynamics", "free_motion_margin"),
    "global_sensitivities": ("sensitivity", "derivative_based_measures"),
}


def found(name: str) -> Any:
    """What `jaxrock` has by this name without listing it: its pictures, and former names."""
    if name == "plot":  # which imports matplotlib
        return importlib.import_module(".plot", __package__)
    if name not in _NEW:
        raise AttributeError(f"module 'jaxrock' has no attribute {name!r}")
    package, new = _NEW[name]
    warnings.warn(
        f"jaxrock.{name} is now jaxrock.{package}.{new}", DeprecationWarning, stacklevel=3
    )
    return getattr(importlib.import_module(f".{package}", __package__), new)
