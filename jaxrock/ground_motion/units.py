"""Units of acceleration, as callers and files state them."""

import math

from ..tables import UNITS_OF_ACCELERATION, parse_unit


def convert_unit(text: str) -> float:
    """Convert a unit of acceleration to m/s2; NaN if it is not understood."""
    _, dimension, factor = parse_unit(text)
    return factor if dimension == "acceleration" else math.nan


def require_unit(unit: str) -> float:
    """Convert the argument `unit` to m/s2; a `ValueError` if it is not understood."""
    factor = convert_unit(str(unit))
    if math.isnan(factor):
        raise ValueError(f"unit must be {UNITS_OF_ACCELERATION}, got {unit!r}")
    return factor
