"""Files .csv: perhaps comments, a line with the names of columns, and the columns below it."""

import csv
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .components import Component
from .cut import refuse_cut
from .directions import find_clear_direction, find_column_direction
from .printed_times import explain_times, find_printed_halves, find_printed_step
from .text import (
    STEP,
    UNIFORM,
    UNIT,
    Lines,
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
# Written for Excel, to say how fields are separated.
_SEPARATOR = r'"?sep=(?P<separator>.?)"?'
# nan and inf are numbers as well: a line of them states no names.
_NUMBER = rf"{NUMBER}|[-+]?(?:nan|inf(?:inity)?)"
# As Fortran may write it, with a letter that Python does not know.
_FORTRAN = r"[-+]?(?:\d+\.?\d*|\.\d+)d[-+]?\d+"
# In a comment above numbers: a word, and perhaps its unit in brackets.
_NAME_IN_COMMENT = r"[^\s\[\]()]+(?:\s*[\[(][^\[\]()]*[\])])?"
SEARCH_REPORT = "this is PEER's report of a search for records, which is none itself"
# As many are enough to see how numbers are printed.
_MANY_LINES = 1000


class _TableHead(NamedTuple):
    """The lines above the numbers: how many, names of columns, their separator, comments."""

    top: int
    names: list[str]
    line_of_names: int
    separator: str
    comments: Lines


def read_csv(
    path: Path, units: Statements, steps: Statements, column: str | None, vertical: str | None
) -> list[Component]:
    """Read a horizontal column, and perhaps a vertical one.

    The caller states `units` and `steps`, and the columns by their names or where they point.
    """
    text = RecordText(path)
    text.refuse(is_search_report(text.lines), SEARCH_REPORT)
    head = _read_head(text)
    _require_unit(text, head, units)
    times = _find_times(text, head)
    vertical = vertical and _find_column(text, head, vertical)
    if column is None:
        others = [name for name in head.names if name not in (*times, vertical)]
        which = "column must be given, the name of the horizontal acceleration: "
        text.refuse(
            len(others) != 1,
            which + (quote_names(others) or "no column is left for it"),
            head.line_of_names,
        )
        column = others[0]
        known = find_clear_direction(strip_unit(column)) in ("up", "down")
        no_level = "no component is horizontal; column names a vertical one: "
        text.refuse(known, no_level + quote_names(others), head.line_of_names)
    column = _find_column(text, head, column)
    same = f"column and vertical are the same, {column!r}"
    text.refuse(column == vertical, same, head.line_of_names)
    arguments = {column: "column"} | ({} if vertical is None else {vertical: "vertical"})
    return _read_named(text, head, units, steps, arguments)


def read_columns(
    text: RecordText, units: Statements, steps: Statements, arguments: dict[str, str]
) -> list[Component]:
    """Read columns by their names; `arguments` says by which argument each was asked for."""
    head = _read_head(text)
    _require_unit(text, head, units)
    return _read_named(text, head, units, steps, arguments)


def list_acceleration_columns(text: RecordText) -> list[str]:
    """Name the columns of a .csv file that may be accelerations."""
    return _list_accelerations(_read_head(text))


def strip_unit(name: str) -> str:
    """Strip the unit that it states from the name of a column."""
    # So that a word of the unit is not taken for a direction, and the record has a short name.
    stated = find_units_in_name(name)
    if stated:
        at = name.rfind(stated[-1][0])
        name = f"{name[:at].rstrip('_ [(')} {name[at + len(stated[-1][0]) :].lstrip('_ ])')}"
    return name.strip("_ ")


def is_search_report(lines: list[str]) -> bool:
    """Tell whether a .csv file is PEER's report of a search for records."""
    first = next((line for line in lines if line.strip()), "")
    return (
        re.match(r'[\s"]*(?:PEER Ground Motion Database\b|-- Summary of )', first) is not None
    )


def _list_accelerations(head: _TableHead) -> list[str]:
    """Name the columns that are neither times, nor velocities or displacements."""
    names = [
        n
        for n in head.names
        if find_time_unit(n) is None and not re.search(_NOT_ACCELERATION, n, re.I)
    ]
    # Where some columns state a unit of acceleration, the others hold something else.
    known = [n for n in names if any(math.isfinite(u) for _, u in find_units_in_name(n))]
    return known or names


def _find_column(text: RecordText, head: _TableHead, name: str) -> str:
    """Find the column of a name, or the one that points "up" or "down" if none has it."""
    word = name.lower()
    if name in head.names or word not in ("up", "down"):
        return name
    columns = _list_accelerations(head)
    found = [each for each in columns if find_column_direction(strip_unit(each)) == word]
    one = f"one column that points {word} was expected, got "
    text.refuse(len(found) != 1, one + (quote_names(found) or "none"), head.line_of_names)
    return found[0]


def _require_unit(text: RecordText, head: _TableHead, units: Statements) -> None:
    """Refuse a file whose unit neither the caller nor the file states."""
    said = units or collect_statements(find_units_in_text, head.comments, "")
    said = said or any(map(find_units_in_name, head.names))
    text.refuse(not said, f"unit must be given for a .csv file: {UNITS}")


def _find_times(text: RecordText, head: _TableHead) -> dict[str, float]:
    """Find the column of times, if there is one, and its unit [s]."""
    found = {n: unit for n in head.names if (unit := find_time_unit(n)) is not None}
    several = f"one column of times was expected, got {quote_names(found)}"
    text.refuse(len(found) > 1, several, head.line_of_names)
    return found


def _read_named(
    text: RecordText,
    head: _TableHead,
    units: Statements,
    steps: Statements,
    arguments: dict[str, str],
) -> list[Component]:
    """Read columns by their names, once all that is stated about them is clear."""
    top = head.line_of_names
    times = _find_times(text, head)
    factors = {
        name: _find_factor(text, head, units, name, argument, times)
        for name, argument in arguments.items()
    }
    values = _read_values(text, head, [*factors, *times])
    last = text.lines[head.top :][-_MANY_LINES:]
    refuse_cut(text, [_find_last_word(head, line) for line in last])
    said = collect_statements(find_steps_in_text, head.comments, "a comment")
    for name, seconds in times.items():
        not_understood = f"the unit of the times is not understood: {quote_word(name)}"
        text.refuse(math.isnan(seconds), not_understood, top)
        step = _find_step(text, head, name, seconds, values[-1], [*steps, *said])
        steps = [*steps, (0, f"column {name!r} has a step of {step:.6g} s", step)]
    no_step = (
        f"time_step must be given, since no column of times is among {quote_names(head.names)}"
    )
    step = text.require_agreement(STEP, steps + said, no_step, top)
    # Not strict: the row of times, if there is one, comes last.
    rows = zip(factors.items(), values, strict=False)
    components = []
    for (name, factor), row in rows:
        direction = find_clear_direction(strip_unit(name))
        # Errors about where it points have to tell it from the horizontal one.
        where = f", column {name!r}" if arguments[name] == "vertical" else ""
        title = f"{str(text.path)!r}{where}"
        components.append(Component(title, factor, row, step, direction))
    return components


def _find_factor(
    text: RecordText,
    head: _TableHead,
    units: Statements,
    name: str,
    argument: str,
    times: dict[str, float],
) -> float:
    """Find the unit of a column [m/s2]; a `ValueError` if it is no acceleration."""
    at = head.line_of_names
    given = f"{argument} is {name!r}"
    count = head.names.count(name)
    text.refuse(name in times, f"{given}, which is taken for the times", at)
    among = f"but there are {count} such columns among {quote_names(head.names)}"
    text.refuse(count != 1, f"{given}, {among}", at)
    wrong = re.search(_NOT_ACCELERATION, name, re.I) is not None
    text.refuse(wrong, f"acceleration was expected, not column {name!r}", at)
    ours = list(units)
    # Without a caller's unit, a_g is no statement: it may mean ground acceleration as well.
    if units or name.lower() != "a_g":
        ours += collect_statements(find_units_in_name, [(at, name)], f"column {name!r}")
    # Comments may speak of several columns: one that agrees is enough.
    said = collect_statements(find_units_in_text, head.comments, "a comment")
    agreeing = [each for each in said if ours and math.isclose(each[2], ours[0][2])]
    no_unit = f"unit must be given for a .csv file: {UNITS}"
    return text.require_agreement(UNIT, ours + (agreeing or said), no_unit)


def _read_head(text: RecordText) -> _TableHead:
    """Find the names of the columns and what separates them."""
    comments: Lines = []
    said = None
    for number, line in enumerate(text.lines, 1):
        if not line.strip():
            continue
        separator = re.fullmatch(_SEPARATOR, line.strip("\r\n ").rstrip(), re.I)
        if separator and number == 1:
            said = separator["separator"] or "\t"
            wrong = f"columns must be separated by commas or tabs, got {quote_word(line)}"
            text.refuse(said not in ",\t", wrong, number)
            continue
        if line.lstrip().startswith("#"):
            comments.append((number, line))
            continue
        wrong = f"columns must be separated by commas, got semicolons in {quote_word(line)}"
        text.refuse(";" in line and "," not in line, wrong, number)
        separator = said or ("\t" if "\t" in line and "," not in line else ",")
        names = [name.strip() for name in _split_fields(line, separator)]
        if not all(re.fullmatch(_NUMBER, name, re.I) for name in names):
            return _TableHead(_skip_empty(text, number), names, number, separator, comments)
        # One column needs no name.
        if len(names) == 1:
            return _TableHead(number - 1, ["column 1"], number - 1, separator, comments)
        if comments:
            names = _find_names_in_comment(comments[-1][1], separator, len(names))
            if names:
                return _TableHead(number - 1, names, comments[-1][0], separator, comments[:-1])
        wrong = f"names of the columns were expected, got {quote_word(line)}"
        text.refuse(True, wrong, number)
    raise text.make_error(
        "a line with the names of the columns was expected, all are comments"
    )


def _skip_empty(text: RecordText, number: int) -> int:
    """Return the number of the last empty line after another, or of that one."""
    while number < len(text.lines) and not text.lines[number].strip():
        number += 1
    return number


def _find_names_in_comment(line: str, separator: str, count: int) -> list[str]:
    """Find the names of columns in the last comment, as NumPy writes it, or none."""
    names = [name.strip() for name in _split_fields(line.strip().lstrip("#"), separator)]
    # Of sentences, which have commas as well, the parts are seldom single words.
    fit = all(
        re.fullmatch(_NAME_IN_COMMENT, name) and not re.fullmatch(_NUMBER, name, re.I)
        for name in names
    )
    return names if fit and len(names) == count else []


def _read_values(text: RecordText, head: _TableHead, wanted: list[str]) -> np.ndarray:
    """Read the values of some columns, shape (columns, samples)."""
    indices = [head.names.index(name) for name in wanted]
    separators = len(head.names) - 1
    between = "commas" if head.separator == "," else "tabs"

    def parse_quickly(lines: list[str]) -> np.ndarray:
        # With quotes, or with fields missing in some lines, `loadtxt` would not always raise.
        usual = all(
            line.count(head.separator) == separators and '"' not in line for line in lines
        )
        if not usual or not lines:
            raise ValueError
        rows = np.loadtxt(
            lines, delimiter=head.separator, comments=None, usecols=indices, ndmin=2
        )
        # It passes over empty lines, which a table must not have.
        if len(rows) < len(lines):
            raise ValueError
        return rows

    def parse_line(line: str, number: int) -> list[float]:
        fields = _split_fields(line, head.separator)
        expected = f"{separators + 1} fields separated by {between} were expected"
        text.refuse(len(fields) != separators + 1, f"{expected}, got {len(fields)}", number)
        values = []
        for i in indices:
            word = fields[i].strip()
            if re.fullmatch(_FORTRAN, word, re.I):
                word = word.lower().replace("d", "e")
            values.append(text.parse_number(word, number, f"column {head.names[i]!r}"))
        return values

    values = text.read_values(head.top, parse_quickly, parse_line)
    values = values.reshape(-1, len(indices)).T
    samples = values.shape[1]
    text.refuse(samples < 2, f"at least two samples were expected, got {samples}")
    return values


def _find_last_word(head: _TableHead, line: str) -> str:
    """Find the last field of a line of numbers."""
    return line.rpartition(head.separator)[2].strip(' "')


def _split_fields(line: str, separator: str) -> list[str]:
    """Split a line into its fields; none if it cannot be, which no caller expects."""
    # For example a field of more than 131,072 characters raises an error.
    try:
        reader = csv.reader([line], delimiter=separator, skipinitialspace=True)
        return next(reader) or [""]
    except csv.Error:
        return []


def _find_step(
    text: RecordText,
    head: _TableHead,
    name: str,
    seconds: float,
    times: np.ndarray,
    stated: Statements,
) -> float:
    """Find the step [s] of a column of times; an error names the first line that differs."""
    steps = np.diff(times)
    # The median, so that the error names the odd step, not all others.
    usual = float(np.median(steps))
    differs = abs(steps - usual) > UNIFORM * usual
    if (steps > 0).all() and not differs.any():
        # The mean, whose error by printed digits falls with the number of steps.
        return seconds * float(times[-1] - times[0]) / steps.size
    # Few digits may be printed: a step that is stated explains them, or one that they tell.
    index = head.names.index(name)
    lines = text.lines[head.top :]
    sample = lines[:: 1 + len(lines) // _MANY_LINES]
    words = [_split_fields(line, head.separator)[index] for line in sample]
    halves = find_printed_halves(words, times)
    for _, _, step in stated:
        if explain_times(times, halves, step / seconds):
            return step
    found = find_printed_step(times, halves)
    if found is not None:
        return seconds * found
    reason = f"must have a uniform step, mostly {seconds * usual:.6g} s"
    faulty = differs
    if (steps <= 0).any():
        reason = "must increase"
        faulty = steps <= 0
    at = int(np.argmax(faulty))
    got = f"got {seconds * times[at]} and then {seconds * times[at + 1]}"
    raise text.make_error(f"column {name!r} {reason}, {got}", head.top + at + 2)
