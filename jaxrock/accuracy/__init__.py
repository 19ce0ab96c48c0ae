"""Errors of simpler models, the cheapest model within a tolerance, and measured trade-offs."""

from .cheapest_setting import Choice, choose
from .linearized_range import is_linearized_enough as is_linearized_enough
from .model_errors import ModelError, model_error
from .tradeoff import Tradeoff, measure_tradeoff
from .tradeoff import make_default_scene as make_default_scene

__all__ = [
    "Choice",
    "ModelError",
    "Tradeoff",
    "choose",
    "measure_tradeoff",
    "model_error",
]
