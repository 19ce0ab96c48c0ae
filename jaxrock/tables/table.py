"""Tables as spreadsheets save them: a line of heads, rows below it, titles and comments above.

A head is a name and perhaps its unit in brackets, ``width [cm]`` or ``width (cm)``. The line of
heads is the first one that has all columns that are needed; what stands above it is not read, and
neither are lines that begin with #. Cells are separated by the semicolons, tabs or commas of the
line of heads. Beside semicolons and tabs, decimals may stand behind commas.
"""

import csv
import math
import re
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .text import TextFile, as_number, normalize, quote_word
from .units import Unit, parse_unit

_HEAD = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]")


class Head(NamedTuple):
    """A column as its head describes it: as printed, its name, and its unit if any."""

    label: str
    name: str
    unit: Unit | None = None


class Row(NamedTuple):
    """A row of a table: its line, and its cells."""

    line: int
    cells: list[str]


def read_head(label: str) -> Head:
    """Split the head of a column into its name, with blanks for underscores, and its unit."""
    plain = " ".join(normalize(label).replace("_", " ").split())
    match = _HEAD.fullmatch(plain)
    return Head(label, match[1], parse_unit(match[2])) if match else Head(label, plain)


class Table:
    """A table of a text file.

    Attributes
    ----------
    text : TextFile
        The file, whose `error` names it.
    heads : list of Head
    line : int
        Line of the heads.
    separator : str
        The character between two cells.
    """

    def __init__(self, text: TextFile, is_head: Callable[[list[Head]], bool], expected: str):
        """Find the line of heads; a `ValueError` that says what was `expected` if none is."""
        self.text = text
        for self.line, content in enumerate(text.lines, 1):
            self.separator = next((sign for sign in ";\t," if sign in content), ",")
            self.heads = [*map(read_head, self._split_line(self.line))]
            if self.heads and is_head(self.heads):
                return
        raise text.error(f"{expected} was expected, got {quote_word(text.lines[0])}", 1)

    def error(self, reason: str) -> ValueError:
        """Make an error about the heads."""
        return self.text.error(reason, self.line)

    @cached_property
    def rows(self) -> list[Row]:
        """The rows, without comments and without rows of empty cells; all of the same width."""
        width = len(self.heads)
        lines = range(self.line + 1, len(self.text.lines) + 1)
        rows = [Row(line, self._split_line(line, width)) for line in lines]
        rows = [row for row in rows if any(row.cells)]
        for line, cells in rows:
            if len(cells) != width:
                raise self.text.error(f"{width} cells were expected, got {len(cells)}", line)
        return rows

    def _split_line(self, line: int, width: int = 1) -> list[str]:
        """Split a line into cells, `width` of which may be empty at the end; none of a comment."""
        content = self.text.lines[line - 1]
        if content.lstrip().startswith("#"):
            return []
        reader = csv.reader([content], delimiter=self.separator, skipinitialspace=True)
        cells = [cell.strip() for cell in next(reader, [])]
        # Spreadsheets end lines with separators of empty cells.
        while len(cells) > width and not cells[-1]:
            del cells[-1]
        return cells

    def parse_number(self, cell: str) -> float | None:
        """Convert a cell to a number, NaN and infinity among them; None if it is none."""
        if self.separator != "," and "." not in cell:
            cell = cell.replace(",", ".", 1)
        return as_number(cell)

    def read_samples(self, columns: Sequence[int]) -> np.ndarray:
        """Read columns of finite numbers, in all lines to the end; of shape (columns, rows)."""
        rows = self.rows
        samples = [[self.require_number(row, k) for row in rows] for k in columns]
        # A row without a sample is not left out as in other tables.
        if not 1 < len(rows) == rows[-1].line - rows[0].line + 1:
            raise self.error("samples were expected in all lines, and at least two")
        return np.array(samples)

    def require_number(self, row: Row, column: int) -> float:
        """Convert a cell to a finite number; an error that names the column if it is none."""
        number = self.parse_number(row.cells[column])
        if number is None or not math.isfinite(number):
            seen = f"column {self.heads[column].label!r} must have a finite number"
            raise self.text.error(f"{seen}, got {quote_word(row.cells[column])}", row.line)
        return number
