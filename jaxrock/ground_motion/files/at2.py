"""Files .AT2 of the PEER databases: a header of about four lines, then one component."""

import math
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from .components import Component, Direction
from .cut import refuse_cut
from .directions import Stated, find_name_direction, find_word_direction, settle_direction
from .text import STEP, UNIT, RecordText, Statements, collect_statements, quote_word
from .units import (
    NUMBER,
    UNITS,
    as_number,
    find_steps_in_text,
    find_unit_after,
    find_units_in_text,
)

# At most; usually there are four.
_HEADER_LINES = 20
# As many are enough to see how numbers are printed.
_LAST_LINES = 200
# "NPTS= 400, DT= .01 SEC", "DT= .01 NPTS= 400" and "400 .01 NPTS, DT". The third group is what
# follows the name DT, perhaps a unit; in the first two forms that belongs to the step.
_POINTS_AND_STEP = (
    r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>\S.*)()$",
    r"\bDT\s*=\s*(?P<step>\S.*?)[\s,]+NPTS\s*=\s*(?P<points>[^\s,]+)()",
    r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b(.*)$",
)
# The second group is for "velocity time series", which says what the file holds.
_QUANTITY = r"\b(acceleration|velocity|displacement)(\s+time\b)?"
# Fixed columns run together where a sign fills the field. Each number has its decimal point,
# by which they can be told apart.
_FIELD = rf"(?=[-+]?\d*\.){NUMBER}"
_FIELDS = re.compile(rf"{_FIELD}(?:(?=[-+]){_FIELD})*", re.I)
# A line after the values, as OpenSees' elCentro.at2 has it.
_END_OF_DATA = r"\W*end\s+(?:of\s+)?data\W*"


def read_at2(
    text: RecordText, units: Statements, steps: Statements, paths: Iterable[Path] = ()
) -> list[Component]:
    """Read the component in an .AT2 file, which may lie beside other files, the `paths`.

    The caller states `units` and `steps`.
    """
    direction = find_at2_direction(text, paths)
    top, points, step = _read_points_and_step(text)
    header = list(enumerate(text.lines[:top], 1))
    # Headers of accelerations may mention velocities or displacements, which are computed from
    # them. But a "velocity time series" is refused, and a header that mentions velocity or
    # displacement and no acceleration.
    found = [(n, *each) for n, line in header for each in re.findall(_QUANTITY, line.lower())]
    others = [each for each in found if each[1] != "acceleration"]
    for number, quantity, series in others:
        wrong = bool(series) or others == found
        text.refuse(wrong, f"acceleration was expected, not {quantity}", number)
    no_unit = f"the header states no unit, so that unit must be given: {UNITS}"
    units = units + collect_statements(find_units_in_text, header, "the header")
    factor = text.require_agreement(UNIT, units, no_unit)
    # All have to agree: the caller, the line with DT, and what other lines say of the step.
    steps = [*steps, (top, f"the header states DT= {step:.6g} s", step)]
    step = text.require_agreement(
        STEP, steps + collect_statements(find_steps_in_text, header, "the header"), ""
    )
    # Exactly one such line, at the end: anywhere else it is no number.
    is_ended = re.fullmatch(_END_OF_DATA, text.lines[-1], re.I) is not None
    if is_ended:
        del text.lines[-1]
    values = text.read_values(
        top,
        lambda lines: np.array([*map(float, " ".join(lines).replace("_", "?").split())]),
        lambda line, n: [
            value for word in line.split() for value in _split_word(text, word, n)
        ],
    )
    if not is_ended:
        refuse_cut(text, " ".join(text.lines[top:][-_LAST_LINES:]).split())
    text.refuse(
        values.size != points, f"NPTS is {points}, but {values.size} values follow", top
    )
    return [Component(repr(str(text.path)), factor, values, step, direction)]


def find_at2_direction(text: RecordText, paths: Iterable[Path]) -> Direction:
    """Find the direction by the name of the file among others, and by the title.

    Raises a `ValueError` if they disagree.
    """
    name = find_name_direction(text.path, paths)
    title = _find_title_direction(text.lines)
    direction = settle_direction(name, title)
    if direction is None:
        raise text.make_error(
            f"the component is {name} by its name, but {title} by its header"
        )
    return direction


def _find_title_direction(lines: list[str]) -> Stated:
    """Find the direction of the component in the second line, the title: UP, DWN, 140, ..."""
    filled = [line for line in lines[:_HEADER_LINES] if line.strip()]
    if len(filled) < 2:
        return ""
    # After the component the station's number may stand in brackets.
    title = re.sub(r"\s*\([^()]*\)\s*$", "", filled[1])
    return find_word_direction(title.rpartition(",")[2].strip()) if "," in title else ""


def _read_points_and_step(text: RecordText) -> tuple[int, int, float]:
    """Find the last line of the header, and its number of values and time step [s]."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        matches = (re.search(pattern, line.upper()) for pattern in _POINTS_AND_STEP)
        if not (match := next(filter(None, matches), None)):
            continue
        points = text.parse_number(match["points"], number, "NPTS")
        wrong = f"NPTS must be a whole number from 2 on, got {match['points']}"
        text.refuse(points < 2 or points % 1 > 0, wrong, number)
        words = f"{match['step']} {match[3]}".strip()  # such as "10 MSEC"
        # A unit may follow the number; whatever begins with no number is refused as it stands.
        value = re.match(NUMBER, words, re.I)
        word = value[0] if value else re.split(r"[\s,]", words)[0]
        step = as_number(word) if value else text.parse_number(word, number, "DT")
        step *= find_unit_after(words[len(word) :].lstrip())[1]
        wrong = f"DT must be a number, if need be with a unit of time, got {quote_word(words)}"
        text.refuse(math.isnan(step), wrong, number)
        text.refuse(not 0 < step < math.inf, f"DT must be greater than 0, got {word}", number)
        return number, int(points), step
    raise text.make_error(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )


def _split_word(text: RecordText, word: str, line: int) -> list[float]:
    """Read the numbers in a word: one, or several of fixed columns without a space."""
    if not _FIELDS.fullmatch(word):
        return [text.parse_number(word, line)]
    # .1-02.3-02 may be .1e-02 and .3e-02, or .1 and -02.3e-02. A word is refused if a number
    # in it would begin with 0, or if it also has an exponent without a letter.
    perhaps = re.findall(r"(?<=[\d.])[-+]\d{2,3}\.", word)
    bare_exponent = re.search(r"[\d.][-+]\d{2,3}(?![\d.])", word)
    unclear = any(each[1] == "0" for each in perhaps) or bool(perhaps and bare_exponent)
    text.refuse(
        unclear, f"numbers that run together are not clear, got {quote_word(word)}", line
    )
    values = [as_number(match[0]) for match in re.finditer(NUMBER, word, re.I)]
    finite = all(map(math.isfinite, values))
    text.refuse(not finite, f"a value must be finite, got {quote_word(word)}", line)
    return values
