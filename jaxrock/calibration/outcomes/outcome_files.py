"""Tables of tests, or of objects in earthquakes, that overturned or stood, with their motions."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from ...ground_motion import Record, Suite, read_record
from ...host import Printed, show_progress
from ...oldtables import (
    UNITS_OF_ACCELERATION,
    Head,
    Row,
    Table,
    as_number,
    parse_unit,
    quote_word,
    read_table,
)
from ...validation import POSITIVE, Booleans, Domain, Reals

# The columns of numbers, and their values in SI.
_DOMAINS = {
    "time step": POSITIVE,
    "scale": Domain("finite and not 0", lambda x: (abs(x) > 0) & (abs(x) < math.inf), 1.0),
    # A rotation of more than a right angle was measured in another unit than stated.
    "peak rotation": Domain(
        "at least 0 and less than pi / 2 rad", lambda x: (x >= 0) & (x < math.pi / 2), 0.0
    ),
}
# What the units of columns measure that have to state theirs.
_DIMENSIONS = {"time step": "time", "peak rotation": "angle"}
_WORDS = ("file", "column", "unit", "overturned", "group", "name")
_FLAGS = {
    **dict.fromkeys(("yes", "true", "1", "overturned"), True),
    **dict.fromkeys(("no", "false", "0", "stood"), False),
}
_NEEDED = ("file", "overturned")
_ALLOWED = (
    "file, overturned, and perhaps unit, column, time step [s], scale, group,"
    " peak rotation [rad], name, with steps in s or ms, and rotations in rad, mrad or deg"
)


class Outcomes(Printed, eqx.Module):
    """Motions, and whether a block overturned under them; see `read_tests`.

    Attributes
    ----------
    suite : Suite
        The motion of each test, as it was scaled.
    overturned : Array, shape (tests,)
        Whether the block overturned.
    groups : tuple of str, optional
        The group of each test, such as the earthquake.
    peak_rotations : Array, shape (tests,), optional
        Largest measured rotation [rad]; NaN where none was measured or the block overturned.
    """

    suite: Suite
    overturned: Booleans
    groups: tuple[str, ...] | None = eqx.field(static=True)
    peak_rotations: Reals | None

    def __str__(self) -> str:
        count = len(self.suite)
        overturned = int(np.asarray(self.overturned).sum())
        of_groups = ""
        if self.groups is not None:
            groups = len(set(self.groups))
            of_groups = f" in {groups} group{'s' * (groups > 1)}"
        lines = [
            f"{count} test{'s' * (count > 1)}{of_groups}: {overturned} overturned,"
            f" {count - overturned} stood",
            str(self.suite),
        ]
        if self.peak_rotations is not None:
            measured = np.isfinite(np.asarray(self.peak_rotations)).sum()
            lines.append(f"peak rotations of {measured} tests")
        return "\n".join(lines)


class _Source(NamedTuple):
    """A motion of a file, and what the table states of it: its unit, step [s] and column."""

    path: Path
    unit: str | None
    time_step: float | None
    column: str | None


class _Fault(NamedTuple):
    """A row that is refused: its line, and the error that says why."""

    line: int
    error: ValueError


class _Test(NamedTuple):
    """A test of the table; an empty name or group for none, a peak [rad] of NaN for none."""

    line: int
    name: str
    source: _Source
    scale: float
    overturned: bool
    group: str
    peak: float


def read_tests(path: str | os.PathLike[str]) -> Outcomes:
    r"""Read a table of tests in which a block overturned or stood, and their motions.

    They may be tests on a shaking table, or observations of objects in earthquakes.

    Parameters
    ----------
    path : str or path
        A file with columns separated by commas, semicolons or tabs, in any order, below a
        line with their names, such as ``file,unit,overturned``. Titles may stand above that
        line and units below it. Lines that begin with # are comments, and rows of empty cells
        are left out. The decimal separator is a point, or a comma in all numbers.

        Each test has a ``file`` with its motion, absolute or relative to the folder of the
        table. The column ``overturned`` has yes, true, 1 or overturned, or else no, false, 0
        or stood. Where the files do not state them, a ``unit`` of acceleration and a ``time
        step [s]`` are needed, and where they have several components a ``column``, as in
        `read_record`.

        A ``scale`` is a factor on the motion, 1 if it is missing; if it is negative, the
        motion is reversed. Tests of the same ``group``, such as an earthquake, are not
        independent of each other; either all tests have a group or none has. A ``peak
        rotation``, in rad, mrad or deg, is empty where it was not measured; that of a test
        that overturned is left out, since a block that falls has no peak. A test may have a
        ``name``. By default it is the name of the file without its ending, followed by a
        number if that name is taken.

    Returns
    -------
    Outcomes
        The suite of the motions, what overturned, groups and peak rotations. A file that
        several tests have in common is read once.

    Raises
    ------
    ValueError
        If a head is not understood, or the file cannot be read or seems to be cut; with one
        line for each row in which a value is missing, not understood or out of range, a name
        occurs twice, or a motion cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder)
    ...     _ = (path / "run.csv").write_text("time [s],acc [g]\n0,0\n0.01,0.3\n0.02,0\n")
    ...     rows = "run.csv,1,stood\nrun.csv,2.5,overturned\n"
    ...     _ = (path / "tests.csv").write_text(f"file,scale,overturned\n{rows}")
    ...     print(jr.calibration.read_tests(path / "tests.csv"))
    2 tests: 1 overturned, 1 stood
    suite of 2 records of 3 samples, 0.01 s apart
    """
    table = read_table(Path(path))
    columns = _find_columns(table)
    # With their lines. All are collected: who repairs a table wants to see them at once.
    faults: list[_Fault] = []
    tests: list[_Test] = []
    for row in table.rows:
        if any(row.cells):
            try:
                tests.append(_read_test(table, row, columns))
            except ValueError as error:
                faults.append(_Fault(row.line, error))
    if not tests and not faults:
        raise table.text.error("at least one test was expected, got none")
    faults += _check_groups(table, tests)
    names, repeated = _make_names(table, tests)
    records, not_read = _read_records(table, tests)
    faults += [*repeated, *not_read, *_find_cut(table, columns)]
    if faults:
        # What is said of the whole table is said once.
        faults.sort(key=lambda fault: fault.line)
        raise ValueError("\n".join(dict.fromkeys(str(fault.error) for fault in faults)))
    peaks = np.array([test.peak for test in tests])
    return Outcomes(
        Suite(records, names),
        jax.device_put(np.array([test.overturned for test in tests])),
        tuple(test.group for test in tests) if tests[0].group else None,
        None if np.isnan(peaks).all() else jax.device_put(peaks),
    )


def _find_columns(table: Table) -> dict[str, int]:
    """Find the column of each quantity; a `ValueError` if one is not understood."""
    if not table.heads:
        reason = (
            f"a line with the names of the columns was expected above; they are {_ALLOWED}"
        )
        raise table.text.error(reason, table.rows[0].line)
    columns: dict[str, int] = {}
    for column, head in enumerate(table.heads):
        name = f"column {quote_word(head.words)}"
        is_empty = not any("".join(row.cells[column : column + 1]) for row in table.rows)
        if not head.words and is_empty:
            continue
        # It is not left out: it may be one that the user relies on, under another name.
        if not _is_known(head):
            reason = f"{name} is not understood: leave it out or rename it; columns are"
            raise table.text.error(f"{reason} {_ALLOWED}", table.line)
        if head.quantity in columns:
            reason = f"{name}: a column {head.quantity!r} is there already"
            raise table.text.error(reason, table.line)
        if head.quantity in _DIMENSIONS:
            has_unit = head.units and not math.isnan(head.factor)
            allowed = "" if has_unit else f"a unit of {_DIMENSIONS[head.quantity]}"
        else:
            allowed = "no unit" if head.factor != 1 else ""
        if allowed:
            reason = f"{name}: {allowed} was expected, as in {_ALLOWED}"
            raise table.text.error(reason, table.line)
        columns[head.quantity] = column
    for quantity in _NEEDED:
        if quantity not in columns:
            reason = f"column {quantity!r} is missing; columns are {_ALLOWED}"
            raise table.text.error(reason, table.line)
    return columns


def _is_known(head: Head) -> bool:
    """Return whether a column is one of a table of tests."""
    # A rotation or a tilt alone may be one before the test.
    if head.quantity == "peak rotation":
        return re.search("peak|max|largest", head.name, re.I) is not None
    return head.quantity in (*_WORDS, *_DOMAINS)


def _read_test(table: Table, row: Row, columns: dict[str, int]) -> _Test:
    """Read a test; a `ValueError` with the line if a value is not allowed."""
    if len(row.cells) < len(table.heads):
        raise table.error_of_width(row)
    cells = {quantity: row.cells[column] for quantity, column in columns.items()}
    if not cells["file"]:
        raise table.text.error("a file with the motion was expected, got ''", row.line)
    overturned = _FLAGS.get(cells["overturned"].lower())
    if overturned is None:
        name = f"column {quote_word(table.heads[columns['overturned']].words)}"
        reason = f"{name} must be yes, no, true, false, 1, 0, overturned or stood, got"
        raise table.text.error(f"{reason} {quote_word(cells['overturned'])}", row.line)
    unit = cells.get("unit") or None
    if unit and parse_unit(unit).dimension != "acceleration":
        name = f"column {quote_word(table.heads[columns['unit']].words)}"
        reason = f"{name} must be {UNITS_OF_ACCELERATION}, or empty, got {quote_word(unit)}"
        raise table.text.error(reason, row.line)
    if overturned:
        # A block that falls has no peak, whatever was noted.
        cells["peak rotation"] = ""
    numbers = {
        quantity: _read_number(table, row, columns[quantity], quantity)
        for quantity in _DOMAINS
        if cells.get(quantity)
    }
    path = table.text.path.parent / cells["file"]
    source = _Source(path, unit, numbers.get("time step"), cells.get("column") or None)
    return _Test(
        row.line,
        cells.get("name", ""),
        source,
        numbers.get("scale", 1.0),
        overturned,
        cells.get("group", ""),
        numbers.get("peak rotation", math.nan),
    )


def _read_number(table: Table, row: Row, column: int, quantity: str) -> float:
    """Read a number in SI; a `ValueError` with the line if it is not allowed."""
    head = table.heads[column]
    domain = _DOMAINS[quantity]
    cell = quote_word(row.cells[column])
    number = table.parse_number(row, column)
    name = f"column {quote_word(head.words)}"
    if number is None:
        reason = f"{name} must have a number, its unit in the head only, got {cell}"
        raise table.text.error(reason, row.line)
    value = number * head.factor
    # Programs write NaN for what was not measured.
    is_missing = quantity == "peak rotation" and math.isnan(value)
    if not is_missing and not domain.contains(np.asarray(value)):
        raise table.text.error(f"{name} must be {domain.allowed}, got {cell}", row.line)
    return value


def _check_groups(table: Table, tests: Sequence[_Test]) -> list[_Fault]:
    """Return a fault for each test without a group, if others have one."""
    if not any(test.group for test in tests):
        return []
    reason = "a group was expected, since other tests have one, got ''"
    return [
        _Fault(test.line, table.text.error(reason, test.line))
        for test in tests
        if not test.group
    ]


def _make_names(table: Table, tests: Sequence[_Test]) -> tuple[list[str], list[_Fault]]:
    """Make a name for each test, by its file if it has none; names given twice are faults."""
    taken: set[str] = set()
    faults: list[_Fault] = []
    for test in tests:
        if test.name and test.name in taken:
            reason = f"names must differ, got {quote_word(test.name)} twice"
            faults.append(_Fault(test.line, table.text.error(reason, test.line)))
        taken.add(test.name)
    names: list[str] = []
    for test in tests:
        name = test.name
        stem = test.source.path.stem
        number = 1
        while not test.name and (not name or name in taken):
            name = stem if number == 1 else f"{stem} {number}"
            number += 1
        taken.add(name)
        names.append(name)
    return names, faults


def _read_records(table: Table, tests: Sequence[_Test]) -> tuple[list[Record], list[_Fault]]:
    """Read the motions of tests, each source once; those that cannot be read are faults."""
    # The first line that names a source stands for all that do.
    lines: dict[_Source, int] = {}
    for test in tests:
        lines.setdefault(test.source, test.line)
    records: dict[_Source, Record] = {}
    faults: list[_Fault] = []
    for source in show_progress([*lines], "reading motions"):
        path, unit, time_step, column = source
        try:
            records[source] = read_record(path, unit=unit, time_step=time_step, column=column)
        except ValueError as error:
            reason = table.text.error(str(error), lines[source])
            faults.append(_Fault(lines[source], reason))
    motions = [
        records[test.source].scaled(test.scale) for test in tests if test.source in records
    ]
    return motions, faults


def _find_cut(table: Table, columns: dict[str, int]) -> list[_Fault]:
    """Return a fault if the table seems to be cut within its last cell."""
    last = table.rows[-1]
    is_comment = table.text.lines[-1].lstrip().startswith("#")
    if table.text.ends or is_comment or len(last.cells) < len(table.heads):
        return []
    try:
        table.refuse_cut()
    except ValueError as error:
        return [_Fault(last.line, error)]
    column = len(last.cells) - 1
    cell = last.cells[column]
    reason = "" if cell else "is empty"
    if cell and as_number(cell) is None:
        # As gal is cut to g, and the name of an earthquake to its first letters.
        above = [row.cells[column] for row in table.rows if len(row.cells) > column]
        longer = [word for word in above if word.startswith(cell) and word != cell]
        if longer:
            reason = f"{quote_word(cell)} is the beginning of {quote_word(longer[0])}"
    if not reason:
        return []
    error = table.text.error(
        f"the file looks truncated: its last cell {reason} and no newline follows; add a"
        " newline if it is complete",
        last.line,
    )
    return [_Fault(last.line, error)]
