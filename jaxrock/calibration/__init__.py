"""Restitution, frequency parameter and shape of a block from measurements of its rocking."""

from .driven_fit import DrivenFit, fit_driven_rocking
from .free_rocking_answer import FreeRockingFit
from .free_rocking_fit import fit_free_rocking
from .measurement_files import read_impact_times

__all__ = [
    "DrivenFit",
    "FreeRockingFit",
    "fit_driven_rocking",
    "fit_free_rocking",
    "read_impact_times",
]
