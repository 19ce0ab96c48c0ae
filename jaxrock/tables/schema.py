"""Schemas: which columns a table has, what their units measure, and what their cells may be."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..validation import FINITE, Domain
from .table import Head, Table
from .text import TextFile, quote_word
from .units import parse_unit

_FLAGS: dict[str, bool] = dict.fromkeys(("yes", "true", "1", "x", "overturned"), True)
_FLAGS |= dict.fromkeys(("no", "false", "0", "stood", ""), False)
# Of each dimension that has to be stated, for messages.
_EXAMPLES = ("m", "s", "rad", "m/s2", "m/s", "1/yr", "yr")
# What cells of words must be.
_ALLOWED = {"text": "given in each row", "flag": "yes or no"}


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
        faults = [
            self.table.text.error(f"{reason}, got {cells[k]!r:.60}" if cells else reason, line)
            for k, (line, _) in enumerate(self.table.rows)
            if not valid[k]
        ]
        if faults:
            raise ValueError("\n".join(map(str, faults)))


def read_table(path: str | os.PathLike[str], columns: Mapping[str, Column]) -> Contents:
    """Read a table of known columns.

    Raises
    ------
    ValueError
        With file and line, of all rows with a value that is missing, not understood or out of the
        domain of a column; of a column that is there twice, that states no unit or another one.
    """
    required = {name: column for name, column in columns.items() if column.required}
    printed = ", ".join(_print_head(*item) for item in required.items())
    table = Table(
        TextFile(path),
        lambda heads: all(_find_positions(heads, required).values()),
        f"a line with the columns {printed}",
    )
    return read_columns(table, columns)


def read_columns(table: Table, columns: Mapping[str, Column]) -> Contents:
    """Read the known columns of a table; errors as in `read_table`."""
    rows = table.rows
    if not rows:
        raise table.error("at least one row was expected below the heads")
    positions = _find_positions(table.heads, columns)
    known = {k for found in positions.values() for k in found}
    others = {
        head.label: [row.cells[position] for row in rows]
        for position, head in enumerate(table.heads)
        if head.label and position not in known
    }
    contents = Contents(table, {}, others)
    for name, column in columns.items():
        if len(positions[name]) > 1:
            raise table.error(f"column {name!r} is there twice")
        head, cells = Head(name, name), [""] * len(rows)
        for position in positions[name]:
            head, cells = table.heads[position], [row.cells[position] for row in rows]
            _require_unit(table, head, name, column)
        contents.values[name], valid = _convert_cells(table, cells, column, head)
        valid &= np.array([cell != "" for cell in cells]) | (not column.required)
        allowed = _ALLOWED.get(column.dimension, column.domain.allowed)
        contents.require(valid, f"column {quote_word(head.label)} must be {allowed}", cells)
    return contents


def _convert_cells(
    table: Table, cells: list[str], column: Column, head: Head
) -> tuple[np.ndarray, np.ndarray]:
    """Convert the cells of a column; return the values, and which of them are understood."""
    if column.dimension == "text":
        return np.array(cells, dtype=object), np.ones(len(cells), bool)
    if column.dimension == "flag":
        flags = [_FLAGS.get(cell.lower()) for cell in cells]
        return np.array(flags, dtype=bool), np.array([flag is not None for flag in flags])
    numbers = [table.parse_number(cell) if cell else math.nan for cell in cells]
    is_number = np.array([number is not None for number in numbers])
    values = (head.unit.factor if head.unit else 1.0) * np.array(numbers, dtype=float)
    # Programs write NaN for what is missing.
    return values, is_number & (column.domain.contains(values) | np.isnan(values))


def _find_positions(
    heads: Sequence[Head], columns: Mapping[str, Column]
) -> dict[str, list[int]]:
    """Find the positions of each column, which has one name or more."""
    names = [head.name.lower() for head in heads]
    return {
        name: [k for k, plain in enumerate(names) if plain in (name, *column.synonyms)]
        for name, column in columns.items()
    }


def _require_unit(table: Table, head: Head, name: str, column: Column) -> None:
    """Raise a `ValueError` if a column states no unit, or one of something else."""
    example = _print_head(name, column)
    dimension = head.unit.dimension if head.unit else ""
    if dimension != column.dimension and (head.unit or example != name):
        raise table.error(f"column {quote_word(head.label)} was expected as {example!r}")


def _print_head(name: str, column: Column) -> str:
    """Print the head of a column with an example of its unit."""
    unit = next((u for u in _EXAMPLES if parse_unit(u).dimension == column.dimension), "")
    return f"{name} [{unit}]" if unit else name
