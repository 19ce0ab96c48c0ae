"""Statements about units and time steps in running text: in comments, titles and headers.

These are written for people. Statements in them are found by regular expressions that are built
up from named parts; all of them ignore the case. A statement that is recognized but not
understood is NaN, which readers refuse: no unit is ever guessed. The readers compare what is
found with what the caller states.
"""

import math
import re
from collections.abc import Callable, Iterable

from .text import Statement
from .units import (
    ACCELERATION,
    PER_SQUARED_SECOND,
    SECOND,
    TIME,
    VELOCITY,
    normalize,
    parse_unit,
)

# The words of a statement, and its value in SI: NaN if they are not understood.
WordsAndValue = tuple[str, float]

# Units of acceleration, and others, which are refused where accelerations are expected.
_ANY = rf"(?:{ACCELERATION}|{VELOCITY}|counts?|volts?|mv|[ckn]m)"
# In running text g, gal and cm are units only where one of these patterns matches; the unit of
# an amount, "0.1 cm/s2", is no statement.
_START = r"(?<![a-z0-9])"
_END = r"(?![a-z0-9/^*])"
_IN_TEXT = (
    rf"{_START}(?P<unit>{PER_SQUARED_SECOND}){_END}",
    rf"[(\[{{]\s*(?P<unit>{ACCELERATION})\s*[)\]}}]",
    rf"\bin\s+(?P<unit>{ACCELERATION}){_END}",
    rf"\bacc[a-z]*\.?[\s,:=-]+(?P<unit>{ACCELERATION})\s*\.?(?:$|[,;)])",
    rf"\bacc[^,;()\[\]]*?(?:[(\[{{]\s*|\bin\s+)(?P<unit>{_ANY}){_END}",
    rf"^\W*(?:in\s+)?(?P<unit>{_ANY})\W*$",
)
# What stands before a unit of an amount: a number, "per", or a peak value, as in "PGA (g)".
_AMOUNT = r"(?:\d[\d.]*(?:e[-+]?\d+)?\s*|\bper\s*|\b(?:pga|peak|max(?:imum)?)\b[^,;]*)$"
# "units of g", "UNITS: s, cm/s2", or of something that is not understood, but of no time.
_DECLARED = (
    r"\bunits?(?:\s+(?:of|in|are|is)\b|\s*[:=(\[,;])[\s:=(\[]*"
    rf"(?:{TIME}\s*[,;]\s*)?(?P<unit>{_ANY}{_END}|(?!(?:time|{TIME})(?![a-z0-9]))[^\s,;)\]]+)"
)

# What other values than accelerations are called.
_OTHER_SERIES = (
    r"\b(?:velocity|displacement|rotation|jerk)\s+(?:time\b|histor(?:y|ies)\b|series\b)"
    r"|\b(?:pseudo|spectral|rotational|angular)(?:[\s-]+spectral)?[\s-]+acc[a-z]*"
    r"|\b(?:response|fourier|design|target)\s+(?:spectr(?:um|a)|amplitudes?)"
)
_COMPARED = r"\b(?:match\w*|compatible|fit\w*|scaled)\b"
_OTHERS = r"\b(?:velocit(?:y|ies)|displacements?|rotations?|spectr(?:um|a|al))\b"

# Fortran may write 1.0-100 for 1e-100.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ed][-+]?\d+|[-+]\d{2,3}(?![\d.]))?"
# A factor to be applied, or perhaps applied already.
_FACTOR = (
    r"\b(?:multiply\s+(?:by|with)|(?:scale|scaling|conversion|calibration)\s*factor|factor(?=\s*[=:]))"
    rf"\s*(?:[=:]|is|of)?\s*(?P<number>{NUMBER})"
)
# Letters of any script. Possessive: backtracking into a word would find shorter words in it.
_WORD = r"[^\W\d_]++"
# Fortran's bare exponent only behind a point, since 10-20 may be from 10 to 20.
_DECIMAL = (
    r"[-+]?(?:(?:\d+\.\d*|\.\d+)[-+]\d{2,3}(?![\d.])"
    r"|(?:\d+\.?\d*|\.\d+)(?:[ed][-+]?\d+)?(?![-\d]))"
)
# A unit beside the name, as in "dt [ms]", then the number, then whatever follows it.
_VALUE = (
    rf"(?![a-z0-9])(?:\s*[\[(]\s*(?P<inside>{_WORD})\s*[\])]|_(?P<after>{_WORD}))?"
    rf"\s*(?:[=:]|[,;](?=[\d.])|\bis\b|\bof\b|\bat\b)?\s*(?P<number>{_DECIMAL})(?P<tail>.*)"
)
_SAMPLING = r"(?:sampl(?:e|ing|er)|acquisition|digiti[sz](?:ation|ing))"
_STEP = (
    r"(?:\b(?:dt|delta[\s_-]*t|time[\s_-]*(?:step|interval|increment)|delta(?=\s*[=:]?\s*[\d.])"
    rf"|{_SAMPLING}[\s_-]*(?:interval|period|step|spacing)|sampling\s+at(?=[^a-z]*m?s\b))"
    rf"|^\W*(?:step|interval)s?|[\u0394\u2206]\s?t){_VALUE}"
)
# Full scale is FS as well, but in other units.
_RATE = (
    rf"(?:\b(?:{_SAMPLING}|data)[\s_-]*(?:rate|freq(?:uency|\.)?)|\bsps(?=\W*\d)|^\W*rate"
    r"|\b(?<!scale )f_?s(?=\s*[=:]\s*[\d.e+-]+\s*(?:hz|hertz|sps|[,;)]|$))"
    r"|\b(?:sampled|sampling|digiti[sz]ed|recorded)(?=\s+(?:at|with)\s[\s\d.]*hz)"
    rf"|\bsamples\s+per\s+second){_VALUE}"
)
_PER_SECOND = rf"(?:hz|hertz|sps|(?:samples?|1)\s*(?:/|per)\s*{SECOND})(?![a-z])"
# Of hertz alone a lone statement is clear: otherwise filters are in hertz, too.
_SAMPLES = (
    rf"(?:^\W*(?P<alone>{NUMBER})\s*(?:hz|hertz)\W*$"
    rf"|(?P<number>{NUMBER})\s*(?!hz|hertz|1){_PER_SECOND})"
)
_INTERVALS = (
    rf"(?P<number>{NUMBER})\s*(?P<unit>{TIME})\s+(?:steps?\b|intervals?\b|per\s+sample)"
)
_UNIT_AFTER = rf"\s*[\[(]?\s*(?P<unit>{_WORD})(?!\s*[=:])(?:\s*/\s*{_WORD}(?!\s*[=:]))?"
# In "DT= .01 NPTS= 400" the word belongs to what follows.
_NO_UNIT_AFTER = rf"\s*(?:$|[(;)\]]|[,.](?!\d)|[\[(]?\s*{_WORD}\s*[=:])"


def collect_statements(
    find: Callable[[str], list[WordsAndValue]], lines: Iterable[tuple[int, str]], where: str
) -> list[Statement]:
    """Collect the statements that `find` finds in lines; `where` says in what they stand."""
    return [
        Statement(number, f"{where} states {words}", value)
        for number, line in lines
        for words, value in find(line)
    ]


def find_contents(
    lines: Iterable[tuple[int, str]], known: bool = False
) -> tuple[int, str] | None:
    """Find a line that says that the values are no accelerations, and what they are instead."""
    # Headers of accelerations may mention velocities or displacements, which are computed from
    # them, and a spectrum that they match. But a "velocity time series" is none of them, and
    # neither are values above which only velocities are mentioned, unless these are `known`.
    lines = [*lines]
    for number, line in lines:
        match = re.search(_OTHER_SERIES, line, re.I)
        if match and not re.search(_COMPARED, line, re.I):
            return number, " ".join(match[0].split()).lower()
    if known or any(re.search(r"\bacc", line, re.I) for _, line in lines):
        return None
    mentions = ((n, re.search(_OTHERS, line, re.I)) for n, line in lines)
    return next(((n, match[0].lower()) for n, match in mentions if match), None)


def find_factor(line: str) -> str:
    """Find a factor that a line states for the values, which nobody applies; empty if none."""
    match = re.search(_FACTOR, line, re.I)
    return match[0] if match and read_fortran(match["number"]) != 1 else ""


def find_units(line: str) -> list[WordsAndValue]:
    """Find the units of acceleration that a line of text states, from left to right."""
    line = normalize(line)
    # By where they begin, so that a unit that several patterns find counts once. Patterns run
    # in reverse order, so that an earlier one in the list overrides a later one.
    stated = {
        match.start("unit"): _interpret(match["unit"])
        for pattern in reversed(_IN_TEXT)
        for match in re.finditer(pattern, line, re.I)
        if not re.search(_AMOUNT, line[: match.start("unit")], re.I)
    }
    # A declaration may be of a unit that is not understood: only where nothing else is found.
    if not stated and (match := re.search(_DECLARED, line, re.I)):
        return [_interpret(match["unit"])]
    return [stated[start] for start in sorted(stated)]


def find_steps(line: str) -> list[WordsAndValue]:
    """Find the time steps [s] that a line states, also as a number of samples per second."""
    line = normalize(line)
    stated: list[WordsAndValue] = []
    for pattern in (_STEP, _RATE):
        if match := re.search(pattern, line, re.I):
            number = read_fortran(match["number"])
            tail = match["tail"]
            # The unit stands beside the name, "dt [ms] = 5", or behind: "dt = 5 ms".
            key = match["inside"] or match["after"]
            words, seconds = _find_unit_after(tail)
            step = number * (_parse_time(key) if key else seconds)
            if pattern == _RATE and re.match(rf"\s*[\[(]?\s*{_PER_SECOND}", key or tail, re.I):
                step = _invert(number)
            # A rate without a unit is in samples per second, if it can be; a number below 1
            # may well be a step.
            elif pattern == _RATE and not key and not words:
                step = _invert(number) if number >= 1 else math.nan
            stated.append(((match[0].removesuffix(tail) + words).strip(), step))
    for match in re.finditer(_SAMPLES, line, re.I):
        stated.append((match[0], _invert(read_fortran(match["alone"] or match["number"]))))
    for match in re.finditer(_INTERVALS, line, re.I):
        stated.append((match[0], read_fortran(match["number"]) * _parse_time(match["unit"])))
    return stated


def _find_unit_after(tail: str) -> WordsAndValue:
    """Find the unit [s] of a number in the text after it: 1 for none, NaN if not clear."""
    if match := re.match(_UNIT_AFTER, tail):
        return match[0], _parse_time(match["unit"])
    return "", 1.0 if re.match(_NO_UNIT_AFTER, tail) else math.nan


def read_fortran(word: str) -> float:
    """Convert a `NUMBER`, as Fortran may write it: 1.5D-3, or 1.0-100 without any letter."""
    word = word.lower().replace("d", "e")
    return float(word if "e" in word else re.sub(r"(?<=[\d.])(?=[-+])", "e", word))


def _interpret(words: str) -> WordsAndValue:
    """Return the words of a unit, and its value if it is one of acceleration, else NaN."""
    # A bracket at the end belongs to the text around, unless one was opened inside.
    words = words if "(" in words else words.rstrip(")]}")
    return words, parse_unit(words).as_dimension("acceleration").factor


def _parse_time(word: str) -> float:
    """Convert a unit of time to seconds; NaN if it is not understood."""
    return parse_unit(word).as_dimension("time").factor


def _invert(number: float) -> float:
    """Convert a rate to a step; NaN of 0."""
    return 1 / number if number else math.nan
