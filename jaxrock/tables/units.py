"""Units: how they are spelled, what they measure, and their values in SI.

A new unit is an entry of `_UNITS`; what products of units measure stands in `_PRODUCTS`. The case
of letters says nothing, since no two units here differ by it alone.
"""

import math
import re
from collections import Counter
from typing import NamedTuple

from .text import normalize

# Standard gravity, the unit g of records: not the gravity that acts on a block.
_G = 9.80665
# A year is no number of seconds here, since rates are per year.
_UNITS: dict[str, dict[str, float]] = {
    "length": {
        "m metre meter metres meters": 1.0,
        "cm centimetre centimeter": 1e-2,
        "mm millimetre millimeter": 1e-3,
        "nm": 1e-9,
        "in inch inches": 0.0254,
        "ft foot feet": 0.3048,
    },
    "time": {"s sec secs second seconds": 1.0, "ms msec": 1e-3, "min": 60.0, "h": 3600.0},
    "years": {"yr yrs year years a anni": 1.0},
    "acceleration": {"g": _G, "%g": 1e-2 * _G, "mg": 1e-3 * _G, "gal gals": 1e-2},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg degree degrees \u00b0": math.pi / 180},
    "ratio": {"- 1": 1.0, "%": 1e-2},
}
_KNOWN = {
    spelling: (dimension, value)
    for dimension, units in _UNITS.items()
    for spellings, value in units.items()
    for spelling in spellings.split()
}
_PRODUCTS = {
    (("length", 1), ("time", -2)): "acceleration",
    (("length", 1), ("time", -1)): "velocity",
    (("years", -1),): "rate",
}
_FACTOR = re.compile(r"(/|per )?\s*([^\W\d]+|1)(-?\d)?[\s.*]*")
UNITS_OF_ACCELERATION = "'m/s2', 'cm/s2', 'mm/s2', 'nm/s2', 'gal', 'g', '%g', 'mg' or 'in/s2'"


class Unit(NamedTuple):
    """A unit as it is written, what it measures, and its value in SI.

    Attributes
    ----------
    spelling : str
        As it is written.
    dimension : str
        What it measures, such as "length" or "acceleration"; empty if it is not understood.
    factor : float
        In SI, with rates per year; NaN if it is not understood.
    """

    spelling: str
    dimension: str = ""
    factor: float = math.nan


def parse_unit(spelling: str) -> Unit:
    """Parse a unit, alone or a product such as cm/s^2, cm/s/s, cm s-2 and 1/yr."""
    plain = normalize(spelling).strip(" .").lower()
    if plain in _KNOWN:
        return Unit(spelling, *_KNOWN[plain])
    plain = re.sub(r"[\^()]|\*\*", "", plain)
    powers: Counter[str] = Counter()
    value = 1.0
    for stroke, name, digit in _FACTOR.findall(plain):
        dimension, factor = _KNOWN.get(name, ("", math.nan))
        power = int(digit or 1) * (-1 if stroke else 1)
        value *= factor**power
        powers[dimension] += power if dimension != "ratio" else 0
    product = tuple(sorted((name, power) for name, power in powers.items() if power))
    dimension = "" if _FACTOR.sub("", plain) else _PRODUCTS.get(product, "")
    return Unit(spelling, dimension, value if dimension else math.nan)
