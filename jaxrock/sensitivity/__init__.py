"""Dependence of an answer on parameters: derivatives, ranges, uncertainty, reliability."""

from .array_slopes import value_and_slopes
from .distributions import find_coefficients as find_coefficients
from .distributions import find_widths as find_widths
from .driven_answer import DrivenAnswerName as DrivenAnswerName
from .driven_tornado import driven_tornado
from .local_dependence import LocalDependence, local_dependence
from .measures import (
    DerivativeBasedMeasures,
    Sensitivities,
    TornadoBars,
    derivative_based_measures,
    sensitivities,
    tornado,
)
from .moments import MomentEstimate, monte_carlo, propagate
from .outcome_probabilities import OutcomeProbabilities, outcome_probabilities
from .outcome_probabilities import describe_index as describe_index
from .outcome_probabilities import is_index_known as is_index_known
from .parameters import describe_parameter as describe_parameter
from .parameters import make_parametric as make_parametric
from .parameters import refuse_name as refuse_name
from .reliability import ReliabilityResult, failure_probability
from .samples import draw_normal_numbers as draw_normal_numbers
from .uncertain import FLOOR_NAMES as FLOOR_NAMES
from .uncertain import Draws, Uncertain
from .uncertain import FloorFactors as FloorFactors

__all__ = [
    "DerivativeBasedMeasures",
    "Draws",
    "LocalDependence",
    "MomentEstimate",
    "OutcomeProbabilities",
    "ReliabilityResult",
    "Sensitivities",
    "TornadoBars",
    "Uncertain",
    "derivative_based_measures",
    "driven_tornado",
    "failure_probability",
    "local_dependence",
    "monte_carlo",
    "outcome_probabilities",
    "propagate",
    "sensitivities",
    "tornado",
    "value_and_slopes",
]
