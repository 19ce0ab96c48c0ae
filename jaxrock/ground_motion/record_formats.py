"""The two formats of records: .AT2 files, as the PEER databases have them, and .csv files.

An ``.AT2`` file has a header of about four lines, then the values of one component. A ``.csv``
file may begin with comments; then come one line of names and the columns below it, or one
column.
"""

import csv
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .record_text import RecordText, Statements, collect_statements, quote_names, quote_word
from .record_units import (
    NUMBER,
    UNITS,
    as_number,
    find_steps_in_text,
    find_time_unit,
    find_unit_after,
    find_units_in_name,
    find_units_in_text,
)

# Relative difference of time steps that count as the same: files print them with few digits.
_UNIFORM = 1e-3
# What a statement must be, in words for an error, and the relative difference up to which two
# statements agree.
_UNIT = UNITS, 1e-9
_STEP = "a time step in s, ms or the like, or in samples per second", _UNIFORM
# At most; usually there are four.
_HEADER_LINES = 20
# "NPTS= 400, DT= .01 SEC", "DT= .01 NPTS= 400" and "400 .01 NPTS, DT". The third group is what
# follows the name DT, perhaps a unit; in the first two forms that belongs to the step.
_POINTS_AND_STEP = (
    r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>\S.*)()$",
    r"\bDT\s*=\s*(?P<step>\S.*?)[\s,]+NPTS\s*=\s*(?P<points>[^\s,]+)()",
    r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b(.*)$",
)
# The second group is for "velocity time series", which says what the file holds.
_QUANTITY = r"\b(acceleration|velocity|displacement)(\s+time\b)?"
_NOT_ACCELERATION = r"(?<![a-z])(vel(ocity)?|disp(l(acement)?)?)(?![a-z])"
# Fixed columns run together where a sign fills the field. Each number has its decimal point,
# by which they can be told apart.
_FIELD = rf"(?=[-+]?\d*\.){NUMBER}"
_FIELDS = re.compile(rf"{_FIELD}(?:(?=[-+]){_FIELD})*", re.I)


class Component(NamedTuple):
    """A row of accelerations.

    Attributes
    ----------
    name : str
        Name for errors.
    factor : float
        Unit of the values [m/s2].
    values : ndarray, shape (samples,)
        Accelerations, as they stand in the file.
    step : float
        Time step [s].
    """

    name: str
    factor: float
    values: np.ndarray
    step: float


def read_at2(path: Path, units: Statements, steps: Statements) -> Component:
    """Read the component in an .AT2 file, where the caller states `units` and `steps`."""
    text = RecordText(path)
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
    factor = text.require_agreement(_UNIT, units, no_unit)
    # All have to agree: the caller, the line with DT, and what other lines say of the step.
    steps = [*steps, (top, f"the header states DT= {step:.6g} s", step)]
    step = text.require_agreement(
        _STEP, steps + collect_statements(find_steps_in_text, header, "the header"), ""
    )
    values = text.read_values(
        top,
        lambda lines: np.array([*map(float, " ".join(lines).replace("_", "?").split())]),
        lambda line, n: [
            value for word in line.split() for value in _split_word(text, word, n)
        ],
    )
    text.refuse(
        values.size != points, f"NPTS is {points}, but {values.size} values follow", top
    )
    return Component(repr(str(path)), factor, values, step)


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


def read_csv(
    path: Path, units: Statements, steps: Statements, column: str | None, vertical: str | None
) -> list[Component]:
    """Read one or two columns, where the caller states `units` and `steps`."""
    text = RecordText(path)
    top, names = _read_column_names(text)
    comments = [
        (n, line) for n, line in enumerate(text.lines[:top], 1) if line.lstrip()[:1] == "#"
    ]
    said = collect_statements(find_units_in_text, comments, "a comment")
    no_unit = f"unit must be given for a .csv file: {UNITS}"
    text.refuse(not units and not said and not any(map(find_units_in_name, names)), no_unit)
    times = {name: seconds for name in names if (seconds := find_time_unit(name)) is not None}
    text.refuse(
        len(times) > 1, f"one column of times was expected, got {quote_names(times)}", top
    )
    if column is None:
        others = [name for name in names if name not in (*times, vertical)]
        which = "column must be given, the name of the horizontal acceleration: "
        text.refuse(
            len(others) != 1, which + (quote_names(others) or "no column is left for it"), top
        )
        column = others[0]
    text.refuse(column == vertical, f"column and vertical are the same, {column!r}", top)
    factors = {}
    for argument, name in (("column", column), ("vertical", vertical)):
        if name is None:
            continue
        given = f"{argument} is {name!r}"
        count = names.count(name)
        text.refuse(name in times, f"{given}, which is taken for the times", top)
        among = f"but there are {count} such columns among {quote_names(names)}"
        text.refuse(count != 1, f"{given}, {among}", top)
        wrong = re.search(_NOT_ACCELERATION, name, re.I) is not None
        text.refuse(wrong, f"acceleration was expected, not column {name!r}", top)
        ours = list(units)
        # Without a caller's unit, a_g is no statement: it may mean ground acceleration as
        # well.
        if units or name.lower() != "a_g":
            ours += collect_statements(find_units_in_name, [(top, name)], f"column {name!r}")
        # Comments may speak of several columns: one that agrees is enough.
        agreeing = [each for each in said if ours and math.isclose(each[2], ours[0][2])]
        factors[name] = text.require_agreement(_UNIT, ours + (agreeing or said), no_unit)
    values = _read_columns(text, top, names, [*factors, *times])
    for name, seconds in times.items():
        not_understood = f"the unit of the times is not understood: {quote_word(name)}"
        text.refuse(math.isnan(seconds), not_understood, top)
        step = _check_uniform_step(text, top, name, seconds * values[-1])
        steps = [*steps, (0, f"column {name!r} has a step of {step:.6g} s", step)]
    no_step = (
        f"time_step must be given, since no column of times is among {quote_names(names)}"
    )
    steps = steps + collect_statements(find_steps_in_text, comments, "a comment")
    step = text.require_agreement(_STEP, steps, no_step, top)
    # Not strict: the row of times, if there is one, comes last.
    rows = zip(factors.values(), values, strict=False)
    return [Component(repr(str(path)), factor, row, step) for factor, row in rows]


def list_acceleration_columns(path: Path) -> list[str]:
    """Name the columns of a .csv file, without those of times, velocities, displacements."""
    _, names = _read_column_names(RecordText(path))
    return [
        n
        for n in names
        if find_time_unit(n) is None and not re.search(_NOT_ACCELERATION, n, re.I)
    ]


def _read_column_names(text: RecordText) -> tuple[int, list[str]]:
    """Find the number of the line above the numbers, and the names of the columns."""
    for number, line in enumerate(text.lines, 1):
        if line.strip() and not line.lstrip().startswith("#"):
            wrong = (
                f"columns must be separated by commas, got semicolons in {quote_word(line)}"
            )
            text.refuse(";" in line and "," not in line, wrong, number)
            names = [name.strip() for name in _split_fields(line)]
            # nan and inf are numbers as well: a line of them states no names.
            numbers = [
                re.fullmatch(rf"{NUMBER}|[-+]?(nan|inf(inity)?)", n, re.I) for n in names
            ]
            # One column needs no name.
            if len(names) == 1 and numbers[0]:
                return number - 1, ["column 1"]
            wrong = f"names of the columns were expected, got {quote_word(line)}"
            text.refuse(all(numbers), wrong, number)
            return number, names
    raise text.make_error(
        "a line with the names of the columns was expected, all are comments"
    )


def _read_columns(
    text: RecordText, top: int, names: list[str], wanted: list[str]
) -> np.ndarray:
    """Read the values of some columns, shape (columns, samples)."""
    indices = [names.index(name) for name in wanted]

    def parse_quickly(lines: list[str]) -> np.ndarray:
        # With quotes, or with fields missing in some lines, `loadtxt` would not always raise.
        usual = all(line.count(",") == len(names) - 1 and '"' not in line for line in lines)
        if not usual or not lines:
            raise ValueError
        rows = np.loadtxt(lines, delimiter=",", comments=None, usecols=indices, ndmin=2)
        # It passes over empty lines, which a table must not have.
        if len(rows) < len(lines):
            raise ValueError
        return rows

    def parse_line(line: str, number: int) -> list[float]:
        fields = _split_fields(line)
        counts = f"{len(names)} fields separated by commas were expected, got {len(fields)}"
        text.refuse(len(fields) != len(names), counts, number)
        return [text.parse_number(fields[i], number, f"column {names[i]!r}") for i in indices]

    values = text.read_values(top, parse_quickly, parse_line).reshape(-1, len(indices)).T
    samples = values.shape[1]
    text.refuse(samples < 2, f"at least two samples were expected, got {samples}")
    return values


def _split_fields(line: str) -> list[str]:
    """Split a line into its fields; none if it cannot be, which no caller expects."""
    # For example a field of more than 131,072 characters raises an error.
    try:
        return next(csv.reader([line], skipinitialspace=True)) or [""]
    except csv.Error:
        return []


def _check_uniform_step(text: RecordText, top: int, name: str, times: np.ndarray) -> float:
    """Return the step of a column of times; an error names the first line that differs."""
    steps = np.diff(times)
    # The median, so that the error names the odd step, not all others.
    usual = float(np.median(steps))
    uneven = f"must have a uniform step, mostly {usual:.6g} s"
    differs = abs(steps - usual) > _UNIFORM * usual
    for faulty, reason in ((steps <= 0, "must increase"), (differs, uneven)):
        at = int(np.argmax(faulty))
        got = f"got {times[at]} and then {times[at + 1]}"
        text.refuse(bool(faulty[at]), f"column {name!r} {reason}, {got}", top + at + 2)
    # The mean, whose error by printed digits falls with the number of steps.
    return float(times[-1] - times[0]) / steps.size
