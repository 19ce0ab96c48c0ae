"""Units of records, and what the text around a record states about unit and time step.

Headers, comments and names of columns are written for people. What they state is found here and
given in m/s2 and s; the readers compare it with what the caller states.
"""

import math
import re
import unicodedata
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

# Standard gravity, the unit g of records: not the gravity that acts on the block.
_G = 9.80665
_UNITS = {
    "m/s2": 1.0,
    "cm/s2": 0.01,
    "mm/s2": 0.001,
    "gal": 0.01,
    "g": _G,
    "%g": 0.01 * _G,
    "mg": 0.001 * _G,
}


class Stated(NamedTuple):
    """What a text states: its words and their value, NaN if they are not understood."""

    words: str
    value: float


def _pattern(text: str) -> re.Pattern[str]:
    return re.compile(text, re.IGNORECASE)


# Accelerations: cm/s2, cm/sec/sec, cm s^-2, cm_s2, ... up to centimetres per second squared.
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
_KNOWN = (
    rf"(?:{_LENGTH}{_GAP}(?:{_PER}{_GAP})?{_SQUARED}"
    r"|(?P<percent>(?:%|pct|per[\s_]*cent)[\s_]*(?:of[\s_]*)?g)"
    r"|(?P<milli>milli[\s_-]*g|mg)|(?P<g>g(?:'?s)?)|(?P<gal>gals?))"
)
_OTHER = rf"(?:counts?|volts?|mv|[ck]m|[mck]?m{_GAP}(?:/|per|p|_){_GAP}{_S})"
_ANY = rf"(?:{_KNOWN}|{_OTHER})"
_START, _END = r"(?<![a-z0-9])", r"(?![a-z0-9/^*])"
_NAMES = {"m": "m/s2", "cm": "cm/s2", "mm": "mm/s2", "percent": "%g", "milli": "mg"}

_UNIT = _pattern(_KNOWN)
_UNIT_IN_NAME = _pattern(f"{_START}{_ANY}{_END}")
# In running text g, gal and cm are units only in such places; an amount, "0.1 cm/s2", is none.
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
_TIME_UNITS = {
    _S: 1.0,
    r"m(?:illi)?s(?:ecs?|econds?)?": 1e-3,
    r"(?:u|\u03bc|micro)s(?:ecs?|econds?)?": 1e-6,
    r"n(?:ano)?s(?:ecs?|econds?)?": 1e-9,
    r"min(?:ute)?s?": 60.0,
    r"h(?:(?:ou)?rs?)?": 3600.0,
}
_TIME = f"(?:{'|'.join(_TIME_UNITS)})"
# "units of g", "UNITS: s, cm/s2", or of something that is not understood, but of no time.
_DECLARED = _pattern(
    r"\bunits?(?:\s+(?:of|in|are|is)\b|\s*[:=(\[])[\s:=(\[]*"
    rf"(?:{_TIME}\s*[,;]\s*)?(?P<unit>{_ANY}{_END}|(?!(?:time|{_TIME})(?![a-z0-9]))[^\s,;)\]]+)"
)
_WORD = r"[^\W\d_]++"
_TIMES = _pattern(
    r"(?:(?:elapsed|relative|record)[\s_]*)?(?:t|times?)(?:[\s_]*[\[(](?P<inside>[^\])]*)[\])]"
    rf"|(?:[\s_]+in)?[\s_]+(?P<after>{_WORD})|\s*/\s*(?P<over>{_WORD}))?"
)

# Fortran may write 1.0-100 for 1e-100.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ed][-+]?\d+|[-+]\d{2,3}(?![\d.]))?"
_STEP_UNIT = rf"(?![a-z0-9])(?:\s*[\[(]\s*(?P<inside>{_WORD})\s*[\])]|_(?P<after>{_WORD}))?"
_VALUE = rf"\s*(?:[=:]|\bis\b|\bof\b)?\s*(?P<number>{NUMBER})(?P<tail>.*)"
_STEP = _pattern(
    r"\b(?:dt|delta[\s_-]*t|time[\s_-]*(?:step|interval|increment)|delta(?=\s*[=:])"
    rf"|sampl(?:e|ing)[\s_-]*(?:interval|period|step|spacing)){_STEP_UNIT}{_VALUE}"
)
_RATE = _pattern(rf"\bsampl(?:e|ing)[\s_-]*(?:rate|frequency){_STEP_UNIT}{_VALUE}")
_PER_SECOND = rf"(?:hz|hertz|sps|(?:samples?|1)\s*(?:/|per)\s*{_S})(?![a-z])"
_HERTZ = _pattern(rf"\s*[\[(]?\s*{_PER_SECOND}")
_SAMPLES = _pattern(rf"(?P<number>{NUMBER})\s*(?!hz|hertz|1){_PER_SECOND}")
_UNIT_OF_STEP = _pattern(
    rf"\s*[\[(]?\s*(?P<unit>{_WORD})(?P<key>\s*[=:])?|\s*(?:$|[(;)\]]|[,.](?!\d))"
)
_FIRST_WORD = re.compile(rf"(?:\s*[\[(]?\s*{_WORD}(?:\s*/\s*{_WORD})?(?!\s*[=:]))?")

_ALIKE = {0x2212: "-", 0xB7: ".", 0x22C5: "."}  # minus sign and dots of products


def factor_of(unit: str) -> float:
    """A unit in m/s2, or a `ValueError`."""
    factor = unit_factor(unit)
    if math.isnan(factor):
        raise ValueError(f"unit must be {ALLOWED}, got {unit!r}")
    return factor


def unit_factor(unit: str) -> float:
    """A unit in m/s2; NaN if it is not understood."""
    match = _UNIT.fullmatch(_plain(str(unit)).strip())
    return _stated(match).value if match else math.nan


def in_si(factor: float, values: np.ndarray) -> np.ndarray:
    """Accelerations in m/s2, from their unit."""
    with np.errstate(over="ignore"):  # inf, which a record refuses
        return factor * values


def units_in_name(name: str) -> list[Stated]:
    """The units that the name of a column states, for example acc_cm_s2 or acc [g]."""
    return [_stated(match) for match in _UNIT_IN_NAME.finditer(_plain(name))]


def units_in_text(line: str) -> list[Stated]:
    """The units of acceleration that a line of text states, from left to right."""
    line = _plain(line)
    stated = {
        match.start("unit"): _stated(match, "unit")
        for pattern in reversed(_UNITS_IN_TEXT)
        for match in pattern.finditer(line)
        if not _AMOUNT.search(line[: match.start("unit")])
    }
    if not stated and (match := _DECLARED.search(line)):
        return [_stated(match, "unit")]
    return [stated[start] for start in sorted(stated)]


def times_in(name: str) -> float | None:
    """The unit [s] of a column of times, NaN if not understood; None if it is no such column."""
    match = _TIMES.fullmatch(_plain(name))
    if match is None:
        return None
    if match["inside"] is not None:
        return _time_unit(match["inside"].strip())
    word = match["after"] or match["over"]
    seconds = _time_unit(word) if word else 1.0
    return None if math.isnan(seconds) else seconds


def steps_in_text(line: str) -> list[Stated]:
    """The time steps [s] that a line of text states, also as a number of samples per second."""
    line = _plain(line)
    stated = []
    for pattern in (_STEP, _RATE):
        if match := pattern.search(line):
            words = match[0].removesuffix(match["tail"]) + _first_word(match["tail"])
            stated.append(Stated(words.strip(), _step(match, pattern is _RATE)))
    rates = ((match[0], as_number(match["number"])) for match in _SAMPLES.finditer(line))
    return stated + [Stated(words, _inverse(rate)) for words, rate in rates]


def step_unit(tail: str) -> float:
    """The unit [s] of a number from the text after it: 1 if there is none, NaN if not clear."""
    match = _UNIT_OF_STEP.match(tail)
    if match is None:
        return math.nan
    # In "DT= .01 NPTS= 400" the word belongs to what follows.
    return 1.0 if match["unit"] is None or match["key"] else _time_unit(match["unit"])


def as_number(word: str) -> float:
    """The value of a `NUMBER`, as Fortran may write it."""
    word = word.lower().replace("d", "e")
    return float(word if "e" in word else re.sub(r"(?<=[\d.])(?=[-+])", "e", word))


def quoted(names: Iterable[str]) -> str:
    """The first of several names, for a message."""
    names = [*names]
    return ", ".join([short(name) for name in names[:12]]) + (", ..." if names[12:] else "")


def short(word: str) -> str:
    """A word in quotes, cut if it is long."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")


ALLOWED = f"one of {quoted(_UNITS)}"


def _plain(text: str) -> str:
    """Text with one form of what looks alike: powers, minus signs, the micro sign."""
    return unicodedata.normalize("NFKC", text).translate(_ALIKE)


def _stated(match: re.Match[str], group: str | int = 0) -> Stated:
    words = match[group] if "(" in match[group] else match[group].rstrip(")]}")
    groups = {name for name, part in match.groupdict().items() if part} - {"unit"}
    values = [_UNITS[_NAMES.get(name, name)] for name in groups]
    return Stated(words, values[0] if values else math.nan)


def _time_unit(word: str) -> float:
    units = (seconds for unit, seconds in _TIME_UNITS.items() if _pattern(unit).fullmatch(word))
    return next(units, math.nan)


def _step(match: re.Match[str], is_rate: bool) -> float:
    """The time step [s] of a match of `_STEP` or `_RATE`."""
    number, key, tail = as_number(match["number"]), match["inside"] or match["after"], match["tail"]
    if is_rate and _HERTZ.match(key or tail):
        return _inverse(number)
    if is_rate and not key and not _first_word(tail):
        # Without a unit, a number of samples per second, if it can be one.
        return _inverse(number) if number >= 1 else math.nan
    return number * (_time_unit(key) if key else step_unit(tail))


def _first_word(text: str) -> str:
    match = _FIRST_WORD.match(text)
    return match[0] if match else ""


def _inverse(number: float) -> float:
    return 1 / number if number else math.nan
