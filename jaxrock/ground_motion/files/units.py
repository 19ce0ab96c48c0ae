"""Statements about units and time steps around records, found in text and converted to SI.

Headers, comments and names of columns are written for people. Statements in them are found
here, by regular expressions that are built up from named parts; all of them ignore the case.
A statement that is recognized but not understood is NaN, which the readers refuse: no unit is
ever guessed. The readers compare what is found with what the caller states.
"""

import math
import re

from ..units import (
    ACCELERATION,
    GAP,
    LENGTH,
    PER,
    SECOND,
    SQUARED,
    Stated,
    interpret_unit,
    normalize,
)
from ..units import UNITS as UNITS
from ..units import parse_unit as parse_unit

# Also counts, volts, lengths and velocities, which are no accelerations: without a group, they
# are NaN.
_ANY = rf"(?:{ACCELERATION}|counts?|volts?|mv|[ckn]m|[mckn]?m{GAP}(?:/|per|p|_){GAP}{SECOND})"
# A unit is a word of its own; an underscore may stand beside it, as in acc_g.
_START = r"(?<![a-z0-9])"
_END = r"(?![a-z0-9/^*])"
_SPEED = (
    rf"{_START}{LENGTH}(?:{GAP}{PER}{GAP}{SECOND}|_{SECOND}"
    rf"|[\s_.*]+{SECOND}{GAP}\^?{GAP}[({{]?-1[)}}]?){_END}"
)

# In running text g, gal and cm are units only in such places; an amount, "0.1 cm/s2", is none.
_IN_TEXT = (
    rf"{_START}(?P<unit>{LENGTH}{GAP}(?:/|per){GAP}{SQUARED}){_END}",
    rf"[(\[{{]\s*(?P<unit>{ACCELERATION})\s*[)\]}}]",
    rf"\bin\s+(?P<unit>{ACCELERATION}){_END}",
    rf"\bacc[a-z]*\.?[\s,:=-]+(?P<unit>{ACCELERATION})\s*\.?(?:$|[,;)])",
    rf"\bacc[^,;()\[\]]*?(?:[(\[{{]\s*|\bin\s+)(?P<unit>{_ANY}){_END}",
)
# What stands before a unit of an amount: a number, "per", or a peak value, as in "PGA (g)".
_AMOUNT = r"(?:\d[\d.]*(?:e[-+]?\d+)?\s*|\bper\s*|\b(?:pga|peak|max(?:imum)?)\b[^,;]*)$"
_SECONDS = {
    SECOND: 1.0,
    r"m(?:illi)?s(?:ecs?|econds?)?": 1e-3,
    r"(?:u|\u03bc|micro)s(?:ecs?|econds?)?": 1e-6,
    r"n(?:ano)?s(?:ecs?|econds?)?": 1e-9,
    r"min(?:ute)?s?": 60.0,
    r"h(?:(?:ou)?rs?)?": 3600.0,
}
_TIME = f"(?:{'|'.join(_SECONDS)})"
# "units of g", "UNITS: s, cm/s2", or of something that is not understood, but of no time.
_DECLARED = (
    r"\bunits?(?:\s+(?:of|in|are|is)\b|\s*[:=(\[])[\s:=(\[]*"
    rf"(?:{_TIME}\s*[,;]\s*)?(?P<unit>{_ANY}{_END}|(?!(?:time|{_TIME})(?![a-z0-9]))[^\s,;)\]]+)"
)
# Letters of any script. Possessive: backtracking into a word would find shorter words in it.
_WORD = r"[^\W\d_]++"
# The whole name of a column of times: in brackets anything may be its unit, otherwise one
# word.
_TIMES = (
    r"(?:(?:elapsed|relative|record)[\s_]*)?(?:t|times?)(?:[\s_]*[\[(](?P<inside>[^\])]*)[\])]"
    rf"|(?:[\s_]+in)?[\s_]+(?P<after>{_WORD})|\s*/\s*(?P<over>{_WORD}))?"
)

# Fortran may write 1.0-100 for 1e-100.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ed][-+]?\d+|[-+]\d{2,3}(?![\d.]))?"
# A unit beside the name, as in "dt [ms]", then the number, then whatever follows it.
_VALUE = (
    rf"(?![a-z0-9])(?:\s*[\[(]\s*(?P<inside>{_WORD})\s*[\])]|_(?P<after>{_WORD}))?"
    rf"\s*(?:[=:]|\bis\b|\bof\b)?\s*(?P<number>{NUMBER})(?P<tail>.*)"
)
_STEP = (
    r"\b(?:dt|delta[\s_-]*t|time[\s_-]*(?:step|interval|increment)|delta(?=\s*[=:])"
    rf"|sampl(?:e|ing)[\s_-]*(?:interval|period|step|spacing)){_VALUE}"
)
_RATE = rf"\bsampl(?:e|ing)[\s_-]*(?:rate|frequency){_VALUE}"
_PER_SECOND = rf"(?:hz|hertz|sps|(?:samples?|1)\s*(?:/|per)\s*{SECOND})(?![a-z])"
_SAMPLES = rf"(?P<number>{NUMBER})\s*(?!hz|hertz|1){_PER_SECOND}"
_UNIT_AFTER = rf"\s*[\[(]?\s*(?P<unit>{_WORD})(?!\s*[=:])(?:\s*/\s*{_WORD}(?!\s*[=:]))?"
# In "DT= .01 NPTS= 400" the word belongs to what follows.
_NO_UNIT_AFTER = rf"\s*(?:$|[(;)\]]|[,.](?!\d)|[\[(]?\s*{_WORD}\s*[=:])"


def find_units_in_name(name: str) -> list[Stated]:
    """Find the units that the name of a column states, for example acc_cm_s2 or acc [g]."""
    return [
        interpret_unit(match)
        for match in re.finditer(_START + _ANY + _END, normalize(name), re.I)
    ]


def find_speeds_in_name(name: str) -> list[Stated]:
    """Find the units of velocity that a column's name states, such as pgv [cm/s], in m/s."""
    return [interpret_unit(match) for match in re.finditer(_SPEED, normalize(name), re.I)]


def find_units_in_text(line: str) -> list[Stated]:
    """Return the units of acceleration that a line of text states, from left to right."""
    line = normalize(line)
    # By where they begin, so that a unit that several patterns find counts once. Patterns run
    # in reverse order, so that an earlier one in the list overrides a later one.
    stated = {
        match.start("unit"): interpret_unit(match, "unit")
        for pattern in reversed(_IN_TEXT)
        for match in re.finditer(pattern, line, re.I)
        if not re.search(_AMOUNT, line[: match.start("unit")], re.I)
    }
    # A declaration may be of a unit that is not understood: only where nothing else is found.
    if not stated and (match := re.search(_DECLARED, line, re.I)):
        return [interpret_unit(match, "unit")]
    return [stated[start] for start in sorted(stated)]


def find_time_unit(name: str) -> float | None:
    """Find the unit [s] of a column of times by its name; None if it is no such column.

    NaN if the unit is not understood.
    """
    match = re.fullmatch(_TIMES, normalize(name), re.I)
    # T [g] is an acceleration: the transverse one beside L [g].
    if match is None or any(math.isfinite(unit) for _, unit in find_units_in_name(name)):
        return None
    if match["inside"] is not None:
        return _parse_time_unit(match["inside"].strip())
    # Without brackets, a word that is no unit makes it another column, as "time lag" is.
    seconds = _parse_time_unit(match["after"] or match["over"] or "s")
    return None if math.isnan(seconds) else seconds


def find_steps_in_text(line: str) -> list[Stated]:
    """Find the time steps [s] that a line states, also as a number of samples per second."""
    line = normalize(line)
    stated = []
    for pattern in (_STEP, _RATE):
        if match := re.search(pattern, line, re.I):
            number = as_number(match["number"])
            tail = match["tail"]
            # The unit stands beside the name, "dt [ms] = 5", or behind: "dt = 5 ms".
            key = match["inside"] or match["after"]
            words, seconds = find_unit_after(tail)
            step = number * (_parse_time_unit(key) if key else seconds)
            if pattern == _RATE and re.match(rf"\s*[\[(]?\s*{_PER_SECOND}", key or tail, re.I):
                step = _invert(number)
            # A rate without a unit is in samples per second, if it can be; a number below 1
            # may well be a step.
            elif pattern == _RATE and not key and not words:
                step = _invert(number) if number >= 1 else math.nan
            stated.append(((match[0].removesuffix(tail) + words).strip(), step))
    for match in re.finditer(_SAMPLES, line, re.I):
        stated.append((match[0], _invert(as_number(match["number"]))))
    return stated


def find_unit_after(tail: str) -> Stated:
    """Tell the unit [s] of a number by the text after it: 1 for none, NaN if not clear."""
    if match := re.match(_UNIT_AFTER, tail):
        return match[0], _parse_time_unit(match["unit"])
    return "", 1.0 if re.match(_NO_UNIT_AFTER, tail) else math.nan


def as_number(word: str) -> float:
    """Convert a `NUMBER`, as Fortran may write it: 1.5D-3, or 1.0-100 without any letter."""
    word = word.lower().replace("d", "e")
    return float(word if "e" in word else re.sub(r"(?<=[\d.])(?=[-+])", "e", word))


def _parse_time_unit(word: str) -> float:
    """Convert a unit of time to seconds; NaN if it is not understood."""
    units = (seconds for unit, seconds in _SECONDS.items() if re.fullmatch(unit, word, re.I))
    return next(units, math.nan)


def _invert(number: float) -> float:
    """Convert a rate to a step; NaN of 0."""
    return 1 / number if number else math.nan
