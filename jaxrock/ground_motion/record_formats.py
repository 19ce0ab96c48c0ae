"""The two formats of records: .AT2 files, as the PEER databases have them, and .csv files.

An ``.AT2`` file has a header of about four lines, then the values of one component. A ``.csv``
file may begin with comments; then come one line of names and the columns below it, or one
column.
"""

import contextlib
import csv
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..host import read_regular, with_progress
from .record_units import (
    NUMBER,
    UNITS,
    Stated,
    as_number,
    steps_in_text,
    times_in,
    unit_after,
    units_in_name,
    units_in_text,
)

_UNIFORM = 1e-3  # relative difference of time steps that are the same: printed with few digits
# What statements are about, and how much they may differ.
_UNIT = UNITS, 1e-9
_STEP = "a time step in s, ms or the like, or in samples per second", _UNIFORM
_BINARY = bytes({*range(0x20)} - {*b"\t\n\v\f\r"})
_HEADER_LINES = 20  # at most, usually four
_POINTS_AND_STEP = (  # the third group is what follows the name DT
    r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>\S.*)()$",
    r"\bDT\s*=\s*(?P<step>\S.*?)[\s,]+NPTS\s*=\s*(?P<points>[^\s,]+)()",
    r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b(.*)$",
)
_QUANTITY = r"\b(acceleration|velocity|displacement)(\s+time\b)?"
_NOT_ACCELERATION = r"(?<![a-z])(vel(ocity)?|disp(l(acement)?)?)(?![a-z])"
# Fixed columns run together where a sign fills the field; each number has its decimal point.
_FIELD = rf"(?=[-+]?\d*\.){NUMBER}"
_FIELDS = re.compile(rf"{_FIELD}(?:(?=[-+]){_FIELD})*", re.I)

_Lines = list[tuple[int, str]]  # with their numbers, counted from 1 on
Statements = list[tuple[int, str, float]]  # line, 0 for the caller's or none; words; value


class Component(NamedTuple):
    """A row of accelerations: their unit [m/s2] and time step [s]."""

    name: str
    factor: float
    values: np.ndarray
    step: float


class _Text:
    """The lines of a file, and errors that name it."""

    def __init__(self, path: Path):
        self.path = path
        try:
            content = read_regular(path)
        except OSError as error:
            raise self.fault(f"the file cannot be read: {error.strerror or error}") from error
        # Files from DOS end with a Ctrl-Z.
        content = content.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\r\n\t ")
        self.refuse(not content, "the file is empty")
        binary = len(content.translate(None, _BINARY)) < len(content)
        self.refuse(binary, "a text file was expected, this one is binary")
        self.lines = _decoded(content.splitlines())

    def fault(self, reason: str, line: int = 0) -> ValueError:
        """Make the error that says what is wrong with the file, or with one line of it."""
        return ValueError(f"{str(self.path)!r}{f', line {line}' if line else ''}: {reason}")

    def refuse(self, wrong: bool, reason: str, line: int = 0) -> None:
        """Raise a fault if something is wrong."""
        if wrong:
            raise self.fault(reason, line)

    def number(self, word: str, line: int, name: str = "a value") -> float:
        """Convert a word to a finite number; `name` says of what."""
        try:
            value = float(word.replace("_", "?"))  # 1_000 is a number in Python only
        except ValueError:
            got = _short(word) if word.strip() else "an empty field"
            raise self.fault(f"{name} must be a number, got {got}", line) from None
        self.refuse(
            not math.isfinite(value), f"{name} must be finite, got {_short(word)}", line
        )
        return value

    def values(
        self,
        top: int,
        quick: Callable[[list[str]], np.ndarray],
        numbers: Callable[[str, int], Iterable[float]],
    ) -> np.ndarray:
        """Read the numbers after line `top`, by `quick` all at once, else by `numbers`."""
        lines = self.lines[top:]
        with contextlib.suppress(ValueError):
            if np.isfinite(values := quick(lines)).all():
                return values
        numbered = enumerate(with_progress(lines, f"reading {self.path.name}"), top + 1)
        return np.array([value for n, line in numbered for value in numbers(line, n)])

    def agreed(
        self, about: tuple[str, float], statements: Statements, missing: str, at: int = 0
    ) -> float:
        """Return the value that all statements agree on, the first one's."""
        self.refuse(not statements, missing, at)
        line, first, value = statements[0]
        self.refuse(math.isnan(value), f"{first}, which is not {about[0]}", line)
        for number, words, other in statements[1:]:
            where = f" in line {line}" if line else ""
            differs = not math.isclose(value, other, rel_tol=about[1])
            self.refuse(differs, f"{first}{where}, but {words}", number)
        return value


def _decoded(lines: list[bytes]) -> list[str]:
    try:
        return [line.decode() for line in lines]
    except UnicodeDecodeError:  # in names of stations; numbers are the same in both
        if len(lines) == 1:
            return [lines[0].decode("latin-1")]
        return [text for line in lines for text in _decoded([line])]


def _stated(of: Callable[[str], list[Stated]], lines: _Lines, where: str) -> Statements:
    return [
        (n, f"{where} states {words}", value) for n, line in lines for words, value in of(line)
    ]


def read_at2(path: Path, units: Statements, steps: Statements) -> Component:
    """Return the one component of a file, where the caller states `units` and `steps`."""
    text = _Text(path)
    top, points, step = _points_and_step(text)
    header = list(enumerate(text.lines[:top], 1))
    # Headers of accelerations may mention velocities or displacements.
    found = [(n, *each) for n, line in header for each in re.findall(_QUANTITY, line.lower())]
    others = [each for each in found if each[1] != "acceleration"]
    for number, quantity, series in others:
        wrong = bool(series) or others == found
        text.refuse(wrong, f"acceleration was expected, not {quantity}", number)
    no_unit = f"the header states no unit, so that unit must be given: {UNITS}"
    units = units + _stated(units_in_text, header, "the header")
    factor = text.agreed(_UNIT, units, no_unit)
    steps = [*steps, (top, f"the header states DT= {step:.6g} s", step)]
    step = text.agreed(_STEP, steps + _stated(steps_in_text, header, "the header"), "")
    values = text.values(
        top,
        lambda lines: np.array([*map(float, " ".join(lines).replace("_", "?").split())]),
        lambda line, n: [value for word in line.split() for value in _split(text, word, n)],
    )
    text.refuse(
        values.size != points, f"NPTS is {points}, but {values.size} values follow", top
    )
    return Component(repr(str(path)), factor, values, step)


def _points_and_step(text: _Text) -> tuple[int, int, float]:
    """Find the last line of the header, and its number of values and time step [s]."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        matches = (re.search(pattern, line.upper()) for pattern in _POINTS_AND_STEP)
        if not (match := next(filter(None, matches), None)):
            continue
        points = text.number(match["points"], number, "NPTS")
        wrong = f"NPTS must be a whole number from 2 on, got {match['points']}"
        text.refuse(points < 2 or points % 1 > 0, wrong, number)
        words = f"{match['step']} {match[3]}".strip()  # such as "10 MSEC"
        value = re.match(NUMBER, words, re.I)
        word = value[0] if value else re.split(r"[\s,]", words)[0]
        step = as_number(word) if value else text.number(word, number, "DT")
        step *= unit_after(words[len(word) :].lstrip())[1]
        wrong = f"DT must be a number, if need be with a unit of time, got {_short(words)}"
        text.refuse(math.isnan(step), wrong, number)
        text.refuse(not 0 < step < math.inf, f"DT must be greater than 0, got {word}", number)
        return number, int(points), step
    raise text.fault(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )


def _split(text: _Text, word: str, line: int) -> list[float]:
    """Split the numbers in a word: one, or several of fixed columns without a space."""
    if not _FIELDS.fullmatch(word):
        return [text.number(word, line)]
    # .1-02.3-02 may be .1e-02 and .3e-02 or .1 and -02.3e-02, unless a number begins with 0.
    perhaps = re.findall(r"(?<=[\d.])[-+]\d{2,3}\.", word)
    bare_exponent = re.search(r"[\d.][-+]\d{2,3}(?![\d.])", word)
    unclear = any(each[1] == "0" for each in perhaps) or bool(perhaps and bare_exponent)
    text.refuse(unclear, f"numbers that run together are not clear, got {_short(word)}", line)
    values = [as_number(match[0]) for match in re.finditer(NUMBER, word, re.I)]
    finite = all(map(math.isfinite, values))
    text.refuse(not finite, f"a value must be finite, got {_short(word)}", line)
    return values


def read_csv(
    path: Path, units: Statements, steps: Statements, column: str | None, vertical: str | None
) -> list[Component]:
    """One or two columns, where the caller states `units` and `steps`."""
    text = _Text(path)
    top, names = _column_names(text)
    comments = [
        (n, line) for n, line in enumerate(text.lines[:top], 1) if line.lstrip()[:1] == "#"
    ]
    said = _stated(units_in_text, comments, "a comment")
    no_unit = f"unit must be given for a .csv file: {UNITS}"
    text.refuse(not units and not said and not any(map(units_in_name, names)), no_unit)
    times = {name: seconds for name in names if (seconds := times_in(name)) is not None}
    text.refuse(len(times) > 1, f"one column of times was expected, got {_quoted(times)}", top)
    if column is None:
        others = [name for name in names if name not in (*times, vertical)]
        which = "column must be given, the name of the horizontal acceleration: "
        text.refuse(
            len(others) != 1, which + (_quoted(others) or "no column is left for it"), top
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
        among = f"but there are {count} such columns among {_quoted(names)}"
        text.refuse(count != 1, f"{given}, {among}", top)
        wrong = re.search(_NOT_ACCELERATION, name, re.I) is not None
        text.refuse(wrong, f"acceleration was expected, not column {name!r}", top)
        ours = list(units)
        if units or name.lower() != "a_g":  # which may mean ground acceleration as well
            ours += _stated(units_in_name, [(top, name)], f"column {name!r}")
        # Comments may speak of several columns: one that agrees is enough.
        agreeing = [each for each in said if ours and math.isclose(each[2], ours[0][2])]
        factors[name] = text.agreed(_UNIT, ours + (agreeing or said), no_unit)
    values = _columns(text, top, names, [*factors, *times])
    for name, seconds in times.items():
        not_understood = f"the unit of the times is not understood: {_short(name)}"
        text.refuse(math.isnan(seconds), not_understood, top)
        step = _uniform_step(text, top, name, seconds * values[-1])
        steps = [*steps, (0, f"column {name!r} has a step of {step:.6g} s", step)]
    no_step = f"time_step must be given, since no column of times is among {_quoted(names)}"
    steps = steps + _stated(steps_in_text, comments, "a comment")
    step = text.agreed(_STEP, steps, no_step, top)
    rows = zip(factors.values(), values, strict=False)
    return [Component(repr(str(path)), factor, row, step) for factor, row in rows]


def columns_of(path: Path) -> list[str]:
    """Name the columns of a .csv file but those of times, velocities, displacements."""
    _, names = _column_names(_Text(path))
    return [
        n for n in names if times_in(n) is None and not re.search(_NOT_ACCELERATION, n, re.I)
    ]


def _column_names(text: _Text) -> tuple[int, list[str]]:
    """Return the number of the line above the numbers, and the names of the columns."""
    for number, line in enumerate(text.lines, 1):
        if line.strip() and not line.lstrip().startswith("#"):
            wrong = f"columns must be separated by commas, got semicolons in {_short(line)}"
            text.refuse(";" in line and "," not in line, wrong, number)
            names = [name.strip() for name in _fields(line)]
            numbers = [
                re.fullmatch(rf"{NUMBER}|[-+]?(nan|inf(inity)?)", n, re.I) for n in names
            ]
            if len(names) == 1 and numbers[0]:  # one column needs no name
                return number - 1, ["column 1"]
            wrong = f"names of the columns were expected, got {_short(line)}"
            text.refuse(all(numbers), wrong, number)
            return number, names
    raise text.fault("a line with the names of the columns was expected, all are comments")


def _columns(text: _Text, top: int, names: list[str], wanted: list[str]) -> np.ndarray:
    """Read the values of some columns, shape (columns, samples)."""
    indices = [names.index(name) for name in wanted]

    def quick(lines: list[str]) -> np.ndarray:
        usual = all(line.count(",") == len(names) - 1 and '"' not in line for line in lines)
        if not usual or not lines:
            raise ValueError
        rows = np.loadtxt(lines, delimiter=",", comments=None, usecols=indices, ndmin=2)
        if len(rows) < len(lines):
            raise ValueError
        return rows

    def numbers(line: str, number: int) -> list[float]:
        fields = _fields(line)
        counts = f"{len(names)} fields separated by commas were expected, got {len(fields)}"
        text.refuse(len(fields) != len(names), counts, number)
        return [text.number(fields[i], number, f"column {names[i]!r}") for i in indices]

    values = text.values(top, quick, numbers).reshape(-1, len(indices)).T
    samples = values.shape[1]
    text.refuse(samples < 2, f"at least two samples were expected, got {samples}")
    return values


def _fields(line: str) -> list[str]:
    try:
        return next(csv.reader([line], skipinitialspace=True)) or [""]
    except csv.Error:  # for example a field of more than 131,072 characters
        return []


def _uniform_step(text: _Text, top: int, name: str, times: np.ndarray) -> float:
    steps = np.diff(times)
    usual = float(np.median(steps))
    uneven = f"must have a uniform step, mostly {usual:.6g} s"
    differs = abs(steps - usual) > _UNIFORM * usual
    for faulty, reason in ((steps <= 0, "must increase"), (differs, uneven)):
        at = int(np.argmax(faulty))
        got = f"got {times[at]} and then {times[at + 1]}"
        text.refuse(bool(faulty[at]), f"column {name!r} {reason}, {got}", top + at + 2)
    return float(times[-1] - times[0]) / steps.size


def _quoted(names: Iterable[str]) -> str:
    """Return the first of several names, for a message."""
    names = [*names]
    return ", ".join([_short(name) for name in names[:12]]) + (", ..." if names[12:] else "")


def _short(word: str) -> str:
    """Quote a word, cut if it is long."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")
