"""The two formats of records: .AT2 files, as the PEER databases have them, and .csv files.

An ``.AT2`` file has a header of about four lines, then the values of one component. A ``.csv``
file may begin with comments; then come one line of names and the columns below it.
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

_STEPS = "a time step in s, ms or the like, or in samples per second"
_UNIFORM = 1e-3  # relative difference of time steps that are the same: printed with few digits
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
Statements = list[tuple[int | None, str, float]]  # line, unless the caller's; words; value


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
        if not content:
            raise self.fault("the file is empty")
        if len(content.translate(None, _BINARY)) < len(content):
            raise self.fault("a text file was expected, this one is binary")
        self.lines = [_decoded(line) for line in content.splitlines()]

    def fault(self, reason: str, line: int | None = None) -> ValueError:
        """What is wrong with the file, or with one line of it."""
        where = repr(str(self.path)) + ("" if line is None else f", line {line}")
        return ValueError(f"{where}: {reason}")

    def number(self, word: str, line: int, name: str = "a value") -> float:
        """A word as a finite number; `name` says of what."""
        try:
            value = float(word.replace("_", "?"))  # 1_000 is a number in Python only
        except ValueError:
            got = _short(word) if word.strip() else "an empty field"
            raise self.fault(f"{name} must be a number, got {got}", line) from None
        if not math.isfinite(value):
            raise self.fault(f"{name} must be finite, got {_short(word)}", line)
        return value

    def values(
        self,
        top: int,
        quick: Callable[[list[str]], np.ndarray],
        numbers: Callable[[str, int], Iterable[float]],
    ) -> np.ndarray:
        """The numbers after line `top`, by `quick` from all lines, else by `numbers` from each."""
        lines = self.lines[top:]
        with contextlib.suppress(ValueError):
            if np.isfinite(values := quick(lines)).all():
                return values
        numbered = enumerate(with_progress(lines, f"reading {self.path.name}"), top + 1)
        return np.array([value for n, line in numbered for value in numbers(line, n)])

    def agreed(self, statements: Statements, kind: str, tolerance: float) -> float | None:
        """The value that all statements agree on, the first one's; None if there is none."""
        if not statements:
            return None
        line, first, value = statements[0]
        if math.isnan(value):
            raise self.fault(f"{first}, which is not {kind}", line)
        for number, words, other in statements[1:]:
            if not math.isclose(value, other, rel_tol=tolerance):
                where = "" if line is None else f" in line {line}"
                raise self.fault(f"{first}{where}, but {words}", number)
        return value


def _decoded(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")  # names of stations; numbers are the same in both


def _stated(of: Callable[[str], list[Stated]], lines: _Lines, where: str) -> Statements:
    return [(n, f"{where} states {words}", value) for n, line in lines for words, value in of(line)]


def read_at2(path: Path, units: Statements, steps: Statements) -> Component:
    """The one component of a file, where the caller states `units` and `steps`."""
    text = _Text(path)
    top, points, step = _points_and_step(text)
    header = list(enumerate(text.lines[:top], 1))
    # Headers of accelerations may mention velocities or displacements.
    found = [(n, *each) for n, line in header for each in re.findall(_QUANTITY, line.lower())]
    others = [each for each in found if each[1] != "acceleration"]
    for number, quantity, series in others:
        if series or others == found:
            raise text.fault(f"acceleration was expected, not {quantity}", number)
    factor = text.agreed(units + _stated(units_in_text, header, "the header"), UNITS, 1e-9)
    if factor is None:
        raise text.fault(f"the header states no unit, so that unit must be given: {UNITS}")
    steps = [*steps, (top, f"the header states DT= {step:.6g} s", step)]
    steps += _stated(steps_in_text, header, "the header")
    step = text.agreed(steps, _STEPS, _UNIFORM) or step
    values = text.values(
        top,
        lambda lines: np.array([*map(float, " ".join(lines).replace("_", "?").split())]),
        lambda line, n: [value for word in line.split() for value in _split(text, word, n)],
    )
    if values.size != points:
        raise text.fault(f"NPTS is {points}, but {values.size} values follow", top)
    return Component(repr(str(path)), factor, values, step)


def _points_and_step(text: _Text) -> tuple[int, int, float]:
    """The last line of the header, and the number of values and the time step [s] in it."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        matches = (re.search(pattern, line.upper()) for pattern in _POINTS_AND_STEP)
        if not (match := next(filter(None, matches), None)):
            continue
        points = text.number(match["points"], number, "NPTS")
        if points < 2 or points % 1:
            got = match["points"]
            raise text.fault(f"NPTS must be a whole number from 2 on, got {got}", number)
        words = f"{match['step']} {match[3]}".strip()  # such as "10 MSEC"
        value = re.match(NUMBER, words, re.I)
        word = value[0] if value else re.split(r"[\s,]", words)[0]
        step = as_number(word) if value else text.number(word, number, "DT")
        step *= unit_after(words[len(word) :].lstrip())[1]
        if math.isnan(step):
            must = "DT must be a number, if need be with a unit of time"
            raise text.fault(f"{must}, got {_short(words)}", number)
        if not 0 < step < math.inf:
            raise text.fault(f"DT must be greater than 0, got {word}", number)
        return number, int(points), step
    raise text.fault(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )


def _split(text: _Text, word: str, line: int) -> list[float]:
    """The numbers in a word: one, or several of fixed columns without space between them."""
    if not _FIELDS.fullmatch(word):
        return [text.number(word, line)]
    # .1-02.3-02 may be .1e-02 and .3e-02 or .1 and -02.3e-02, unless a number begins with 0.
    perhaps = re.findall(r"(?<=[\d.])[-+]\d{2,3}\.", word)
    bare_exponent = re.search(r"[\d.][-+]\d{2,3}(?![\d.])", word)
    if any(each[1] == "0" for each in perhaps) or (perhaps and bare_exponent):
        raise text.fault(f"numbers that run together are not clear, got {_short(word)}", line)
    values = [as_number(match[0]) for match in re.finditer(NUMBER, word, re.I)]
    if not np.isfinite(values).all():
        raise text.fault(f"a value must be finite, got {_short(word)}", line)
    return values


def read_csv(
    path: Path, units: Statements, steps: Statements, column: str | None, vertical: str | None
) -> list[Component]:
    """One or two columns, where the caller states `units` and `steps`."""
    text = _Text(path)
    top, names = _column_names(text)
    comments = list(enumerate(text.lines[: top - 1], 1))
    said = _stated(units_in_text, comments, "a comment")
    no_unit = text.fault(f"unit must be given for a .csv file: {UNITS}")
    if not units and not said and not any(map(units_in_name, names)):
        raise no_unit
    times = {name: seconds for name in names if (seconds := times_in(name)) is not None}
    if len(times) > 1:
        raise text.fault(f"one column of times was expected, got {_quoted(times)}", top)
    others = [name for name in names if name not in (*times, vertical)]
    if column is None and len(others) != 1:
        what = "column must be given, the name of the horizontal acceleration"
        raise text.fault(f"{what}: {_quoted(others) or 'no column is left for it'}", top)
    wanted = {"column": others[0] if column is None else column, "vertical": vertical}
    if column is not None and column == vertical:
        raise text.fault(f"column and vertical are the same, {column!r}", top)
    factors = {}
    for argument, name in wanted.items():
        if name is None:
            continue
        if name in times:
            raise text.fault(f"{argument} is {name!r}, which is taken for the times", top)
        if (count := names.count(name)) != 1:
            among = f"there are {count} such columns among {_quoted(names)}"
            raise text.fault(f"{argument} is {name!r}, but {among}", top)
        if re.search(_NOT_ACCELERATION, name, re.I):
            raise text.fault(f"acceleration was expected, not column {name!r}", top)
        ours = list(units)
        if units or name.lower() != "a_g":  # which may mean ground acceleration as well
            ours += _stated(units_in_name, [(top, name)], f"column {name!r}")
        # Comments may speak of several columns: one that agrees is enough.
        agreeing = [each for each in said if ours and math.isclose(each[2], ours[0][2])]
        factor = text.agreed(ours + (agreeing or said), UNITS, 1e-9)
        if factor is None:
            raise no_unit
        factors[name] = factor
    values = _columns(text, top, names, [*factors, *times])
    said = _stated(steps_in_text, comments, "a comment")
    for name, seconds in times.items():
        if math.isnan(seconds):
            raise text.fault(f"the unit of the times is not understood: {_short(name)}", top)
        step = _uniform_step(text, top, name, seconds * values[-1])
        said.insert(0, (None, f"column {name!r} has a step of {step:.6g} s", step))
    step = text.agreed(steps + said, _STEPS, _UNIFORM)
    if step is None:
        among = f"no column of times is among {_quoted(names)}"
        raise text.fault(f"time_step must be given, since {among}", top)
    rows = zip(factors.values(), values, strict=False)
    return [Component(repr(str(path)), factor, row, step) for factor, row in rows]


def _column_names(text: _Text) -> tuple[int, list[str]]:
    """The number of the line with the names of the columns, and these."""
    for number, line in enumerate(text.lines, 1):
        if line.strip() and not line.lstrip().startswith("#"):
            names = [name.strip() for name in _fields(line)]
            if all(re.fullmatch(rf"{NUMBER}|[-+]?(nan|inf(inity)?)", name, re.I) for name in names):
                raise text.fault(f"names of the columns were expected, got {_short(line)}", number)
            return number, names
    raise text.fault("a line with the names of the columns was expected, all are comments")


def _columns(text: _Text, top: int, names: list[str], wanted: list[str]) -> np.ndarray:
    """The values of some columns, shape (columns, samples)."""
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
        if len(fields) != len(names):
            counts = f"{len(names)} fields separated by commas were expected, got {len(fields)}"
            raise text.fault(counts, number)
        return [text.number(fields[i], number, f"column {names[i]!r}") for i in indices]

    values = text.values(top, quick, numbers).reshape(-1, len(indices)).T
    if len(values[0]) < 2:
        raise text.fault(f"at least two samples were expected, got {len(values[0])}")
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
        if faulty.any():
            at = int(np.argmax(faulty))
            got = f"got {times[at]} and then {times[at + 1]}"
            raise text.fault(f"column {name!r} {reason}, {got}", top + at + 2)
    return float(times[-1] - times[0]) / steps.size


def _quoted(names: Iterable[str]) -> str:
    """The first of several names, for a message."""
    names = [*names]
    return ", ".join([_short(name) for name in names[:12]]) + (", ..." if names[12:] else "")


def _short(word: str) -> str:
    """A word in quotes, cut if it is long."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")
