"""Restitution, frequency parameter and shape of a block from measurements of its rocking."""

from .driven_fit import DrivenFit, fit_driven_rocking
from .free_rocking_answer import FreeRockingFit
from .free_rocking_fit import fit_free_rocking
from .measurement_files import read_impact_times
from .outcomes import (
    OutcomeFit,
    Outcomes,
    Population,
    cross_validate,
    fit_outcomes,
    read_tests,
)
from .outcomes import check_campaign as check_campaign
from .outcomes import describe_scores as describe_scores
from .outcomes import fit_and_score as fit_and_score
from .outcomes import tabulate_scores as tabulate_scores
from .outcomes import tabulate_tests as tabulate_tests

__all__ = [
    "DrivenFit",
    "FreeRockingFit",
    "OutcomeFit",
    "Outcomes",
    "Population",
    "cross_validate",
    "fit_driven_rocking",
    "fit_free_rocking",
    "fit_outcomes",
    "read_impact_times",
    "read_tests",
]
