"""What is written around records about units and time steps, in m/s2 and s.

Headers, comments and names of columns are written for people. What they state is found here;
the readers compare it with what the caller states.
"""

import math
import re
import unicodedata

Stated = tuple[str, float]  # words and what they mean, NaN if they are not understood

_G = 9.80665  # standard gravity, the unit g of records: not the gravity that acts on the block
_FACTORS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "gal": 0.01}  # of the groups in `_KNOWN`
_FACTORS |= {"g": _G, "percent": 0.01 * _G, "milli": 0.001 * _G}
UNITS = "one of 'm/s2', 'cm/s2', 'mm/s2', 'gal', 'g', '%g', 'mg'"

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
_ANY = rf"(?:{_KNOWN}|counts?|volts?|mv|[ck]m|[mck]?m{_GAP}(?:/|per|p|_){_GAP}{_S})"
_START = r"(?<![a-z0-9])"
_END = r"(?![a-z0-9/^*])"
_SPEED = (
    rf"{_START}{_LENGTH}(?:{_GAP}{_PER}{_GAP}{_S}|_{_S}"
    rf"|[\s_.*]+{_S}{_GAP}\^?{_GAP}[({{]?-1[)}}]?){_END}"
)

# In running text g, gal and cm are units only in such places; an amount, "0.1 cm/s2", is none.
_IN_TEXT = (
    rf"{_START}(?P<unit>{_LENGTH}{_GAP}(?:/|per){_GAP}{_SQUARED}){_END}",
    rf"[(\[{{]\s*(?P<unit>{_KNOWN})\s*[)\]}}]",
    rf"\bin\s+(?P<unit>{_KNOWN}){_END}",
    rf"\bacc[a-z]*\.?[\s,:=-]+(?P<unit>{_KNOWN})\s*\.?(?:$|[,;)])",
    rf"\bacc[^,;()\[\]]*?(?:[(\[{{]\s*|\bin\s+)(?P<unit>{_ANY}){_END}",
)
_AMOUNT = r"(?:\d[\d.]*(?:e[-+]?\d+)?\s*|\bper\s*|\b(?:pga|peak|max(?:imum)?)\b[^,;]*)$"
_SECONDS = {
    _S: 1.0,
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
_WORD = r"[^\W\d_]++"
_TIMES = (
    r"(?:(?:elapsed|relative|record)[\s_]*)?(?:t|times?)(?:[\s_]*[\[(](?P<inside>[^\])]*)[\])]"
    rf"|(?:[\s_]+in)?[\s_]+(?P<after>{_WORD})|\s*/\s*(?P<over>{_WORD}))?"
)

# Fortran may write 1.0-100 for 1e-100.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ed][-+]?\d+|[-+]\d{2,3}(?![\d.]))?"
_VALUE = (
    rf"(?![a-z0-9])(?:\s*[\[(]\s*(?P<inside>{_WORD})\s*[\])]|_(?P<after>{_WORD}))?"
    rf"\s*(?:[=:]|\bis\b|\bof\b)?\s*(?P<number>{NUMBER})(?P<tail>.*)"
)
_STEP = (
    r"\b(?:dt|delta[\s_-]*t|time[\s_-]*(?:step|interval|increment)|delta(?=\s*[=:])"
    rf"|sampl(?:e|ing)[\s_-]*(?:interval|period|step|spacing)){_VALUE}"
)
_RATE = rf"\bsampl(?:e|ing)[\s_-]*(?:rate|frequency){_VALUE}"
_PER_SECOND = rf"(?:hz|hertz|sps|(?:samples?|1)\s*(?:/|per)\s*{_S})(?![a-z])"
_SAMPLES = rf"(?P<number>{NUMBER})\s*(?!hz|hertz|1){_PER_SECOND}"
_UNIT_AFTER = rf"\s*[\[(]?\s*(?P<unit>{_WORD})(?!\s*[=:])(?:\s*/\s*{_WORD}(?!\s*[=:]))?"
# In "DT= .01 NPTS= 400" the word belongs to what follows.
_NO_UNIT_AFTER = rf"\s*(?:$|[(;)\]]|[,.](?!\d)|[\[(]?\s*{_WORD}\s*[=:])"


def factor_of(unit: str) -> float:
    """Return a unit in m/s2; NaN if it is not understood."""
    match = re.fullmatch(_KNOWN, _plain(str(unit)).strip(), re.I)
    return _stated(match)[1] if match else math.nan


def units_in_name(name: str) -> list[Stated]:
    """Find the units that the name of a column states, for example acc_cm_s2 or acc [g]."""
    return [_stated(match) for match in re.finditer(_START + _ANY + _END, _plain(name), re.I)]


def speeds_in_name(name: str) -> list[Stated]:
    """Find the units of velocity that a column's name states, such as pgv [cm/s], in m/s."""
    return [_stated(match) for match in re.finditer(_SPEED, _plain(name), re.I)]


def units_in_text(line: str) -> list[Stated]:
    """Return the units of acceleration that a line of text states, from left to right."""
    line = _plain(line)
    stated = {
        match.start("unit"): _stated(match, "unit")
        for pattern in reversed(_IN_TEXT)
        for match in re.finditer(pattern, line, re.I)
        if not re.search(_AMOUNT, line[: match.start("unit")], re.I)
    }
    if not stated and (match := re.search(_DECLARED, line, re.I)):
        return [_stated(match, "unit")]
    return [stated[start] for start in sorted(stated)]


def times_in(name: str) -> float | None:
    """Tell the unit [s] of a column of times, NaN if not understood; None if it has none."""
    match = re.fullmatch(_TIMES, _plain(name), re.I)
    if match is None:
        return None
    if match["inside"] is not None:
        return _seconds(match["inside"].strip())
    seconds = _seconds(match["after"] or match["over"] or "s")
    return None if math.isnan(seconds) else seconds


def steps_in_text(line: str) -> list[Stated]:
    """Find the time steps [s] that a line states, also as a number of samples per second."""
    line = _plain(line)
    stated = []
    for pattern in (_STEP, _RATE):
        if match := re.search(pattern, line, re.I):
            number = as_number(match["number"])
            tail = match["tail"]
            key = match["inside"] or match["after"]
            words, seconds = unit_after(tail)
            step = number * (_seconds(key) if key else seconds)
            if pattern == _RATE and re.match(rf"\s*[\[(]?\s*{_PER_SECOND}", key or tail, re.I):
                step = _inverse(number)
            elif (
                pattern == _RATE and not key and not words
            ):  # samples per second, if it can be
                step = _inverse(number) if number >= 1 else math.nan
            stated.append(((match[0].removesuffix(tail) + words).strip(), step))
    for match in re.finditer(_SAMPLES, line, re.I):
        stated.append((match[0], _inverse(as_number(match["number"]))))
    return stated


def unit_after(tail: str) -> Stated:
    """Tell the unit [s] of a number by the text after it: 1 for none, NaN if not clear."""
    if match := re.match(_UNIT_AFTER, tail):
        return match[0], _seconds(match["unit"])
    return "", 1.0 if re.match(_NO_UNIT_AFTER, tail) else math.nan


def as_number(word: str) -> float:
    """Return the value of a `NUMBER`, as Fortran may write it."""
    word = word.lower().replace("d", "e")
    return float(word if "e" in word else re.sub(r"(?<=[\d.])(?=[-+])", "e", word))


def _plain(text: str) -> str:
    """Text with one form of what looks alike: powers, minus signs, dots of products, micro."""
    return unicodedata.normalize("NFKC", text).translate({0x2212: "-", 0xB7: ".", 0x22C5: "."})


def _stated(match: re.Match[str], group: str | int = 0) -> Stated:
    words = match[group] if "(" in match[group] else match[group].rstrip(")]}")
    named = (factor for name, factor in _FACTORS.items() if match.groupdict().get(name))
    return words, next(named, math.nan)


def _seconds(word: str) -> float:
    units = (seconds for unit, seconds in _SECONDS.items() if re.fullmatch(unit, word, re.I))
    return next(units, math.nan)


def _inverse(number: float) -> float:
    return 1 / number if number else math.nan
