"""Units of acceleration in words, such as m/s2, gal and %g, and their values in SI.

The patterns ignore the case, and are parts of others that find units in text.
"""

import math
import re
import unicodedata

from ..validation import as_text

# The words of a statement, and its value in SI: NaN if they are not understood.
Stated = tuple[str, float]

# Standard gravity, the unit g of records: not the gravity that acts on the block.
_G = 9.80665
# By the names of the groups in `ACCELERATION`; a length without a group is recognized, but no
# unit here.
_FACTORS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "nm": 1e-9, "gal": 0.01}
_FACTORS |= {"g": _G, "percent": 0.01 * _G, "milli": 0.001 * _G}
UNITS = "one of 'm/s2', 'cm/s2', 'mm/s2', 'nm/s2', 'gal', 'g', '%g', 'mg'"

# Accelerations: cm/s2, cm/sec/sec, cm s^-2, cm_s2, ... up to centimetres per second squared.
GAP = r"[\s_.*]*"
PER = r"(?:/|per|p)"
SECOND = r"s(?:ec(?:ond)?s?)?"
LENGTH = (
    r"(?:(?P<mm>mm|millimet(?:er|re)s?)|(?P<cm>cm|centimet(?:er|re)s?)|(?P<m>m|met(?:er|re)s?)"
    r"|(?P<nm>nm|nanomet(?:er|re)s?)|km|ft|foot|feet|in|inch(?:es)?)"
)
SQUARED = (
    rf"[({{]?(?:{SECOND}(?:{GAP}{PER}{GAP}|[\s_.*]+){SECOND}|ss"
    rf"|{SECOND}{GAP}(?:\^?{GAP}[({{]?-?2[)}}]?|squared))[)}}]?"
)
ACCELERATION = (
    rf"(?:{LENGTH}{GAP}(?:{PER}{GAP})?{SQUARED}"
    r"|(?P<percent>(?:%|pct|per[\s_]*cent)[\s_]*(?:of[\s_]*)?g)"
    r"|(?P<milli>milli[\s_-]*g|mg)|(?P<g>g(?:'?s)?)|(?P<gal>gals?))"
)


def parse_unit(unit: str) -> float:
    """Convert a unit of acceleration to m/s2; NaN if it is not understood."""
    match = re.fullmatch(ACCELERATION, normalize(str(unit)).strip(), re.I)
    return interpret_unit(match)[1] if match else math.nan


def require_unit(unit: str) -> float:
    """Convert the argument `unit` to m/s2; a `ValueError` if it is not understood."""
    unit = as_text(unit)
    factor = parse_unit(unit)
    if math.isnan(factor):
        raise ValueError(f"unit must be {UNITS}, got {unit!r}")
    return factor


def normalize(text: str) -> str:
    """Give one form to what looks alike: powers, minus signs, dots of products, micro."""
    # NFKC turns a superscript 2 into 2 and the micro sign into a Greek letter, but leaves the
    # minus sign, the middle dot and the dot operator.
    return unicodedata.normalize("NFKC", text).translate({0x2212: "-", 0xB7: ".", 0x22C5: "."})


def interpret_unit(match: re.Match[str], group: str | int = 0) -> Stated:
    """Return the words of a unit that has been found, and its factor; NaN without a group."""
    # A bracket at the end belongs to the text around, unless one was opened inside.
    words = match[group] if "(" in match[group] else match[group].rstrip(")]}")
    named = (factor for name, factor in _FACTORS.items() if match.groupdict().get(name))
    return words, next(named, math.nan)
