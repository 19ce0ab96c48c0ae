"""Schemas: which columns a table has, what their units measure, and what their cells may be."""

import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..validation import Domain
from .table import Head, Row, Table
from .text import TextFile, quote_word

_FLAGS = {
    **dict.fromkeys(("yes", "true", "1", "x", "overturned"), True),
    **dict.fromkeys(("no", "false", "0", "stood", ""), False),
}
# An example of each dimension, for messages.
_EXAMPLES = {"length": " [m]", "time": " [s]", "angle": " [rad]", "acceleration": " [m/s2]"}
_MAX_FAULTS = 20  # that one error names


class Column(NamedTuple):
    """A column of a table.

    Attributes
    ----------
    dimension : str
        What its unit measures, as in `Unit`; "text" or "flag" for words.
    domain : Domain, optional
        What numbers may be, in SI; an empty cell is NaN.
    required : bool
        Whether there must be such a column, with something in each row.
    synonyms : tuple of str
        Other names of it.
    """

    dimension: str = "text"
    domain: Domain | None = None
    required: bool = False
    synonyms: tuple[str, ...] = ()


class Contents(NamedTuple):
    """What a table holds: values of its columns by name, and the line of each row.

    Numbers are arrays in SI, flags and words lists. `others` are unknown columns, as words.
    """

    table: Table
    values: dict[str, np.ndarray]
    lines: list[int]
    others: dict[str, list[str]]

    def error(self, reason: str, row: int) -> ValueError:
        """Make an error about a row."""
        return self.table.text.error(reason, self.lines[row])


def read_table(path: str | os.PathLike[str], columns: Mapping[str, Column]) -> Contents:
    """Read a table of known columns.

    Raises
    ------
    ValueError
        With file and line, of all rows with a value that is missing, not understood or out of its
        domain; of a column that is there twice, that states no unit or another one, or that is
        unknown but one letter away from a known one.
    """
    required = [name for name, column in columns.items() if column.required]
    expected = f"a line with the columns {', '.join(_print_head(n, columns[n]) for n in required)}"
    table = Table(
        TextFile(path),
        lambda heads: {*required} <= {_find_name(head, columns) for head in heads},
        expected,
    )
    places, others = _find_columns(table, columns)
    faults: list[str] = []
    values: dict[str, np.ndarray] = {}
    for name, place in places.items():
        cells = []
        for row in table.rows:
            try:
                cells.append(_read_cell(table, row, place, columns[name]))
            except ValueError as error:
                faults.append(str(error))
        values[name] = np.array(cells, dtype=object if columns[name].dimension == "text" else None)
    numbers = [places[n] for n in values if columns[n].dimension not in ("text", "flag")]
    if not faults:
        table.require_one_decimal_sign(numbers)
    if faults:
        raise ValueError("\n".join(faults[:_MAX_FAULTS]))
    words = {table.heads[k].words: [row.cells[k] for row in table.rows] for k in others}
    return Contents(table, values, [row.line for row in table.rows], words)


def _find_columns(
    table: Table, columns: Mapping[str, Column]
) -> tuple[dict[str, int], list[int]]:
    """Find the place of each column that is there, and the places of others."""
    places: dict[str, int] = {}
    others = []
    known = [name for key, column in columns.items() for name in (key, *column.synonyms)]
    for place, head in enumerate(table.heads):
        name = _find_name(head, columns)
        printed = f"column {quote_word(head.words)}"
        if not name:
            near = next((n for n in known if _is_one_letter_away(head.name.lower(), n)), "")
            if near:
                raise table.error(f"{printed} is unknown: is {near!r} meant?")
            others.append(place)
            continue
        if name in places:
            raise table.error(f"{printed}: a column {name!r} is there already")
        dimension = columns[name].dimension
        stated = head.unit.dimension if head.unit else ""
        needs_unit = dimension not in ("text", "flag", "ratio")
        if stated != dimension and (needs_unit or head.unit):
            allowed = f"its unit, as in {_print_head(name, columns[name])!r}" if needs_unit else "no unit"
            raise table.error(f"{printed}: {allowed} was expected")
        places[name] = place
    return places, others


def _find_name(head: Head, columns: Mapping[str, Column]) -> str:
    """Find the column that a head names; empty for none."""
    plain = head.name.lower()
    return next((n for n, c in columns.items() if plain == n or plain in c.synonyms), "")


def _print_head(name: str, column: Column) -> str:
    """Print the head of a column with an example of its unit."""
    return f"{name}{_EXAMPLES.get(column.dimension, '')}"


def _read_cell(table: Table, row: Row, place: int, column: Column) -> str | bool | float:
    """Read a cell; a `ValueError` that names line and column if it is not allowed."""
    cell = row.cells[place]
    head = table.heads[place]
    allowed = "yes or no" if column.dimension == "flag" else "something"
    if column.required and not cell:
        allowed = f"{allowed} in each row"
    elif column.dimension == "text":
        return cell
    elif column.dimension == "flag":
        if (flag := _FLAGS.get(cell.lower())) is not None:
            return flag
    else:
        number = table.parse_number(cell) if cell else np.nan
        value = np.nan if number is None else number * (head.unit.factor if head.unit else 1.0)
        if not cell or (number is not None and (not column.domain or column.domain.contains(np.asarray(value)))):
            return value
        allowed = column.domain.allowed if column.domain and number is not None else "a number"
    raise table.text.error(
        f"column {quote_word(head.words)} must have {allowed}, got {quote_word(cell)}", row.line
    )


def _is_one_letter_away(word: str, known: str) -> bool:
    """Return whether one letter was left out, added, replaced, or exchanged with the next."""
    k = len(os.path.commonprefix([word, known]))
    is_swapped = word[k : k + 2] == known[k : k + 2][::-1] and word[k + 2 :] == known[k + 2 :]
    ends = (word[k + 1 :], known[k:]), (word[k:], known[k + 1 :]), (word[k + 1 :], known[k + 1 :])
    return word != known and (is_swapped or any(a == b for a, b in ends))
