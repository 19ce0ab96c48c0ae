"""Heads of columns: which quantity they name, and which unit they state."""

import functools
import re
from typing import NamedTuple

from .quantities import QUANTITIES, QUANTITY_BY_DIMENSION, SPAN
from .units import ACCELERATION, VELOCITY, WORD_END, WORD_START, Unit, normalize, parse_unit

# Names so short that the unit decides: "T [g]" is an acceleration, and no time.
_SHORT = re.compile(r".|base", re.I)
# Spelled exactly so in Eurocode 8; SE may be a direction.
_ELASTIC_SPECTRUM = r"(?<![^\W\d_])S_?a?e(?![^\W\d_])"

_IN_BRACKETS = re.compile(
    r"(?<![/^*(])(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>(?:[^()]|\([^()]*\))*)\))"
)
# In round brackets remarks stand as well: an argument, a direction, a damping, a treatment.
_REMARK = (
    r"t|t ?[n\d]?|[ensw]|ns|ew|ud|[xyzhv]\d?|[hlt]\d|north|south|east|west|up|down|horizontal"
    r"|vertical|(?:un)?(?:corrected|filtered|processed)|raw|table|base|top|ground|measured|input"
    r"|abs\w*|rel\w*|max\w*|pos\w*|[\d.,]+|.*\d ?%.*|.*damp.*|.*\d ?(?:deg|\u00b0)|time"
)
# Units that are clear wherever they stand in a name, as in acc_g_east. A number of degrees is
# an azimuth.
_CLEAR = (
    rf"{ACCELERATION}|%|{VELOCITY}|counts?|volts?|m[vm]|cm|kn|[km]?pa|mrad|hz|rad"
    r"|(?<!\d)(?<!\d )deg(?:rees?)?|\u00b0"
)


class Head(NamedTuple):
    """A column as its head describes it.

    Attributes
    ----------
    words : str
        As it is printed.
    name : str
        Without its unit.
    quantity : str
        A key of `QUANTITIES`, or what its unit measures; empty if neither is known.
    units : tuple of Unit
        The units that it states, mostly one or none. Units that are not understood, or do not
        fit the quantity, have an empty dimension and the factor NaN.
    """

    words: str
    name: str
    quantity: str
    units: tuple[Unit, ...] = ()

    @property
    def unit(self) -> Unit | None:
        """The unit that it states; None for none, of no dimension if several contradict."""
        if not self.units:
            return None
        if len({unit[1:] for unit in self.units}) == 1:
            return self.units[0]
        return Unit(" and ".join(unit.words for unit in self.units))

    @property
    def factor(self) -> float:
        """The value of its unit in SI; 1 if it states none, NaN if that is not understood."""
        return self.unit.factor if self.unit else 1.0


# Files of a suite have the same heads.
@functools.lru_cache(maxsize=256)
def read_head(words: str) -> Head:
    """Read the head of a column: its quantity and its unit, as far as it states them."""
    plain = " ".join(normalize(words).replace("_", " ").split())
    bracketed = [match for match in _IN_BRACKETS.finditer(plain) if _is_unit(plain, match)]
    if bracketed:
        inside = [(match["square"] or match["round"] or "").strip() for match in bracketed]
        return _settle(words, _cut_out(plain, bracketed), [*map(parse_unit, inside)])
    if match_whole(plain):
        return _settle(words, plain, [])
    # m or h alone may be anything, but for a quantity that has such units.
    for match in re.finditer(r"\s*/\s*|\s+(?:in\s+)?", plain):
        name = plain[: match.start()]
        unit = parse_unit(plain[match.end() :])
        quantity = find_quantity(name)
        if quantity and unit.dimension in QUANTITIES[quantity].dimensions:
            return Head(words, name, quantity, (unit,))
    clear = [*re.finditer(f"{WORD_START}(?:{_CLEAR}){WORD_END}", plain, re.I)]
    return _settle(words, _cut_out(plain, clear), [parse_unit(match[0]) for match in clear])


def find_quantity(name: str) -> str:
    """Find the quantity that the name of a column says, without a unit; empty for none."""
    if quantity := match_whole(name):
        return quantity
    if re.search(_ELASTIC_SPECTRUM, name):
        return "spectral acceleration"
    words = split_words(name)
    for quantity, known in QUANTITIES.items():
        if any(re.fullmatch(known.words, word, re.I) for word in words):
            return quantity
    return ""


def split_words(name: str) -> list[str]:
    """Split a name into its words of letters, and those also where it is in camelCase."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return re.findall(r"[^\W\d_]+", name if apart == name else f"{name} {apart}")


def match_whole(name: str) -> str:
    """Find the quantity whose pattern matches the whole name; empty for none."""
    for quantity, known in QUANTITIES.items():
        if name and re.fullmatch(known.names, name, re.I):
            return quantity
    return ""


def _is_unit(name: str, match: re.Match[str]) -> bool:
    """Return whether brackets hold a unit, understood or not, and no remark."""
    if re.fullmatch(SPAN, match[0], re.I):
        return False
    if match["square"] is not None:
        return True
    words = match["round"].strip()
    if not re.fullmatch(_REMARK, words, re.I):
        return True
    # N is a newton beside a force, and a direction beside an acceleration.
    before = find_quantity(name[: match.start()].strip())
    return bool(parse_unit(words).dimension) and before != "acceleration"


def _cut_out(name: str, matches: list[re.Match[str]]) -> str:
    """Cut parts out of a name."""
    for match in reversed(matches):
        name = f"{name[: match.start()]} {name[match.end() :]}"
    return " ".join(name.split()).strip("_ /,")


def _settle(words: str, name: str, units: list[Unit]) -> Head:
    """Settle the quantity of a column by its name and its units."""
    quantity = find_quantity(name)
    if not units:
        return Head(words, name, quantity)
    dimension = units[0].dimension
    known = QUANTITIES[quantity].dimensions if quantity else ()
    # "time since trigger [s]" is no counter, and "T [g]" the transverse acceleration.
    unit_decides = quantity == "counter" or (
        bool(_SHORT.fullmatch(name)) and (dimension not in known or quantity == "level")
    )
    if not quantity or (unit_decides and dimension):
        return Head(words, name, QUANTITY_BY_DIMENSION.get(dimension, dimension), tuple(units))
    return Head(words, name, quantity, tuple(unit.as_dimension(*known) for unit in units))
