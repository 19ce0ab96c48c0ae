"""What the text around a record says about its unit and its time step.

Headers, comments and names of columns are written for people. What they say is found here and
given in m/s2 and s; the reader compares it with what its caller says.
"""

import math
import re
import unicodedata
from typing import NamedTuple

# Standard gravity, the unit g of records: not the gravity that acts on the block.
_G = 9.80665
UNITS = {
    "m/s2": 1.0,
    "cm/s2": 0.01,
    "mm/s2": 0.001,
    "gal": 0.01,
    "g": _G,
    "%g": 0.01 * _G,
    "mg": 0.001 * _G,
}


class Stated(NamedTuple):
    """What a text says: in its words, and as a number, which is nan if not understood."""

    words: str
    value: float


def _pattern(text: str) -> re.Pattern[str]:
    return re.compile(text, re.IGNORECASE)


# Accelerations, from cm/s2 over cm/sec/sec, cm s^-2 and cm_s2 to centimetres per second squared.
_GAP = r"[\s_.*]*"
_PER = r"(?:/|per|p)"
_S = r"s(?:ec(?:ond)?s?)?"
_LENGTH = (
    r"(?:(?P<mm>mm|millimet(?:er|re)s?)|(?P<cm>cm|centimet(?:er|re)s?)|(?P<m>m|met(?:er|re)s?)"
    r"|km|ft|foot|feet|in|inch(?:es)?)"
)
_SQUARED = (
    rf"[({{]?(?:{_S}(?:{_GAP}{_PER}{_GAP}|[\s_.*]+){_S}|ss"
    rf"|{_S}{_GAP}(?:\^?{_GAP}[({{]?-?2[)}}]?|squared))[)}}]?"
)
_PERCENT = r"(?:%|pct|per[\s_]*cent)[\s_]*(?:of[\s_]*)?g"
_KNOWN = (
    rf"(?:{_LENGTH}{_GAP}(?:{_PER}{_GAP})?{_SQUARED}|(?P<percent>{_PERCENT})"
    r"|(?P<milli>milli[\s_-]*g|mg)|(?P<g>g(?:'?s)?)|(?P<gal>gals?))"
)
_OTHER = rf"(?:counts?|volts?|mv|[ck]m|[mck]?m{_GAP}(?:/|per|p|_){_GAP}{_S})"
_ANY = rf"(?:{_KNOWN}|{_OTHER})"
_START, _END = r"(?<![a-z0-9])", r"(?![a-z0-9/^*])"
_FACTORS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "gal": 0.01, "g": _G} | {
    "percent": UNITS["%g"],
    "milli": UNITS["mg"],
}

_UNIT = _pattern(_KNOWN)
_UNIT_IN_NAME = _pattern(f"{_START}{_ANY}{_END}")
# In running text g, gal and cm are units only where the text says so; "0.1 cm/s2" says nothing.
_UNITS_IN_TEXT = [
    _pattern(before + "(?P<unit>" + unit + ")" + after)
    for before, unit, after in (
        (_START, rf"{_LENGTH}{_GAP}(?:/|per){_GAP}{_SQUARED}", _END),
        (r"[(\[{]\s*", _KNOWN, r"\s*[)\]}]"),
        (r"\bin\s+", _KNOWN, _END),
        (r"\bacc[a-z]*\.?[\s,:=-]+", _KNOWN, r"\s*\.?(?:$|[,;)])"),
        (r"\bacc[^,;()\[\]]*?(?:[(\[{]\s*|\bin\s+)", _ANY, _END),
    )
]
_AMOUNT = _pattern(r"(?:\d[\d.]*(?:e[-+]?\d+)?\s*|\bper\s*|\b(?:pga|peak|max(?:imum)?)\b[^,;]*)$")
_DECLARED = _pattern(r"\bunits?(?:\s+(?:of|in|are|is)\b|\s*[:=(\[])[\s:=(\[]*(?=\S)")

_TIME_UNITS = [
    (_pattern(words), seconds)
    for words, seconds in (
        (_S, 1.0),
        (r"m(?:illi)?s(?:ecs?|econds?)?", 1e-3),
        (r"(?:u|\u03bc|micro)s(?:ecs?|econds?)?", 1e-6),
        (r"n(?:ano)?s(?:ecs?|econds?)?", 1e-9),
        (r"min(?:ute)?s?", 60.0),
        (r"h(?:(?:ou)?rs?)?", 3600.0),
    )
]
_WORD = r"[^\W\d_]++"
_TIMES = _pattern(
    r"(?:(?:elapsed|relative|record)[\s_]*)?(?:t|times?)(?:[\s_]*[\[(](?P<inside>[^\])]*)[\])]"
    rf"|(?:[\s_]+in)?[\s_]+(?P<after>{_WORD})|\s*/\s*(?P<over>{_WORD}))?"
)

# Fortran may write 1.0-100 for 1e-100.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ed][-+]?\d+|[-+]\d{2,3}(?![\d.]))?"
_STEP_UNIT = rf"(?![a-z0-9])(?:\s*[\[(]\s*(?P<inside>{_WORD})\s*[\])]|_(?P<after>{_WORD}))?"
_VALUE = rf"\s*(?:[=:]|\bis\b|\bof\b)?\s*(?P<number>{NUMBER})(?P<rest>.*)"
_STEP = _pattern(
    r"\b(?:dt|delta[\s_-]*t|time[\s_-]*(?:step|interval|increment)|delta(?=\s*[=:])"
    rf"|sampl(?:e|ing)[\s_-]*(?:interval|period|step|spacing)){_STEP_UNIT}{_VALUE}"
)
_FREQUENCY = _pattern(rf"\bsampl(?:e|ing)[\s_-]*(?:rate|frequency){_STEP_UNIT}{_VALUE}")
_PER_SECOND = rf"(?:hz|hertz|sps|(?:samples?|1)\s*(?:/|per)\s*{_S})(?![a-z])"
_HERTZ = _pattern(rf"\s*[\[(]?\s*{_PER_SECOND}")
_SAMPLES = _pattern(rf"(?P<number>{NUMBER})\s*(?!hz|hertz|1){_PER_SECOND}")
_AFTER_NUMBER = _pattern(
    rf"\s*[\[(]?\s*(?P<unit>{_WORD})(?P<key>\s*[=:])?|\s*(?:$|[(;)\]]|[,.](?!\d))"
)


_ALIKE = {0x2212: "-", 0xB7: ".", 0x22C5: "."}  # minus sign and dots of products


def plain(text: str) -> str:
    """Text in which what only looks different is the same: powers, minus signs, the micro."""
    return unicodedata.normalize("NFKC", text).translate(_ALIKE)


def unit_factor(unit: str) -> float | None:
    """What a unit is in m/s2; None if it is not understood."""
    match = _UNIT.fullmatch(plain(str(unit)).strip())
    return _stated(match).value if match and not math.isnan(_stated(match).value) else None


def units_in_name(name: str) -> list[Stated]:
    """The units that the name of a column states, for example acc_cm_s2 or acc [g]."""
    return [_stated(match) for match in _UNIT_IN_NAME.finditer(plain(name))]


def units_in_text(line: str) -> list[Stated]:
    """The units of acceleration that a line of a header states, from left to right."""
    line = plain(line)
    found = {}
    for pattern in _UNITS_IN_TEXT:
        for match in pattern.finditer(line):
            if not _AMOUNT.search(line[: match.start("unit")]):
                found.setdefault(match.start("unit"), _stated(match, "unit"))
    declared = _DECLARED.search(line)
    if declared and not found:
        return _declared_units(line[declared.end() :])
    return [found[start] for start in sorted(found)]


def _declared_units(text: str) -> list[Stated]:
    """Of what follows "units of" or "units:", which may be a list: "s, cm/s2"."""
    parts = [part.strip() for part in re.split("[,;]", text)]
    found = [_stated(match) for part in parts if (match := _UNIT_IN_NAME.match(part))]
    understood = [unit for unit in found if not math.isnan(unit.value)]
    if understood or found:
        return understood or found
    word = re.split(r"[\s,;)\]]", text, maxsplit=1)[0].rstrip(".:")
    about_time = word.lower() == "time" or time_unit(word) is not None
    return [] if about_time else [Stated(word, math.nan)]


def _stated(match: re.Match[str], group: str | int = 0) -> Stated:
    groups = match.groupdict()
    known = [factor for name, factor in _FACTORS.items() if groups.get(name)]
    words = match[group] if "(" in match[group] else match[group].rstrip(")]}")
    return Stated(words, known[0] if known else math.nan)


def time_unit(word: str) -> float | None:
    """What a unit of time is in s; None if it is none."""
    for pattern, seconds in _TIME_UNITS:
        if pattern.fullmatch(word):
            return seconds
    return None


def times_in(name: str) -> float | None:
    """What the unit of a column of times is in s; None if its name is not that of times."""
    match = _TIMES.fullmatch(plain(name))
    if match is None:
        return None
    if match["inside"] is not None:
        return _or_nan(time_unit(match["inside"].strip()))
    word = match["after"] or match["over"]
    return 1.0 if word is None else time_unit(word)


def steps_in_text(line: str) -> list[Stated]:
    """The time steps that a line of a header states, also as a number of samples per second."""
    line = plain(line)
    found = []
    for pattern, of in ((_STEP, _step), (_FREQUENCY, _step_of_frequency)):
        if match := pattern.search(line):
            words = match[0][: match.start("rest") - match.start()] + _first_word(match["rest"])
            found.append(Stated(words.strip(), of(match)))
    for match in _SAMPLES.finditer(line):
        found.append(Stated(match[0], _inverse(as_number(match["number"]))))
    return found


def step_unit(rest: str) -> float:
    """The unit of time, in s, of a number by what follows it: s if nothing, nan if not clear."""
    match = _AFTER_NUMBER.match(rest)
    if match is None:
        return math.nan
    # "DT= .01 NPTS= 400": the word belongs to what follows.
    return 1.0 if match["unit"] is None or match["key"] else _or_nan(time_unit(match["unit"]))


def as_number(word: str) -> float:
    """A `NUMBER`, as Fortran may write it."""
    word = word.lower().replace("d", "e")
    return float(word if "e" in word else re.sub(r"(?<=[\d.])(?=[-+])", "e", word))


def _step(match: re.Match[str]) -> float:
    key = match["inside"] or match["after"]
    unit = step_unit(match["rest"]) if key is None else _or_nan(time_unit(key))
    return as_number(match["number"]) * unit


def _step_of_frequency(match: re.Match[str]) -> float:
    number = as_number(match["number"])
    key = match["inside"] or match["after"]
    if _HERTZ.match(match["rest"] if key is None else key):
        return _inverse(number)
    step = _step(match)
    if key is None and not _first_word(match["rest"]):  # without a unit, per second
        return _inverse(number) if number >= 1 else math.nan
    return step


def _first_word(text: str) -> str:
    match = re.match(rf"\s*[\[(]?\s*{_WORD}(?:\s*/\s*{_WORD})?(?!\s*[=:])", text)
    return "" if match is None else match[0]


def _inverse(number: float) -> float:
    return 1 / number if number else math.nan


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
