"""Restitution, frequency parameter, shape of a block from measurements of it."""

from .driven_fit import DrivenFit, fit_driven_rocking
from .free_rocking_fit import FreeRockingFit, fit_free_rocking
from .measurement_files import read_impact_times

__all__ = [
    "DrivenFit",
    "FreeRockingFit",
    "fit_driven_rocking",
    "fit_free_rocking",
    "read_impact_times",
]
