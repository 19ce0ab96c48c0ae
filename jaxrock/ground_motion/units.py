"""Units of acceleration, as callers and files state them."""

import math

from ..oldtables import UNITS_OF_ACCELERATION, parse_unit
from ..validation import as_text


def convert_unit(words: str) -> float:
    """Convert a unit of acceleration to m/s2; NaN if it is not understood."""
    return parse_unit(words).as_dimension("acceleration").factor


def require_unit(unit: str) -> float:
    """Convert the argument `unit` to m/s2; a `ValueError` if it is not understood."""
    unit = as_text(unit)
    factor = convert_unit(str(unit))
    if math.isnan(factor):
        raise ValueError(f"unit must be {UNITS_OF_ACCELERATION}, got {unit!r}")
    return factor
