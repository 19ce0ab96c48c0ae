"""Dependence of an answer on parameters: derivatives, ranges, uncertainty."""

from .array_slopes import value_and_slopes
from .derivatives import Derivatives, derivatives_within
from .distributions import draw_normal_numbers as draw_normal_numbers
from .driven_answer import choose_duration as choose_duration
from .driven_tornado import driven_tornado
from .measures import Sensitivities, TornadoBars, sensitivities, tornado
from .moments import MomentEstimate, propagate
from .outcome_probabilities import OutcomeProbabilities, outcome_probabilities
from .outcome_probabilities import describe_index as describe_index
from .outcome_probabilities import is_index_known as is_index_known
from .parameters import describe_parameter as describe_parameter
from .uncertain import FLOOR_NAMES as FLOOR_NAMES
from .uncertain import Draws, Uncertain
from .uncertain import FloorFactors as FloorFactors

__all__ = [
    "Derivatives",
    "Draws",
    "MomentEstimate",
    "OutcomeProbabilities",
    "Sensitivities",
    "TornadoBars",
    "Uncertain",
    "derivatives_within",
    "driven_tornado",
    "outcome_probabilities",
    "propagate",
    "sensitivities",
    "tornado",
    "value_and_slopes",
]
