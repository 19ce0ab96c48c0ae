"""Quantities in tables: by which names of columns they are told, and in which units they come.

A new quantity is a line of `QUANTITIES`, where the first that fits a name wins; a new unit is one
of `units.py`, as is what a product of units measures.
"""

from typing import NamedTuple


class Quantity(NamedTuple):
    """A quantity by the names of its columns."""

    # Pattern of whole names, without their unit and with blanks for underscores.
    names: str
    # Pattern of words that make any name that has them one of this quantity.
    words: str
    # What its units measure, as in `units.py`; nothing for words.
    dimensions: tuple[str, ...]


_RATIO = ("ratio",)
_TIME = ("time",)
_LENGTH = ("length",)
_OF = r"(?:of )?(?:the )?"
_YEARS = r"(?:years?|yrs?|a)"
# A number of years, which is no unit even in brackets.
SPAN = rf"[(\[]?(?P<years>\d+(?:\.\d+)?)[ -]?{_YEARS}[)\]]?"
_EXCEEDANCE = rf"(?:{_OF}exceed[ae]nces?|{_OF}exceed(?:ing|ed))"
_PROBABILITY = r"(?:probability|probabilities|prob|poes?)"
_LARGEST = r"(?:peaks?|max(?:imum)?|largest)"
_MEAN = r"(?:mean |hazard |exceed[ae]nce )*"
_ANNUAL = rf"{_MEAN}(?P<annual>(?:annual|yearly) )?{_MEAN}"
# What may stand in front of the name of a level, and behind it.
_KIND = r"(?:level |horizontal |geometric |mean |of |value )*"
_LEVEL = r"(?: levels?| values?| iml?)*"
_PEAK = r"peak (?:horizontal )?ground"
# Of motions and spectra a word in the name is enough, since whatever is no acceleration must not
# be taken for one. Of hazards and objects all of the name has to be understood.
QUANTITIES: dict[str, Quantity] = {
    "time": Quantity(
        rf"(?:elapsed |relative |record )?(?:t|times?)(?: {_OF}impacts?)?|impact times?"
        r"|s|secs?|seconds?",
        "",
        _TIME,
    ),
    "period": Quantity(
        r"(?:natural |structural |vibration )?periods?|tn|frequenc(?:y|ies)|freqs?",
        r"periods?|frequenc(?:y|ies)|freqs?",
        ("time", "frequency"),
    ),
    "time step": Quantity(r"(?:time|sampling) ?(?:steps?|intervals?)", "", _TIME),
    "duration": Quantity("", r"d?dt|durations?|intervals?|delays?|lags?|steps?", _TIME),
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
        rf"(?:(?: (?:in|within|during|for|per))? {SPAN}|(?P<yearly> per {_YEARS}))?",
        _PROBABILITY,
        _RATIO,
    ),
    "spectral acceleration": Quantity(
        "",
        r"p?s[avd]e?|sa(?:avg|gm|rotd|larger|geo\w*|max|mean)|avgsa|rotd|spectr\w*|fourier|fas|eas"
        r"|pseudo",
        ("acceleration", "velocity", "length"),
    ),
    "intensity": Quantity("", r"arias|cav|husid|mmi", ("velocity", "ratio")),
    "pga": Quantity(rf"{_KIND}(?:pga|{_PEAK} acceleration){_LEVEL}", "pga", ("acceleration",)),
    "pgv": Quantity(rf"{_KIND}(?:pgv|{_PEAK} velocity){_LEVEL}", "pgv", ("velocity",)),
    "level": Quantity(
        r"(?:intensity(?: measure)?|iml?)?(?: ?levels?)?", "", ("acceleration", "velocity")
    ),
    "width": Quantity(r"(?:full )?width|base", "", _LENGTH),
    "height": Quantity(r"(?:full )?height", "", _LENGTH),
    "depth": Quantity(r"(?:full )?depth", "", _LENGTH),
    "inertia ratio": Quantity(r"inertia ratio|kappa", "", _RATIO),
    "restitution": Quantity(r"(?:coefficient of )?restitution|c", "", _RATIO),
    "restitution coefficient of variation": Quantity(
        r"restitution (?:coefficient of variation|cov|scatter)"
        r"|(?:coefficient of variation|cov|scatter) of (?:the )?(?:restitution|c)",
        "",
        _RATIO,
    ),
    "one-sided": Quantity(r"one[ -]?sided", "", _RATIO),
    "floor period": Quantity(r"floor period|period of (?:the )?floor", "", _TIME),
    "floor damping": Quantity(
        r"floor damping(?: ratio)?|damping(?: ratio)? of (?:the )?floor", "", _RATIO
    ),
    "name": Quantity(r"(?:object |test )?names?|objects?", "", _RATIO),
    # Of tests, in words.
    "file": Quantity(r"(?:motion |record )?files?(?: ?names?)?", "", ()),
    "column": Quantity("columns?", "", ()),
    "unit": Quantity(r"units?(?: of (?:the )?accelerations?)?|acceleration units?", "", ()),
    "overturned": Quantity("overturn(?:ed|s)|outcomes?", "", ()),
    "group": Quantity("groups?|earthquakes?|events?", "", ()),
    "scale": Quantity("scales?(?: factors?)?|factors?", "", _RATIO),
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
QUANTITY_BY_DIMENSION = {
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
