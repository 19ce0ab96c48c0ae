"""Populations of blocks from tests that overturned or stood, and scores of their predictions."""

from .answer import OutcomeFit, fit_outcomes
from .campaign import check_campaign as check_campaign
from .cross_validation import cross_validate, fit_and_score
from .cross_validation import describe_scores as describe_scores
from .cross_validation import tabulate_scores as tabulate_scores
from .cross_validation import tabulate_tests as tabulate_tests
from .outcome_files import Outcomes, read_tests
from .population import Population

__all__ = [
    "OutcomeFit",
    "Outcomes",
    "Population",
    "cross_validate",
    "fit_and_score",
    "fit_outcomes",
    "read_tests",
]
