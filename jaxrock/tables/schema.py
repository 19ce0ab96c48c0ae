"""Schemas: which columns a table has, what their units measure, and what their cells may be."""

import math
import os
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..validation import FINITE, Domain
from .table import Head, Table
from .text import TextFile, quote_word
from .units import parse_unit

_FLAGS = {
    **dict.fromkeys(("yes", "true", "1", "x", "overturned"), True),
    **dict.fromkeys(("no", "false", "0", "stood", ""), False),
}
# Of each dimension that has to be stated, for messages.
_EXAMPLES = ("m", "s", "rad", "m/s2", "m/s", "1/yr", "yr")
# What cells of words must be.
_ALLOWED = {"text": "given in each row", "flag": "yes or no"}
_MAX_FAULTS = 20  # that one error names
_SHORTEST = 4  # letters of a name of which another word may be a misspelling


class Column(NamedTuple):
    """A column of a table.

    Attributes
    ----------
    dimension : str
        What its unit measures, as in `Unit`; "text" or "flag" for words.
    domain : Domain
        What numbers may be, in SI. Where they are not required, they may be missing.
    required : bool
        Whether there must be such a column, with something in each row.
    synonyms : tuple of str
        Other names of it.
    """

    dimension: str = "text"
    domain: Domain = FINITE
    required: bool = False
    synonyms: tuple[str, ...] = ()


class Contents(NamedTuple):
    """What a table holds: the values of all known columns by name, and unknown columns as words.

    Numbers are in SI. A cell or a column that is missing has NaN, False or an empty word.
    """

    table: Table
    values: dict[str, np.ndarray]
    others: dict[str, list[str]]

    def require(self, valid: np.ndarray, reason: str, cells: Sequence[str] = ()) -> None:
        """Raise a `ValueError` with a line for each row that is not valid, and perhaps its cell."""
        rows = self.table.rows
        faults = [
            self.table.text.error(f"{reason}, got {cells[k]!r:.60}" if cells else reason, line)
            for k, (line, _) in enumerate(rows)
            if not valid[k]
        ]
        if faults:
            raise ValueError("\n".join(map(str, faults[:_MAX_FAULTS])))


def read_table(path: str | os.PathLike[str], columns: Mapping[str, Column]) -> Contents:
    """Read a table of known columns.

    Raises
    ------
    ValueError
        With file and line, of all rows with a value that is missing, not understood or out of the
        domain of a column; of a column that is there twice, that states no unit or another one,
        or that is unknown but one letter away from one that is not there.
    """
    required = {name: column for name, column in columns.items() if column.required}
    printed = ", ".join(_print_head(*item) for item in required.items())
    table = Table(
        TextFile(path),
        lambda heads: required.keys() <= {_find_name(head, columns) for head in heads},
        f"a line with the columns {printed}",
    )
    return read_columns(table, columns)


def read_columns(table: Table, columns: Mapping[str, Column]) -> Contents:
    """Read the known columns of a table; errors as in `read_table`."""
    positions = _find_columns(table, columns)
    rows = table.rows
    if not rows:
        raise table.error("at least one row was expected below the heads")
    others: dict[str, list[str]] = {}
    for position, head in enumerate(table.heads):
        if head.label and position not in positions.values():
            # A second column of the same name is kept as well.
            label = f"{head.label} ({position + 1})" if head.label in others else head.label
            others[label] = [row.cells[position] for row in rows]
    contents = Contents(table, {}, others)
    for name, column in columns.items():
        position = positions.get(name)
        head = Head(name, name) if position is None else table.heads[position]
        cells = ["" if position is None else row.cells[position] for row in rows]
        factor = head.unit.factor if head.unit else 1.0
        contents.values[name], valid = _convert_cells(table, cells, column, factor)
        valid &= np.array([cell != "" for cell in cells]) | (not column.required)
        allowed = _ALLOWED.get(column.dimension, column.domain.allowed)
        contents.require(valid, f"column {quote_word(head.label)} must be {allowed}", cells)
    numbers = [k for name, k in positions.items() if columns[name].dimension not in _ALLOWED]
    table.require_one_decimal_sign(numbers)
    return contents


def _convert_cells(
    table: Table, cells: list[str], column: Column, factor: float
) -> tuple[np.ndarray, np.ndarray]:
    """Convert the cells of a column; return the values, and which of them are understood."""
    if column.dimension == "text":
        return np.array(cells, dtype=object), np.ones(len(cells), bool)
    if column.dimension == "flag":
        flags = [_FLAGS.get(cell.lower()) for cell in cells]
        return np.array(flags, dtype=bool), np.array([flag is not None for flag in flags])
    numbers = [table.parse_number(cell) if cell else math.nan for cell in cells]
    values = factor * np.array(numbers, dtype=float)
    # Programs write NaN for what is missing.
    is_missing = np.isnan(values) & [number is not None for number in numbers]
    valid = column.domain.contains(values) | (is_missing & (not column.required))
    return values, np.asarray(valid)


def _find_columns(table: Table, columns: Mapping[str, Column]) -> dict[str, int]:
    """Find the position of each column that is there."""
    positions: dict[str, int] = {}
    for position, head in enumerate(table.heads):
        name = _find_name(head, columns)
        if name in positions:
            raise table.error(f"column {quote_word(head.label)}: {name!r} is there already")
        if name:
            positions[name] = position
            _require_unit(table, head, name, columns[name])
    # A misspelled name must not be passed over. Beside a height there may be a weight.
    absent = [(name, *columns[name].synonyms) for name in columns if name not in positions]
    known = [name for names in absent for name in names if len(name) >= _SHORTEST]
    for head in table.heads:
        # Of a bracket without its other one, the name in front of it.
        parts = _drop_letters(re.split(r"[\[(]", head.name.lower())[0].strip())
        near = [name for name in known if parts & _drop_letters(name)]
        if near and not _find_name(head, columns):
            label = quote_word(head.label)
            raise table.error(f"column {label} is unknown: is {near[0]!r} meant?")
    return positions


def _require_unit(table: Table, head: Head, name: str, column: Column) -> None:
    """Raise a `ValueError` if a column states no unit, or one of something else."""
    stated = head.unit.dimension if head.unit else ""
    example = _print_head(name, column)
    if stated != column.dimension and (head.unit or example != name):
        raise table.error(f"column {quote_word(head.label)} was expected as {example!r}")


def _find_name(head: Head, columns: Mapping[str, Column]) -> str:
    """Find the column that a head names; empty for none."""
    plain = head.name.lower()
    return next((n for n, c in columns.items() if plain == n or plain in c.synonyms), "")


def _print_head(name: str, column: Column) -> str:
    """Print the head of a column with an example of its unit."""
    unit = next((u for u in _EXAMPLES if parse_unit(u).dimension == column.dimension), "")
    return f"{name} [{unit}]" if unit else name


def _drop_letters(word: str) -> set[str]:
    """Return a word, and what is left of it without any one of its letters."""
    return {word, *(word[:k] + word[k + 1 :] for k in range(len(word)))}
