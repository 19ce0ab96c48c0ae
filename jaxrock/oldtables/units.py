"""Units: how they are spelled, what they measure, and their values in SI.

A new unit is a line of `_UNITS`; what products of units measure stands in `_PRODUCTS`. All
spellings ignore the case, so that mN and MN are the same: only whether it is a force matters here.
"""

import math
import re
import unicodedata
from collections import Counter
from typing import NamedTuple

# Standard gravity, the unit g of records: not the gravity that acts on a block.
_G = 9.80665

# What a unit measures, its value in SI, and a pattern of its spellings. A year is no number of
# seconds here, since rates are per year.
_UNITS: tuple[tuple[str, float, str], ...] = (
    ("length", 1.0, r"m|met(?:er|re)s?"),
    ("length", 1e-2, r"cm|centimet(?:er|re)s?"),
    ("length", 1e-3, r"mm|millimet(?:er|re)s?"),
    ("length", 1e-6, r"[u\u03bc]m|micromet(?:er|re)s?|microns?"),
    ("length", 1e-9, r"nm|nanomet(?:er|re)s?"),
    ("length", 1e3, r"km|kilomet(?:er|re)s?"),
    ("length", 0.3048, r"ft|foot|feet"),
    ("length", 0.0254, r"in|inch(?:es)?"),
    ("time", 1.0, r"s(?:ec(?:ond)?s?)?"),
    ("time", 1e-3, r"m(?:illi)?s(?:ecs?|econds?)?"),
    ("time", 1e-6, r"(?:u|\u03bc|micro)s(?:ecs?|econds?)?"),
    ("time", 1e-9, r"n(?:ano)?s(?:ecs?|econds?)?"),
    ("time", 60.0, r"min(?:ute)?s?"),
    ("time", 3600.0, r"h(?:(?:ou)?rs?)?"),
    ("years", 1.0, r"years?|yrs?|a|annum"),
    ("acceleration", _G, r"g(?:'?s)?"),
    ("acceleration", 1e-2 * _G, r"(?:%|pct|per ?cent) ?(?:of )?g"),
    ("acceleration", 1e-3 * _G, r"milli[ -]?g|mg"),
    ("acceleration", 1e-2, r"gals?"),
    ("angle", 1.0, r"rad(?:ians?)?"),
    ("angle", 1e-3, r"m(?:illi)?rad(?:ians?)?"),
    ("angle", math.pi / 180, r"deg(?:rees?)?|\u00b0"),
    ("frequency", 1.0, r"hz|hertz|sps"),
    ("ratio", 1.0, r"-|1"),
    ("ratio", 1e-2, r"%|pct|per ?cent"),
    ("voltage", 1.0, r"v(?:olts?)?"),
    ("voltage", 1e-3, r"mv|millivolts?"),
    ("force", 1.0, r"n|newtons?"),
    ("force", 1e3, r"kn|kilonewtons?"),
    ("force", 1e6, r"mn|meganewtons?"),
    ("force", 4.4482216152605, r"lbf?|pounds?"),
    ("force", 4448.2216152605, r"kips?"),
    ("pressure", 1.0, r"pa|pascals?"),
    ("pressure", 1e3, r"kpa"),
    ("pressure", 1e6, r"mpa"),
    ("pressure", 6894.757293168, r"psi"),
    ("mass", 1.0, r"kgs?|kilograms?"),
    ("mass", 1e3, r"tonnes?"),
    ("counts", 1.0, r"counts?|cts|lsb|digits?"),
    ("strain", 1e-6, r"(?:u|\u03bc|micro)(?:strain|\u03b5|e|m/m)"),
    ("temperature", 1.0, r"(?:\u00b0|deg) ?c|celsius"),
)
_PRODUCTS = {
    (("length", 1), ("time", -2)): "acceleration",
    (("length", 1), ("time", -1)): "velocity",
    (("angle", 1), ("time", -2)): "angular acceleration",
    (("angle", 1), ("time", -1)): "angular velocity",
    (("acceleration", 1), ("time", 1)): "velocity",
    (("time", -1),): "frequency",
    (("years", -1),): "rate",
}
UNITS_OF_ACCELERATION = (
    "one of 'm/s2', 'cm/s2', 'mm/s2', 'nm/s2', 'gal', 'g', '%g', 'mg', 'in/s2', 'ft/s2'"
)


class Unit(NamedTuple):
    """A unit as it is written, what it measures, and its value in SI.

    Attributes
    ----------
    words : str
        As it is written.
    dimension : str
        What it measures, such as "length" or "acceleration"; empty if it is not understood.
    factor : float
        In SI, with rates per year; NaN if it is not understood.
    """

    words: str
    dimension: str = ""
    factor: float = math.nan

    def as_dimension(self, *dimensions: str) -> "Unit":
        """Return the unit if it measures one of these, else as one that is not understood."""
        return self if self.dimension in dimensions else Unit(self.words)


def _spell(*dimensions: str) -> str:
    """Join the spellings of all units with these dimensions."""
    return "|".join(words for dimension, _, words in _UNITS if dimension in dimensions)


# Patterns that find units in text, such as cm/s2, cm/sec/sec, cm s^-2, cm_s2, up to centimetres
# per second squared. An underscore may stand for a blank.
GAP = r"[\s_.*]*"
PER = r"(?:/|per|p)"
SECOND = r"s(?:ec(?:ond)?s?)?"
_LENGTH = rf"(?:{_spell('length')})"
_SQUARED = (
    rf"[({{]?(?:{SECOND}(?:{GAP}{PER}{GAP}|[\s_.*]+){SECOND}|ss"
    rf"|{SECOND}{GAP}(?:\^?{GAP}[({{]?-?2[)}}]?|squared))[)}}]?"
)
PER_SQUARED_SECOND = rf"{_LENGTH}{GAP}(?:/|per){GAP}{_SQUARED}"
ACCELERATION = (
    rf"(?:{_LENGTH}{GAP}(?:{PER}{GAP})?{_SQUARED}"
    rf"|{_spell('acceleration').replace(' ?', '[ _]*').replace('[ -]', '[ _-]')})"
)
VELOCITY = (
    rf"(?:{_LENGTH}(?:{GAP}{PER}{GAP}{SECOND}|_{SECOND}"
    rf"|[\s_.*]+{SECOND}{GAP}\^?{GAP}[({{]?-1[)}}]?))"
)
TIME = rf"(?:{_spell('time')})"
# A unit is a word of its own; an underscore may stand beside it, as in acc_g.
WORD_START = r"(?<![^\W_])"
WORD_END = r"(?![^\W_]|[/^*])"

_FACTOR = re.compile(
    rf"(?P<joint>\s*/\s*|\s+per\s+|[\s.*]+|)(?P<unit>{_spell(*{row[0] for row in _UNITS})})"
    r"\s*(?:(?P<power>-?[1-9])|(?P<squared>squared))?(?![^\W\d_])"
)


def parse_unit(words: str) -> Unit:
    """Parse a unit, alone or a product; of no dimension if it is not understood."""
    plain = normalize(words).lower().replace("_", " ").strip(" .")
    for dimension, factor, spellings in _UNITS:
        if re.fullmatch(spellings, plain):
            return Unit(words, dimension, factor)
    plain = re.sub(r"[()\[\]{}^]|\*\*", "", plain)
    # Some write p for per, and ss for squared seconds.
    plain = re.sub(r"(?<=m)ps(?=\d|ec|$)", "/s", plain)
    plain = re.sub(r"(?:\bs|(?<=m)s)s$", "s2", plain)
    plain = re.sub(r"^([cmn]?m)(?=s-?2$)", r"\1/", plain).replace("/s-2", "/s2")
    plain = re.sub(r"^1?\s*(?=/|per\b)", "1 ", plain)
    powers: Counter[str] = Counter()
    value = 1.0
    below = False
    at = 0
    while at < len(plain):
        match = _FACTOR.match(plain, at)
        if match is None:
            return Unit(words)
        dimension, factor = next(
            (row[0], row[1]) for row in _UNITS if re.fullmatch(row[2], match["unit"])
        )
        power = int(match["power"] or (2 if match["squared"] else 1))
        # Whatever follows a stroke is below it, and so is a time behind a length, as in cm_s2:
        # no unit is a length times a time.
        below |= match["joint"].strip() in ("/", "per")
        if below or (dimension == "time" and powers["length"] > 0 and power > 0):
            power = -power
        if dimension != "ratio":
            powers[dimension] += power
        value *= factor**power
        at = match.end()
    product = tuple(sorted((name, power) for name, power in powers.items() if power))
    dimension = _PRODUCTS.get(product, "other")
    return Unit(words, dimension, value) if at else Unit(words)


def normalize(text: str) -> str:
    """Give one form to what looks alike: powers, minus signs, dots of products, micro."""
    # NFKC turns a superscript 2 into 2 and the micro sign into a Greek letter, but leaves the
    # minus sign, the middle dot and the dot operator.
    return unicodedata.normalize("NFKC", text).translate({0x2212: "-", 0xB7: ".", 0x22C5: "."})
