"""The dependence of an answer: derivatives, ranges, scatter and probability of failure."""

from .array_slopes import value_and_slopes
from .measures import (
    DerivativeBasedMeasures,
    Sensitivities,
    TornadoBars,
    derivative_based_measures,
    sensitivities,
    tornado,
)
from .scatter import (
    MomentEstimate,
    ReliabilityResult,
    failure_probability,
    monte_carlo,
    propagate,
)

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
