"""What an answer depends on: derivatives, ranges, scatter and the probability of failure."""

from .array_slopes import value_and_slopes
from .global_measures import DerivativeBasedMeasures, derivative_based_measures
from .local import Sensitivities, TornadoBars, sensitivities, tornado
from .moments import MomentEstimate, monte_carlo, propagate
from .reliability import ReliabilityResult, failure_probability

__all__ = [
    "DerivativeBasedMeasures",
    "MomentEstimate",
    "ReliabilityResult",
    "Sensitivities",
    "TornadoBars",
    "derivative_based_measures",
    "failure_probability",
    "monte_carlo",
    "propagate",
    "sensitivities",
    "tornado",
    "value_and_slopes",
]
