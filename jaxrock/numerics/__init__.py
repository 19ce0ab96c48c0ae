"""Nothing about rocking: elementary functions, elliptic integrals, roots."""

from .elementary import (
    angle,
    arcsin,
    arcsin_ratio,
    arctan_ratio,
    artanh_ratio,
    decaying_share_of_one,
    minus_log,
    one_minus_square,
    quotient,
    quotient_or_infinite,
    share_of_one,
)
from .elliptic import carlson_rf, jacobi
from .implicit import through_jacobian
from .roots import brackets, brackets_traced, located

__all__ = [
    "angle",
    "arcsin",
    "arcsin_ratio",
    "arctan_ratio",
    "artanh_ratio",
    "brackets",
    "brackets_traced",
    "carlson_rf",
    "decaying_share_of_one",
    "jacobi",
    "located",
    "minus_log",
    "one_minus_square",
    "quotient",
    "quotient_or_infinite",
    "share_of_one",
    "through_jacobian",
]
