"""What a simpler model costs, the cheapest that is good enough, and the trade measured.

Names beside those in ``__all__`` are for the other packages.
"""

from .batch_to_tolerance import EstimatedResponse, respond_within
from .batch_to_tolerance import follow_within as follow_within
from .cheapest_setting import Choice, choose
from .model_errors import ModelError, model_error
from .model_errors import linearized_is_enough as linearized_is_enough
from .tradeoff import Tradeoff, measure_tradeoff
from .tradeoff import default_scene as default_scene

__all__ = [
    "Choice",
    "EstimatedResponse",
    "ModelError",
    "Tradeoff",
    "choose",
    "measure_tradeoff",
    "model_error",
    "respond_within",
]
