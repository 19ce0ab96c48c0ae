"""Quantities in tables: by which names of columns they are told, and in which units they come.

A new quantity is a line of `QUANTITIES`, a new unit one of `units.py`.
"""

import functools
import math
import re
from typing import NamedTuple

from .units import ACCELERATION, VELOCITY, WORD_END, WORD_START, Unit, normalize, parse_unit


class Quantity(NamedTuple):
    """A quantity by the names of its columns.

    Attributes
    ----------
    names : str
        Pattern of whole names, without their unit, in lower case and with blanks for
        underscores.
    words : str
        Pattern of words that make any name that has them one of this quantity.
    dimensions : tuple of str
        What its units measure, as in `units.py`.
    """

    names: str
    words: str
    dimensions: tuple[str, ...]


_RATIO = ("ratio",)
_LENGTH = ("length",)
_OF = r"(?:of )?(?:the )?"
_YEARS = r"(?:years?|yrs?|a)"
# A number of years, which is no unit even in brackets.
_SPAN = rf"[(\[]?(?P<years>\d+(?:\.\d+)?)[ -]?{_YEARS}[)\]]?"
_EXCEEDANCE = rf"(?:{_OF}exceed[ae]nces?|{_OF}exceed(?:ing|ed))"
_PROBABILITY = r"(?:probability|probabilities|prob|poes?)"
_LARGEST = r"(?:peaks?|max(?:imum)?|largest)"
_MEAN = r"(?:mean |hazard |exceed[ae]nce )*"
_ANNUAL = rf"{_MEAN}(?P<annual>(?:annual|yearly) )?{_MEAN}"
# Of motions and spectra a word in the name is enough, since whatever is no acceleration must not
# be taken for one. Of hazards and objects all of the name has to be understood.
QUANTITIES: dict[str, Quantity] = {
    "time": Quantity(
        rf"(?:elapsed |relative |record )?(?:t|times?)(?: {_OF}impacts?)?|impact times?"
        r"|s|secs?|seconds?",
        "",
        ("time",),
    ),
    "period": Quantity(
        r"(?:natural |structural |vibration )?periods?|tn|frequenc(?:y|ies)|freqs?",
        r"periods?|frequenc(?:y|ies)|freqs?",
        ("time", "frequency"),
    ),
    "duration": Quantity("", r"d?dt|durations?|intervals?|delays?|lags?|steps?", ("time",)),
    "return period": Quantity(
        rf"(?:mean )?(?:return|recurrence) (?:period|interval)s?(?: {_EXCEEDANCE})?(?: in years)?",
        "",
        ("years",),
    ),
    "rate": Quantity(
        rf"{_ANNUAL}(?:rates?|frequency|frequencies|lambda|\u03bb|m?afe|maf)(?: {_EXCEEDANCE})?"
        rf"(?: per {_YEARS})?",
        "",
        ("rate",),
    ),
    "probability": Quantity(
        rf"{_ANNUAL}{_PROBABILITY}(?: {_EXCEEDANCE})?"
        rf"(?:(?: (?:in|within|during|for|per))? {_SPAN}|(?P<yearly> per {_YEARS}))?",
        _PROBABILITY,
        _RATIO,
    ),
    "spectral acceleration": Quantity(
        "",
        r"p?s[avd]e?|sa(?:avg|gm|rotd|larger|geo\w*|max|mean)|avgsa|rotd|spectr\w*|fourier|fas|eas"
        r"|pseudo|design|target|resp(?:onse)?",
        ("acceleration", "velocity", "length"),
    ),
    "intensity": Quantity("", r"arias|cav|husid|mmi", ("velocity", "ratio")),
    "pga": Quantity(
        r"(?:level |horizontal |geometric |mean |of |value )*"
        r"(?:pga|peak (?:horizontal )?ground acceleration)(?: levels?| values?| iml?)*",
        "pga",
        ("acceleration",),
    ),
    "pgv": Quantity(
        r"(?:level |horizontal |geometric |mean |of |value )*"
        r"(?:pgv|peak (?:horizontal )?ground velocity)(?: levels?| values?| iml?)*",
        "pgv",
        ("velocity",),
    ),
    "level": Quantity(
        r"(?:intensity(?: measure)?|iml?)?(?: ?levels?)?",
        "",
        ("acceleration", "velocity"),
    ),
    "width": Quantity(r"(?:full )?width|base", "", _LENGTH),
    "height": Quantity(r"(?:full )?height", "", _LENGTH),
    "depth": Quantity(r"(?:full )?depth", "", _LENGTH),
    "inertia ratio": Quantity(r"inertia ratio|kappa", "", _RATIO),
    "restitution": Quantity(r"(?:coefficient of )?restitution|c", "", _RATIO),
    "restitution scatter": Quantity(
        r"restitution (?:scatter|cov)"
        r"|(?:scatter|cov|coefficient of variation) of (?:the )?(?:restitution|c)",
        "",
        _RATIO,
    ),
    "name": Quantity(r"(?:object )?names?|objects?", "", _RATIO),
    # The largest one after an impact, of a block that rocks freely.
    "peak rotation": Quantity(
        rf"{_LARGEST}|(?:{_LARGEST} ?)?(?:rotations?|(?:(?:rotation|tilt) ?)?angles?|alpha|theta"
        r"|\u03b1|\u03b8|tilts?)(?: max)?(?: after (?:the )?impacts?)?",
        "",
        ("angle",),
    ),
    "velocity": Quantity("", r"vel(?:ocity|ocities)?|speed", ("velocity", "angular velocity")),
    "displacement": Quantity("", r"disp(?:l(?:acements?)?)?|lvdt|stroke", _LENGTH),
    "rotation": Quantity(
        "",
        r"rot(?:ations?)?|tilts?|inclination|alpha|theta|phi|\u03b1|\u03b8|\u03c6|angles?",
        ("angle",),
    ),
    "acceleration": Quantity("a", r"acc\w*", ("acceleration",)),
    "mass": Quantity("", r"mass|weight", ("mass",)),
    "force": Quantity("", r"forces?|loads?", ("force",)),
    "strain": Quantity("", r"strains?", ("strain",)),
    "temperature": Quantity("", r"temp(?:erature)?s?", ("temperature",)),
    "angular velocity": Quantity("", r"gyro\w*", ("angular velocity",)),
    "counter": Quantity(
        "", r"samples?|index|number|id|counter|trigger|flag|status", ("ratio", "counts")
    ),
}
# The quantity of a column whose name says none, by what its unit measures.
_BY_DIMENSION = {
    "acceleration": "acceleration",
    "velocity": "velocity",
    "length": "displacement",
    "angle": "rotation",
    "angular velocity": "rotation",
    "angular acceleration": "rotation",
    "time": "time",
    "frequency": "period",
    "years": "return period",
}
# Names that mean what their unit says, where that is no unit of the quantity.
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
        The units that it states, mostly one or none. One that is not understood, or that the
        quantity cannot have, is of no dimension.
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
        return Unit(" and ".join(unit.words for unit in self.units), "", math.nan)

    @property
    def is_whole(self) -> bool:
        """True if all of its name is that of a quantity, not a word of it only."""
        return bool(_match_whole(self.name))

    @property
    def factor(self) -> float:
        """The value of its unit in SI; 1 if it states none, NaN if that is not understood."""
        if self.units:
            return self.unit.factor if self.unit else math.nan
        return 1.0


# Files of a suite have the same heads.
@functools.lru_cache(maxsize=256)
def read_head(words: str) -> Head:
    """Read the head of a column: its quantity and its unit, as far as it states them."""
    plain = " ".join(normalize(words).replace("_", " ").split())
    bracketed = [match for match in _IN_BRACKETS.finditer(plain) if _is_unit(plain, match)]
    if bracketed:
        units = [
            parse_unit((match["square"] or match["round"] or "").strip())
            for match in bracketed
        ]
        return _settle(words, _cut_out(plain, bracketed), units)
    if _match_whole(plain):
        return _settle(words, plain, [])
    # m or h alone may be anything, but for a quantity that has such units.
    for match in re.finditer(r"\s*/\s*|\s+(?:in\s+)?", plain):
        unit = parse_unit(plain[match.end() :])
        quantity = find_quantity(plain[: match.start()])
        if unit.dimension and quantity and unit.dimension in QUANTITIES[quantity].dimensions:
            return Head(words, plain[: match.start()], quantity, (unit,))
    clear = [*re.finditer(f"{WORD_START}(?:{_CLEAR}){WORD_END}", plain, re.I)]
    return _settle(words, _cut_out(plain, clear), [parse_unit(match[0]) for match in clear])


def find_quantity(name: str) -> str:
    """Find the quantity that the name of a column says, without a unit; empty for none."""
    if quantity := _match_whole(name):
        return quantity
    if re.search(_ELASTIC_SPECTRUM, name):
        return "spectral acceleration"
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    words = re.findall(r"[^\W\d_]+", f"{name} {apart}")
    return next(
        (
            key
            for key, known in QUANTITIES.items()
            if any(re.fullmatch(known.words, word, re.I) for word in words)
        ),
        "",
    )


def _match_whole(name: str) -> str:
    """Find the quantity of which this is a whole name; empty for none."""
    if not name:
        return ""
    return next(
        (key for key, known in QUANTITIES.items() if re.fullmatch(known.names, name, re.I)), ""
    )


def _is_unit(name: str, match: re.Match[str]) -> bool:
    """Return whether brackets hold a unit, understood or not, and no remark."""
    if re.fullmatch(_SPAN, match[0], re.I):
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
    # T in g is no time, but a transverse acceleration; x in g no level, base in g no width.
    says_little = bool(_SHORT.fullmatch(name)) and (
        dimension not in known or quantity == "level"
    )
    if not quantity or (says_little and dimension):
        return Head(words, name, _BY_DIMENSION.get(dimension, dimension), tuple(units))
    fitting = (
        unit if unit.dimension in known else Unit(unit.words, "", math.nan) for unit in units
    )
    return Head(words, name, quantity, tuple(fitting))
