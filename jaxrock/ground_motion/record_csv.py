"""Reading .csv files: a line with names of columns, comments before it, numbers below it."""

import csv
import math
import os
import re

import numpy as np

from .record_header import times_in, units_in_name
from .record_text import (
    ALLOWED,
    UNIFORM,
    Lines,
    Text,
    agreed_step,
    agreed_unit,
    given_unit,
    in_si,
    listed,
    short,
    stated_units,
)

_OTHER_QUANTITY = re.compile(
    r"(?<![a-z])(?:(vel(?:ocity)?)|disp(?:l(?:acement)?)?)(?![a-z])", re.IGNORECASE
)


def read_csv(
    text: Text,
    unit: str | None,
    column: str | None,
    vertical: str | os.PathLike[str] | None,
    time_step: float | None,
) -> tuple[np.ndarray, np.ndarray | None, float]:
    """Read columns: horizontal and vertical accelerations [m/s2], the time step [s]."""
    header, names, data = _names(text)
    top = header[-1][0]
    comments = header[:-1]
    if unit is None and not stated_units(comments) and not any(map(units_in_name, names)):
        raise text.fault(f"unit must be given for a .csv file: {ALLOWED}")
    times = {name: seconds for name in names if (seconds := times_in(name)) is not None}
    if len(times) > 1:
        raise text.fault(f"one column of times was expected, got {listed([*times])}", top)
    column, vertical = _chosen(text, top, names, [*times], column, vertical)
    wanted = [name for name in (column, vertical) if name is not None]
    factors = [_factor_of_column(text, comments, top, unit, name) for name in wanted]
    for name, seconds in times.items():
        if math.isnan(seconds):
            raise text.fault(f"the unit of the times is not understood: {short(name)}", top)
    step = agreed_step(text, comments, None, time_step, top, names) if not times else math.nan
    values = _columns(text, data, top, names, [*wanted, *times])
    for name, seconds in times.items():
        step = _uniform_step(text, top, name, seconds * values[-1])
        step = agreed_step(text, comments, step, time_step)
    rows = [in_si(factor, row) for factor, row in zip(factors, values, strict=False)]
    return rows[0], rows[1] if rows[1:] else None, step


def _chosen(
    text: Text,
    top: int,
    names: list[str],
    times: list[str],
    column: str | None,
    vertical: str | os.PathLike[str] | None,
) -> tuple[str, str | None]:
    """The names of the horizontal and of the vertical acceleration."""
    if vertical is not None:
        vertical = str(vertical)
    others = [name for name in names if name not in (*times, vertical)]
    if column is None:
        if len(others) != 1:
            raise text.fault(
                "column must be given, the name of the horizontal acceleration:"
                f" {listed(others) or 'no column is left for it'}",
                top,
            )
        column = others[0]
    if column == vertical:
        raise text.fault(f"column and vertical are the same, {column!r}", top)
    for argument, name in (("column", column), ("vertical", vertical)):
        if name is None:
            continue
        if name in times:
            raise text.fault(f"{argument} is {name!r}, which is taken for the times", top)
        if names.count(name) != 1:
            raise text.fault(
                f"{argument} is {name!r}, but there are {names.count(name)} such columns among"
                f" {listed(names)}",
                top,
            )
        if _OTHER_QUANTITY.search(name):
            raise text.fault(f"acceleration was expected, not column {name!r}", top)
    return column, vertical


def _factor_of_column(text: Text, comments: Lines, top: int, unit: str | None, name: str) -> float:
    """What the unit of a column is in m/s2."""
    said = [(top, stated) for stated in units_in_name(name)]
    if unit is None and name.lower() == "a_g":  # the symbol of ground acceleration as well
        said = []
    found = agreed_unit(text, given_unit(unit), f"column {name!r}", said)
    said = stated_units(comments)
    # Comments may speak of several columns.
    if found is None or not any(math.isclose(found.value, each.value) for _, each in said):
        found = agreed_unit(text, found, "a comment", said)
    if found is None:
        raise text.fault(f"unit must be given for a .csv file: {ALLOWED}")
    return found.value


def _names(text: Text) -> tuple[Lines, list[str], int]:
    """The lines down to that with the names of the columns, the names, where the data begin."""
    header = []
    for number, line, data in text.lines():
        header.append((number, line))
        if line.strip() and not line.lstrip().startswith("#"):
            names = [name.strip() for name in _fields(line)]
            if all(map(_is_number, names)):
                raise text.fault(f"names of the columns were expected, got {short(line)}", number)
            return header, names, data
    raise text.fault("a line with the names of the columns was expected, all are comments")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _columns(text: Text, data: int, top: int, names: list[str], wanted: list[str]) -> np.ndarray:
    """The `wanted` columns from byte `data` on, below line `top`, shape (wanted, samples)."""
    indices = [names.index(name) for name in wanted]
    blocks = [np.empty((len(wanted), 0))]
    for first, lines in text.blocks(data, top + 1):
        block = _block_of_columns(lines, len(names), indices)
        if block is None:  # something is wrong, or unusual: line by line
            rows = []
            for number, line in enumerate(lines, first):
                fields = _fields(line)
                if len(fields) != len(names):
                    raise text.fault(
                        f"{len(names)} fields separated by commas were expected, got {len(fields)}",
                        number,
                    )
                rows.append(
                    [text.number(fields[i], number, f"column {names[i]!r}") for i in indices]
                )
            block = np.array(rows).T
        blocks.append(block)
    values = np.concatenate(blocks, axis=1)
    if values.shape[1] < 2:
        raise text.fault(f"at least two samples were expected, got {values.shape[1]}")
    return values


def _block_of_columns(lines: list[str], count: int, indices: list[int]) -> np.ndarray | None:
    """Columns of lines with `count` fields each, or None if one is not as it should be."""
    if any('"' in line for line in lines):
        rows = [_fields(line) for line in lines]
        regular = all(len(row) == count for row in rows)
        fields = [field for row in rows for field in row]
    else:
        regular = all(line.count(",") == count - 1 for line in lines)
        fields = ",".join(lines).split(",")
    if not regular:
        return None
    columns = [fields[i::count] for i in indices]
    try:
        values = np.array([np.fromiter(map(float, column), float) for column in columns])
    except ValueError:
        return None
    faulty = any("_" in "".join(column) for column in columns)  # as in text.number
    return None if faulty or not np.isfinite(values).all() else values


def _fields(line: str) -> list[str]:
    if '"' not in line:
        return line.split(",")
    try:
        return next(csv.reader([line], skipinitialspace=True), [])
    except csv.Error:  # such as quotes that never end
        return []


def _uniform_step(text: Text, top: int, name: str, times: np.ndarray) -> float:
    steps = np.diff(times)
    usual = float(np.median(steps))
    for faulty, reason in (
        (steps <= 0, "must increase"),
        (abs(steps - usual) > UNIFORM * usual, f"must have a uniform step, mostly {usual:.6g} s"),
    ):
        if faulty.any():
            at = int(np.argmax(faulty))
            raise text.fault(
                f"column {name!r} {reason}, got {times[at]} and then {times[at + 1]}",
                top + at + 2,
            )
    return float(times[-1] - times[0]) / steps.size
