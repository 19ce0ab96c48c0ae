"""Files .csv: perhaps comments, a line with the names of columns, and the columns below it."""

import csv
import math
import re
from pathlib import Path

import numpy as np

from .components import Component
from .text import (
    STEP,
    UNIFORM,
    UNIT,
    RecordText,
    Statements,
    collect_statements,
    quote_names,
    quote_word,
)
from .units import (
    NUMBER,
    UNITS,
    find_steps_in_text,
    find_time_unit,
    find_units_in_name,
    find_units_in_text,
)

# Words for other quantities in names of columns.
_NOT_ACCELERATION = r"(?<![a-z])(vel(ocity)?|disp(l(acement)?)?)(?![a-z])"


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
        factors[name] = text.require_agreement(UNIT, ours + (agreeing or said), no_unit)
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
    step = text.require_agreement(STEP, steps, no_step, top)
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
    differs = abs(steps - usual) > UNIFORM * usual
    for faulty, reason in ((steps <= 0, "must increase"), (differs, uneven)):
        at = int(np.argmax(faulty))
        got = f"got {times[at]} and then {times[at + 1]}"
        text.refuse(bool(faulty[at]), f"column {name!r} {reason}, {got}", top + at + 2)
    # The mean, whose error by printed digits falls with the number of steps.
    return float(times[-1] - times[0]) / steps.size
