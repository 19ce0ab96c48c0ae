"""Schemas: which columns a table has, what their units measure, and what their cells may be."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..validation import FINITE, Domain
from .table import Head, Table
from .text import TextFile, quote_word

_FLAGS: dict[str, bool] = dict.fromkeys(("yes", "true", "1", "x", "overturned"), True)
_FLAGS |= dict.fromkeys(("no", "false", "0", "stood", ""), False)
# Of each dimension that has to be stated, for messages.
_EXAMPLES = {"length": "m", "time": "s", "angle": "rad", "rate": "1/yr", "years": "yr"}
_EXAMPLES |= {"acceleration": "m/s2", "velocity": "m/s"}
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

    def find(self, name: str, heads: Sequence[Head]) -> list[int]:
        """Find the positions of the column, which has one name or more."""
        names = (name, *self.synonyms)
        return [k for k, head in enumerate(heads) if head.name.lower() in names]

    def print_head(self, name: str) -> str:
        """Print the head of the column with an example of its unit."""
        unit = _EXAMPLES.get(self.dimension)
        return f"{name} [{unit}]" if unit else name


class Contents(NamedTuple):
    """What a table holds: the values of all known columns by name, and unknown columns as words.

    Numbers are in SI. A cell or a column that is missing has NaN, False or an empty word.
    """

    table: Table
    values: dict[str, np.ndarray]
    others: dict[str, list[str]]

    def require(self, valid: np.ndarray, reason: str, cells: Sequence[str] = ()) -> None:
        """Raise a `ValueError` with a line for each row that is not valid, and perhaps its cell."""
        reasons = [f"{reason}, got {cell!r:.60}" for cell in cells] or [reason] * valid.size
        faults = [(reasons[k], self.table.rows[k].line) for k in np.flatnonzero(~valid)]
        if faults:
            raise ValueError("\n".join(str(self.table.text.error(*fault)) for fault in faults))


def read_table(path: str | os.PathLike[str], columns: Mapping[str, Column]) -> Contents:
    """Read a table of known columns.

    Raises
    ------
    ValueError
        With file and line, of all rows with a value that is missing, not understood or out of the
        domain of a column; of a column that is there twice, that states no unit or another one.
    """
    required = {name: column for name, column in columns.items() if column.required}
    printed = ", ".join(column.print_head(name) for name, column in required.items())
    table = Table(
        TextFile(path),
        lambda heads: all(column.find(name, heads) for name, column in required.items()),
        f"a line with the columns {printed}",
    )
    return read_columns(table, columns)


def read_columns(table: Table, columns: Mapping[str, Column]) -> Contents:
    """Read the known columns of a table; errors as in `read_table`."""
    if not table.rows:
        raise table.error("at least one row was expected below the heads")
    texts = np.array([row.cells for row in table.rows], dtype=object).T
    contents = Contents(table, {}, {})
    unknown = {k for k, head in enumerate(table.heads) if head.label}
    for name, column in columns.items():
        head, cells = Head(name, name), [""] * len(table.rows)
        positions = column.find(name, table.heads)
        if len(positions) > 1:
            raise table.error(f"column {name!r} is there twice")
        for position in positions:
            head, cells = table.heads[position], texts[position].tolist()
            unknown.discard(position)
            expected = column.print_head(name)
            dimension = head.unit.dimension if head.unit else ""
            if dimension != column.dimension and (head.unit or expected != name):
                raise table.error(f"{quote_word(head.label)} was expected as {expected!r}")
        values = [_convert_cell(table, cell, column, head) for cell in cells]
        pairs = zip(values, cells, strict=True)
        valid = [v is not None and (c != "" or not column.required) for v, c in pairs]
        allowed = _ALLOWED.get(column.dimension, column.domain.allowed)
        reason = f"column {quote_word(head.label)} must be {allowed}"
        contents.require(np.array(valid), reason, cells)
        contents.values[name] = np.array(values)
    for position in sorted(unknown):
        contents.others[table.heads[position].label] = texts[position].tolist()
    return contents


def _convert_cell(
    table: Table, cell: str, column: Column, head: Head
) -> str | bool | np.ndarray | None:
    """Convert a cell; None if it is not understood, or out of the domain."""
    if column.dimension == "text":
        return cell
    if column.dimension == "flag":
        return _FLAGS.get(cell.lower())
    number = table.parse_number(cell) if cell else math.nan
    if number is None:
        return None
    value = np.asarray(number * (head.unit.factor if head.unit else 1.0))
    # Programs write NaN for what is missing.
    return value if np.isnan(value) or column.domain.contains(value) else None
