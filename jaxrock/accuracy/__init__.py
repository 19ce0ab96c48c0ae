"""What a simpler model costs, the cheapest that is good enough, and the trade measured.

Names beside those in ``__all__`` are for the other packages.
"""

from .cheapest_setting import Choice, choose
from .model_errors import ModelError, model_error
from .model_errors import linearized_is_enough as linearized_is_enough
from .tradeoff import Tradeoff, measure_tradeoff
from .tradeoff import default_scene as default_scene

__all__ = [
    "Choice",
    "ModelError",
    "Tradeoff",
    "choose",
    "measure_tradeoff",
    "model_error",
]
