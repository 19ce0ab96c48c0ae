"""The two formats of records: .AT2 files, as the PEER databases have them, and .csv files.

An ``.AT2`` file has a header of about four lines, then the values of one component. A ``.csv``
file may begin with comments; then come one line of names and the columns below it.
"""

import contextlib
import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..host import read_regular, with_progress
from .record_units import (
    ALLOWED,
    NUMBER,
    Stated,
    as_number,
    factor_of,
    in_si,
    quoted,
    short,
    step_unit,
    steps_in_text,
    times_in,
    units_in_name,
    units_in_text,
)

_UNIFORM = 1e-3  # relative difference of time steps that are the same: printed with few digits
_BLOCK = 50_000  # lines converted to numbers at a time, between two updates of the progress bar
_BINARY = bytes({*range(0x20)} - {*b"\t\n\v\f\r"})

Lines = list[tuple[int, str]]  # with their numbers, counted from 1 on
Statements = list[tuple[int | None, str, float]]  # line, unless the caller's; words; value

_HEADER_LINES = 20  # at most, usually four
_POINTS_AND_STEP = (  # the third group is what follows the name DT
    re.compile(r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>\S.*)()$"),
    re.compile(r"\bDT\s*=\s*(?P<step>\S.*?)[\s,]+NPTS\s*=\s*(?P<points>[^\s,]+)()"),
    re.compile(r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b(.*)$"),
)
_NUMBER = re.compile(rf"{NUMBER}|[-+]?(nan|inf(inity)?)", re.IGNORECASE)
_QUANTITY = re.compile(r"\b(acceleration|velocity|displacement)(\s+time\b)?", re.IGNORECASE)
# Fixed columns run together where a sign fills the field; each number has its decimal point.
_FIELD = rf"(?=[-+]?\d*\.){NUMBER}"
_FIELDS = re.compile(rf"{_FIELD}(?:(?=[-+]){_FIELD})*", re.IGNORECASE)
_BARE_EXPONENT = re.compile(r"[\d.][-+]\d{2,3}(?![\d.])")
_PERHAPS_EXPONENT = re.compile(r"(?<=[\d.])[-+]\d{2,3}\.")
_NOT_ACCELERATION = re.compile(
    r"(?<![a-z])(vel(ocity)?|disp(l(acement)?)?)(?![a-z])", re.IGNORECASE
)


@dataclass(frozen=True)
class Text:
    """A file with its lines, and errors that name it."""

    path: Path
    lines: Sequence[str] = ()

    def fault(self, reason: str, line: int | None = None) -> ValueError:
        """What is wrong with the file, or with one line of it."""
        where = repr(str(self.path)) + ("" if line is None else f", line {line}")
        return ValueError(f"{where}: {reason}")

    def number(self, word: str, line: int, name: str = "a value") -> float:
        """A word as a finite number; `name` says of what."""
        try:
            value = float(word.replace("_", "?"))  # 1_000 is a number in Python only
        except ValueError:
            got = short(word) if word.strip() else "an empty field"
            raise self.fault(f"{name} must be a number, got {got}", line) from None
        if not math.isfinite(value):
            raise self.fault(f"{name} must be finite, got {short(word)}", line)
        return value

    def blocks(self, start: int) -> Iterator[tuple[int, Sequence[str]]]:
        """Blocks of the lines after line `start`, each with the number of its first line."""
        firsts = range(start, len(self.lines), _BLOCK)
        for first in with_progress(firsts, f"reading {self.path.name} [{_BLOCK} lines]"):
            yield first + 1, self.lines[first : first + _BLOCK]


def read_text(path: Path) -> Text:
    """The lines of a file, or a `ValueError` if it cannot be read or is no text."""
    text = Text(path)
    try:
        content = read_regular(path)
    except OSError as error:
        raise text.fault(f"the file cannot be read: {error.strerror or error}") from error
    # Files from DOS end with a Ctrl-Z.
    content = content.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\r\n\t ")
    if not content:
        raise text.fault("the file is empty")
    if len(content.translate(None, _BINARY)) < len(content):
        raise text.fault("a text file was expected, this one is binary")
    return Text(path, [_decoded(line) for line in content.splitlines()])


def _decoded(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")  # names of stations; numbers are the same in both


def read_at2(
    text: Text, unit: str | None, time_step: float | None = None
) -> tuple[np.ndarray, float]:
    """Read one component: its accelerations [m/s2] and the time step [s]."""
    header, points, step = _at2_header(text)
    last = len(header)
    _check_quantity(text, header)
    factor = _agreed(text, _of_caller(unit) + _stated(units_in_text, header, "the header"))
    if factor is None:
        raise text.fault(f"the header states no unit, so that unit must be given: {ALLOWED}")
    stated = [(last, f"the header states DT= {step:.6g} s", step)]
    _step(text, stated + _stated(steps_in_text, header, "the header"), time_step)
    blocks = [_at2_values(text, *block) for block in text.blocks(last)]
    values = np.concatenate([np.empty(0), *blocks])
    if values.size != points:
        raise text.fault(f"NPTS is {points}, but {values.size} values follow", last)
    return in_si(factor, values), step if time_step is None else time_step


def _at2_header(text: Text) -> tuple[Lines, int, float]:
    """The lines of the header, the number of values and the time step [s] from its last line."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        for pattern in _POINTS_AND_STEP:
            if match := pattern.search(line.upper()):
                points = text.number(match["points"], number, "NPTS")
                if points < 2 or points % 1:
                    got = match["points"]
                    raise text.fault(f"NPTS must be a whole number from 2 on, got {got}", number)
                step = _at2_step(text, number, match["step"], match[3])
                return list(enumerate(text.lines[:number], 1)), int(points), step
    raise text.fault(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )


def _at2_step(text: Text, line: int, words: str, after: str) -> float:
    """The time step [s] from `words` such as "10 MSEC" and from what comes after the name DT."""
    match = re.match(NUMBER, words, re.IGNORECASE)
    word = match[0] if match else re.split(r"[\s,]", words)[0]
    number = as_number(word) if match else text.number(word, line, "DT")
    seconds = step_unit(words[len(word) :].strip() or after)
    if math.isnan(seconds):
        raise text.fault(
            "DT must be a number, if need be with a unit of time, got"
            f" {short((words + ' ' + after).strip())}",
            line,
        )
    if not 0 < number * seconds < math.inf:
        raise text.fault(f"DT must be greater than 0, got {word}", line)
    return number * seconds


def _check_quantity(text: Text, header: Lines) -> None:
    """Refuse a file of velocities or displacements; headers of accelerations may mention them."""
    mentioned = [
        (quantity, series, number)
        for number, line in header
        for quantity, series in _QUANTITY.findall(line.lower())
    ]
    others = [each for each in mentioned if each[0] != "acceleration"]
    wrong = others if others == mentioned else []
    for quantity, _, number in [each for each in others if each[1]] or wrong:
        raise text.fault(f"acceleration was expected, not {quantity}", number)


def _at2_values(text: Text, first: int, lines: Sequence[str]) -> np.ndarray:
    words = " ".join(lines).split()
    try:
        values = np.fromiter(map(float, words), float, len(words))
    except ValueError:
        values = None
    if values is not None and np.isfinite(values).all() and not any("_" in each for each in lines):
        return values
    numbered = ((word, line) for line, each in enumerate(lines, first) for word in each.split())
    return np.array([value for word, line in numbered for value in _split(text, word, line)])


def _split(text: Text, word: str, line: int) -> list[float]:
    """The numbers in a word: one, or several of fixed columns without space between them."""
    if _FIELDS.fullmatch(word) is None:
        return [text.number(word, line)]
    # .1-02.3-02 may be .1e-02 and .3e-02 or .1 and -02.3e-02, unless a number begins with 0.
    perhaps = _PERHAPS_EXPONENT.findall(word)
    if any(each[1] == "0" for each in perhaps) or (perhaps and _BARE_EXPONENT.search(word)):
        raise text.fault(f"numbers that run together are not clear, got {short(word)}", line)
    values = [as_number(match[0]) for match in re.finditer(NUMBER, word, re.IGNORECASE)]
    if not np.isfinite(values).all():
        raise text.fault(f"a value must be finite, got {short(word)}", line)
    return values


def read_csv(
    text: Text, unit: str | None, column: str | None, vertical: str | None, time_step: float | None
) -> tuple[np.ndarray, np.ndarray | None, float]:
    """Read columns: horizontal and vertical accelerations [m/s2], the time step [s]."""
    top, names = _column_names(text)
    comments = list(enumerate(text.lines[: top - 1], 1))
    stated = _stated(units_in_text, comments, "a comment")
    if unit is None and not stated and not any(map(units_in_name, names)):
        raise text.fault(f"unit must be given for a .csv file: {ALLOWED}")
    times = {name: seconds for name in names if (seconds := times_in(name)) is not None}
    if len(times) > 1:
        raise text.fault(f"one column of times was expected, got {quoted(times)}", top)
    if column is None:
        others = [name for name in names if name not in (*times, vertical)]
        column = _only_column(text, top, others)
    if column == vertical:
        raise text.fault(f"column and vertical are the same, {column!r}", top)
    wanted = [column] if vertical is None else [column, vertical]
    for argument, name in zip(("column", "vertical"), wanted, strict=False):
        _check_column(text, top, names, argument, name)
    factors = [_column_factor(text, top, unit, name, stated) for name in wanted]
    values = _columns(text, top, names, [*wanted, *times])
    steps = _stated(steps_in_text, comments, "a comment")
    for name, seconds in times.items():
        if math.isnan(seconds):
            raise text.fault(f"the unit of the times is not understood: {short(name)}", top)
        step = _uniform_step(text, top, name, seconds * values[-1])
        steps = [(None, f"column {name!r} has a step of {step:.6g} s", step), *steps]
    step = _step(text, steps, time_step)
    if step is None:
        among = f"no column of times is among {quoted(names)}"
        raise text.fault(f"time_step must be given, since {among}", top)
    components = [in_si(factor, row) for factor, row in zip(factors, values, strict=False)]
    return components[0], None if vertical is None else components[1], step


def _column_names(text: Text) -> tuple[int, list[str]]:
    """The names of the columns, and the number of the line that they are in."""
    for number, line in enumerate(text.lines, 1):
        if line.strip() and not line.lstrip().startswith("#"):
            names = [name.strip() for name in _fields(line)]
            if all(_NUMBER.fullmatch(name) for name in names):
                raise text.fault(f"names of the columns were expected, got {short(line)}", number)
            return number, names
    raise text.fault("a line with the names of the columns was expected, all are comments")


def _only_column(text: Text, top: int, names: list[str]) -> str:
    """The one column that can be the horizontal acceleration."""
    if len(names) != 1:
        raise text.fault(
            "column must be given, the name of the horizontal acceleration:"
            f" {quoted(names) or 'no column is left for it'}",
            top,
        )
    return names[0]


def _check_column(text: Text, top: int, names: list[str], argument: str, name: str) -> None:
    count = names.count(name)
    if times_in(name) is not None:
        raise text.fault(f"{argument} is {name!r}, which is taken for the times", top)
    if count != 1:
        among = f"there are {count} such columns among {quoted(names)}"
        raise text.fault(f"{argument} is {name!r}, but {among}", top)
    if _NOT_ACCELERATION.search(name):
        raise text.fault(f"acceleration was expected, not column {name!r}", top)


def _column_factor(text: Text, top: int, unit: str | None, name: str, said: Statements) -> float:
    """The unit of a column in m/s2, from the caller, its name or what comments `said`."""
    statements = _of_caller(unit)
    if unit is not None or name.lower() != "a_g":  # which may mean ground acceleration as well
        statements += _stated(units_in_name, [(top, name)], f"column {name!r}")
    factor = _agreed(text, statements)
    # Comments may speak of several columns: one that agrees is enough.
    if factor is None or not any(math.isclose(factor, value) for _, _, value in said):
        factor = _agreed(text, statements[:1] + said)
    if factor is None:
        raise text.fault(f"unit must be given for a .csv file: {ALLOWED}")
    return factor


def _columns(text: Text, top: int, names: list[str], wanted: list[str]) -> np.ndarray:
    """The values of some columns, shape (columns, samples)."""
    indices = [names.index(name) for name in wanted]
    blocks = []
    for first, lines in text.blocks(top):
        values = np.empty(0)
        if all(line.count(",") == len(names) - 1 and '"' not in line for line in lines):
            with contextlib.suppress(ValueError):
                values = np.loadtxt(lines, delimiter=",", comments=None, usecols=indices, ndmin=2)
        if len(values) < len(lines) or not np.isfinite(values).all():
            # Something is wrong, or unusual such as quotes: line by line, to say where.
            rows = enumerate(lines, first)
            values = np.array([_row(text, number, row, names, indices) for number, row in rows])
        blocks.append(values)
    samples = sum(map(len, blocks))
    if samples < 2:
        raise text.fault(f"at least two samples were expected, got {samples}")
    return np.concatenate(blocks).T


def _row(text: Text, number: int, line: str, names: list[str], indices: list[int]) -> list[float]:
    fields = _fields(line)
    if len(fields) != len(names):
        raise text.fault(
            f"{len(names)} fields separated by commas were expected, got {len(fields)}", number
        )
    return [text.number(fields[i], number, f"column {names[i]!r}") for i in indices]


def _fields(line: str) -> list[str]:
    if '"' not in line:
        return line.split(",")
    try:
        return next(csv.reader([line], skipinitialspace=True), [])
    except csv.Error:  # for example a field of more than 131,072 characters
        return []


def _uniform_step(text: Text, top: int, name: str, times: np.ndarray) -> float:
    steps = np.diff(times)
    usual = float(np.median(steps))
    for faulty, reason in (
        (steps <= 0, "must increase"),
        (abs(steps - usual) > _UNIFORM * usual, f"must have a uniform step, mostly {usual:.6g} s"),
    ):
        if faulty.any():
            at = int(np.argmax(faulty))
            got = f"got {times[at]} and then {times[at + 1]}"
            raise text.fault(f"column {name!r} {reason}, {got}", top + at + 2)
    return float(times[-1] - times[0]) / steps.size


def _stated(of: Callable[[str], list[Stated]], lines: Lines, where: str) -> Statements:
    """What lines state of units or time steps."""
    return [(n, f"{where} states {words}", value) for n, line in lines for words, value in of(line)]


def _agreed(
    text: Text, statements: Statements, kind: str = ALLOWED, tolerance: float = 1e-9
) -> float | None:
    """The value that all statements agree on, the first one's; None if there is none."""
    if not statements:
        return None
    line, first, value = statements[0]
    if math.isnan(value):
        raise text.fault(f"{first}, which is not {kind}", line)
    for number, words, other in statements[1:]:
        if not math.isclose(value, other, rel_tol=tolerance):
            where = "" if line is None else f" in line {line}"
            raise text.fault(f"{first}{where}, but {words}", number)
    return value


def _step(text: Text, statements: Statements, time_step: float | None) -> float | None:
    """The one time step [s] that the file and the caller state."""
    of_caller = [] if time_step is None else [(None, f"time_step is {time_step} s", time_step)]
    kind = "a time step in s, ms or the like, or in samples per second"
    return _agreed(text, of_caller + statements, kind, _UNIFORM)


def _of_caller(unit: str | None) -> Statements:
    return [] if unit is None else [(None, f"unit is {unit!r}", factor_of(unit))]
