"""Errors of simpler models, the cheapest model within a tolerance, and measured trade-offs."""

from .cheapest_setting import Choice, choose
from .model_errors import ModelError, model_error
from .model_errors import is_linearized_enough as is_linearized_enough
from .tradeoff import measure_tradeoff

__all__ = [
    "Choice",
    "ModelError",
    "choose",
    "measure_tradeoff",
    "model_error",
]
