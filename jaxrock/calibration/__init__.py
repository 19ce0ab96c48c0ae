"""Restitution, frequency parameter and shape of a block from measurements of its rocking."""

from .driven_fit import DrivenFit, fit_driven_rocking
from .free_rocking_answer import FreeRockingFit
from .free_rocking_fit import fit_free_rocking
from .measurement_files import read_impact_times
from .outcomes import Outcomes, read_tests

__all__ = [
    "DrivenFit",
    "FreeRockingFit",
    "Outcomes",
    "fit_driven_rocking",
    "fit_free_rocking",
    "read_impact_times",
    "read_tests",
]
