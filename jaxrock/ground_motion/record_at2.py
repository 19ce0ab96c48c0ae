"""Reading .AT2 files, as the PEER databases give them: a header and numbers in columns."""

import math
import re

import numpy as np

from .record_header import NUMBER, as_number, step_unit
from .record_text import (
    ALLOWED,
    Lines,
    Text,
    agreed_step,
    agreed_unit,
    given_unit,
    in_si,
    short,
    stated_units,
)

_HEADER_LINES = 20  # at most, four as a rule
_POINTS_AND_STEP = (
    re.compile(r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>\S.*)()$"),
    re.compile(r"\bDT\s*=\s*(?P<step>\S.*?)[\s,]+NPTS\s*=\s*(?P<points>[^\s,]+)()"),
    re.compile(r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b(.*)$"),
)
_QUANTITY = re.compile(r"\b(ACCELERATION|VELOCITY|DISPLACEMENT)(\s+TIME\b)?", re.IGNORECASE)
# Numbers that leave no space before a sign that fills their field, each with its point.
_FIELD = rf"(?=[-+]?\d*\.){NUMBER}"
_FIELDS = re.compile(rf"{_FIELD}(?:(?=[-+]){_FIELD})*", re.IGNORECASE)
_BARE_EXPONENT = re.compile(r"[\d.][-+]\d{2,3}(?![\d.])")
_PERHAPS_EXPONENT = re.compile(r"(?<=[\d.])[-+]\d{2,3}\.")


def read_at2(
    text: Text, unit: str | None, time_step: float | None = None
) -> tuple[np.ndarray, float]:
    """Read one component: its accelerations [m/s2] and the time step [s]."""
    header, data, points, step = _header(text)
    factor = _factor(text, header, unit)
    step = agreed_step(text, header, step, time_step)
    last = len(header)
    blocks = [_values(text, *block) for block in text.blocks(data, last + 1)]
    values = np.concatenate([np.empty(0), *blocks])
    if values.size != points:
        raise text.fault(f"NPTS is {points}, but {values.size} values follow", last)
    return in_si(factor, values), step


def _header(text: Text) -> tuple[Lines, int, int, float]:
    """Its lines, the byte at which the values begin, their number and time step [s]."""
    header = []
    for number, line, data in text.lines():
        header.append((number, line))
        if found := _points_and_step(text, number, line):
            return header, data, *found
        if number == _HEADER_LINES:
            break
    raise text.fault(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )


def _points_and_step(text: Text, number: int, line: str) -> tuple[int, float] | None:
    """What the last line of a header says; None for the lines before."""
    for pattern in _POINTS_AND_STEP:
        if match := pattern.search(line.upper()):
            points = text.number(match["points"], number, "NPTS")
            if points < 2 or points % 1:
                got = match["points"]
                raise text.fault(f"NPTS must be a whole number from 2 on, got {got}", number)
            return int(points), _step(text, number, match["step"], match[3])
    return None


def _step(text: Text, line: int, words: str, after: str) -> float:
    """The time step in s, of `words` such as "10 MSEC" and what follows the name DT."""
    match = re.match(NUMBER, words, re.IGNORECASE)
    if match is None:
        word = re.split(r"[\s,]", words)[0]
        text.number(word, line, "DT")
        raise text.fault(f"DT must be a number, got {short(word)}", line)
    seconds = step_unit(words[match.end() :].strip() or after)
    if math.isnan(seconds):
        raise text.fault(
            "DT must be a number, if need be with a unit of time, got"
            f" {short((words + ' ' + after).strip())}",
            line,
        )
    step = as_number(match[0]) * seconds
    if not 0 < step < math.inf:
        raise text.fault(f"DT must be greater than 0, got {match[0]}", line)
    return step


def _factor(text: Text, header: Lines, unit: str | None) -> float:
    """What the unit is in m/s2, if the header is about acceleration."""
    mentioned = {}
    for number, line in header:
        for quantity, time_series in _QUANTITY.findall(line):
            mentioned.setdefault(quantity.lower(), number)
            if time_series and quantity.lower() != "acceleration":
                raise text.fault(f"acceleration was expected, not {quantity.lower()}", number)
    if mentioned and "acceleration" not in mentioned:
        quantity, number = mentioned.popitem()
        raise text.fault(f"acceleration was expected, not {quantity}", number)
    found = agreed_unit(text, given_unit(unit), "the header", stated_units(header))
    if found is None:
        raise text.fault(f"the header states no unit, so that unit must be given: {ALLOWED}")
    return found.value


def _values(text: Text, line: int, lines: list[str]) -> np.ndarray:
    words = " ".join(lines).split()
    try:
        values = np.fromiter(map(float, words), float, len(words))
    except ValueError:
        values = None
    if values is not None and np.isfinite(values).all() and not any("_" in each for each in lines):
        return values
    return np.array(
        [
            value
            for number, each in enumerate(lines, line)
            for word in each.split()
            for value in _run_together(text, word, number)
        ]
    )


def _run_together(text: Text, word: str, line: int) -> list[float]:
    """The numbers in a word: one, or several in fixed columns without space between them."""
    if _FIELDS.fullmatch(word) is None:
        return [text.number(word, line)]
    # Whether .1-02.3-02 is .1e-02 and .3e-02 cannot be known; a number has no zero in front.
    perhaps = _PERHAPS_EXPONENT.findall(word)
    if any(each[1] == "0" for each in perhaps) or (perhaps and _BARE_EXPONENT.search(word)):
        raise text.fault(f"numbers that run together are not clear, got {short(word)}", line)
    values = [as_number(match[0]) for match in re.finditer(NUMBER, word, re.IGNORECASE)]
    if not np.isfinite(values).all():
        raise text.fault(f"a value must be finite, got {short(word)}", line)
    return values
