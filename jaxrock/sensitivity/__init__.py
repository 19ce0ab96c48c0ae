"""Dependence of an answer on parameters: derivatives, ranges, uncertainty."""

from .array_slopes import value_and_slopes
from .closed_forms import Sensitivities, sensitivities
from .derivatives import Derivatives, derivatives_within
from .distributions import draw_normal_numbers as draw_normal_numbers
from .driven_scenes import BEYOND as BEYOND
from .moments import MomentEstimate, propagate
from .outcome_probabilities import OutcomeProbabilities, outcome_probabilities
from .parameters import describe_parameter as describe_parameter
from .tornados import TornadoBars, driven_tornado, tornado
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
