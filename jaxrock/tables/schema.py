"""Schemas: which columns a table has, what their units measure, and what their cells may be."""

import math
import os
from collections.abc import Mapping
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

    @property
    def is_number(self) -> bool:
        """Whether it has numbers."""
        return self.dimension not in ("text", "flag")

    @property
    def allowed(self) -> str:
        """What its cells must be, in words."""
        words = {"text": "given in each row", "flag": "yes or no"}
        return words.get(self.dimension, self.domain.allowed)


class Contents(NamedTuple):
    """What a table holds: the values of all known columns by name, and unknown columns as words.

    Numbers are in SI. A cell or a column that is missing has NaN, False or an empty word.
    """

    table: Table
    values: dict[str, np.ndarray]
    others: dict[str, list[str]]

    def require(self, valid: np.ndarray, reason: str) -> None:
        """Raise a `ValueError` with a line for each row that is not valid."""
        lines = [self.table.rows[k].line for k in np.flatnonzero(~valid)]
        _raise_faults(self.table, [(line, reason) for line in lines])


def read_table(path: str | os.PathLike[str], columns: Mapping[str, Column]) -> Contents:
    """Read a table of known columns.

    Raises
    ------
    ValueError
        With file and line, of all rows with a value that is missing, not understood or out of its
        domain; of a column that is there twice, that states no unit or another one, or that is
        unknown but one letter away from one that is not there.
    """
    required = [name for name, column in columns.items() if column.required]
    printed = ", ".join(_print_head(name, columns[name].dimension) for name in required)
    table = Table(
        TextFile(path),
        lambda heads: {*required} <= {_find_name(head, columns) for head in heads},
        f"a line with the columns {printed}",
    )
    return read_columns(table, columns)


def read_columns(table: Table, columns: Mapping[str, Column]) -> Contents:
    """Read the known columns of a table; errors as in `read_table`."""
    places = _find_columns(table, columns)
    rows = table.rows
    if not rows:
        raise table.error("at least one row was expected below the heads")
    values: dict[str, np.ndarray] = {}
    faults: list[tuple[int, str]] = []
    for name, column in columns.items():
        place = places.get(name)
        cells = ["" if place is None else row.cells[place] for row in rows]
        head = Head(name, name) if place is None else table.heads[place]
        values[name], valid = _convert_cells(table, cells, column, head)
        faults += [
            (
                rows[k].line,
                f"column {quote_word(head.words)} must be {column.allowed}, got {cells[k]!r:.60}",
            )
            for k in np.flatnonzero(~valid)
        ]
    _raise_faults(table, faults)
    table.require_one_decimal_sign([places[n] for n in places if columns[n].is_number])
    others = {
        head.words: [row.cells[place] for row in rows]
        for place, head in enumerate(table.heads)
        if head.words and place not in places.values()
    }
    return Contents(table, values, others)


def _convert_cells(
    table: Table, cells: list[str], column: Column, head: Head
) -> tuple[np.ndarray, np.ndarray]:
    """Convert the cells of a column; return the values, and which of them are valid."""
    is_given = np.array([cell != "" for cell in cells]) | (not column.required)
    if column.dimension == "text":
        return np.array(cells, dtype=object), is_given
    if not column.is_number:
        flags = [_FLAGS.get(cell.lower()) for cell in cells]
        return np.array(flags, dtype=bool), is_given & [flag is not None for flag in flags]
    numbers = [table.parse_number(cell) if cell else math.nan for cell in cells]
    values = np.array(numbers, dtype=float) * (head.unit.factor if head.unit else 1.0)
    # Programs write NaN for what is missing.
    is_missing = np.isnan(values) & [number is not None for number in numbers]
    return values, is_given & (
        column.domain.contains(values) | (is_missing & (not column.required))
    )


def _raise_faults(table: Table, faults: list[tuple[int, str]]) -> None:
    """Raise a `ValueError` that names the first faults, with their lines, if there are any."""
    if faults:
        errors = [str(table.text.error(reason, line)) for line, reason in sorted(faults)]
        raise ValueError("\n".join(errors[:_MAX_FAULTS]))


def _find_columns(table: Table, columns: Mapping[str, Column]) -> dict[str, int]:
    """Find the place of each column that is there."""
    places: dict[str, int] = {}
    for place, head in enumerate(table.heads):
        name = _find_name(head, columns)
        if name in places:
            raise table.error(f"column {quote_word(head.words)}: {name!r} is there already")
        if name:
            places[name] = place
            _require_unit(table, head, name, columns[name].dimension)
    # A misspelled name must not be passed over. Beside a height there may be a weight.
    absent = [
        (name, *column.synonyms) for name, column in columns.items() if name not in places
    ]
    known = [word for words in absent for word in words if len(word) >= _SHORTEST]
    for place, head in enumerate(table.heads):
        near = [word for word in known if _is_one_letter_away(head.name.lower(), word)]
        if near and place not in places.values():
            words = quote_word(head.words)
            raise table.error(f"column {words} is unknown: is {near[0]!r} meant?")
    return places


def _require_unit(table: Table, head: Head, name: str, dimension: str) -> None:
    """Raise a `ValueError` if a column states no unit, or one of something else."""
    stated = head.unit.dimension if head.unit else ""
    example = _print_head(name, dimension)
    if stated != dimension and (head.unit or example != name):
        raise table.error(f"column {quote_word(head.words)} was expected as {example!r}")


def _find_name(head: Head, columns: Mapping[str, Column]) -> str:
    """Find the column that a head names; empty for none."""
    plain = head.name.lower()
    return next((n for n, c in columns.items() if plain == n or plain in c.synonyms), "")


def _print_head(name: str, dimension: str) -> str:
    """Print the head of a column with an example of its unit."""
    unit = next((unit for unit in _EXAMPLES if parse_unit(unit).dimension == dimension), "")
    return f"{name} [{unit}]" if unit else name


def _is_one_letter_away(word: str, known: str) -> bool:
    """Return whether a letter is added, missing or another one, or exchanged with the next."""
    alike = [a == b for a, b in zip(word, known, strict=False)]
    k = [*alike, False].index(False)
    end, right = word[k:], known[k:]
    is_exchanged = end[1::-1] + end[2:] == right
    return end[1:] == right[1:] or end[1:] == right or end == right[1:] or is_exchanged
