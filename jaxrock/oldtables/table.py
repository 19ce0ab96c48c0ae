"""Tables in text files: names of columns, numbers, and what stands above them.

Python's own ``csv`` splits the lines, since it says in which line of the file a row stands, and
pandas does not; the bulk of the numbers is read by NumPy. What is not read is refused with the
line.
"""

import math
import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ..host import show_progress
from .cut import require_whole_end
from .heads import Head, read_head
from .layout import find_layout
from .rows import DECIMAL_COMMA, SEPARATORS, Row, is_comment, split_line, split_lines
from .text import TextFile, as_number, quote_word

_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[ed][-+]?\d+)?", re.I)
_PERHAPS_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")
# As many are enough to see how numbers are printed.
_LAST_LINES = 1000


class Table:
    """A table of a text file.

    Attributes
    ----------
    text : TextFile
        The file, whose `error` names it.
    heads : tuple of Head
        What the columns are; empty if they have no names.
    line : int
        Line of the names, or the first one if there are none.
    notes : list of (int, str)
        All comments of the file, and the titles above the names, with their line numbers.
    separator : str
        The character between two cells.
    """

    def __init__(self, text: TextFile):
        """Find the layout of a table, and read its heads."""
        self.text = text
        names, self.line, self.notes, self.separator, self._top = find_layout(text)
        self.heads: tuple[Head, ...] = tuple(map(read_head, names))

    @property
    def names(self) -> list[str]:
        """The names of the columns as they are printed."""
        return [head.words for head in self.heads]

    @cached_property
    def rows(self) -> list[Row]:
        """The rows, without empty lines and comments; an error if one has too many cells."""
        rows = [*split_lines(self.text, self._top, self.separator)]
        width = len(self.heads)
        for line, comment in self.notes:
            # A name may begin with #, as #12 of a catalogue.
            is_row = width > 1 and len(split_line(comment, self.separator)) == width
            if is_row and line > self.line and re.match(r"#\w", comment):
                raise self.text.error(
                    f"{quote_word(comment)} is a comment, but looks like a row: write '# ' if it"
                    " is one, and quotes around a name that begins with #",
                    line,
                )
        for row in rows:
            # Spreadsheets end lines with separators of empty cells.
            while width and len(row.cells) > width and not row.cells[-1]:
                del row.cells[-1]
            if width and len(row.cells) > width:
                raise self.error_of_width(row)
        # Tabs at the end of the file are taken for blanks, as they may be.
        if rows and self.separator == "\t" and self.text.ends:
            rows[-1].cells.extend([""] * (width - len(rows[-1].cells)))
        return rows

    @cached_property
    def decimal(self) -> str:
        """The sign before decimals; an error if both occur, or if it may be of thousands."""
        # Names may be numbers with points, as of catalogues, whatever stands before decimals.
        words = ("name", "file", "group")
        named = {k for k, head in enumerate(self.heads) if head.quantity in words}
        cells = [
            (cell, row.line)
            for row in self.rows
            for column, cell in enumerate(row.cells)
            if column not in named
        ]
        commas = [pair for pair in cells if DECIMAL_COMMA.fullmatch(pair[0])]
        points = [pair for pair in cells if _DECIMAL_POINT.fullmatch(pair[0])]
        if commas and points:
            raise self.text.error(
                f"decimals must all stand behind points or all behind commas, got"
                f" {commas[0][0]!r} in line {commas[0][1]} and {points[0][0]!r}",
                points[0][1],
            )
        # Where semicolons separate cells, points separate thousands in many languages.
        doubtful = points if self.separator == ";" and not commas else commas
        if doubtful and all(_PERHAPS_THOUSANDS.fullmatch(cell) for cell, _ in doubtful):
            cell, line = doubtful[0]
            raise self.text.error(
                f"{cell!r} may be a number with decimals, or one of thousands: write numbers"
                " with decimal points and without separators of thousands, cells separated by"
                " commas",
                line,
            )
        return "," if commas else "."

    def error_of_width(self, row: Row) -> ValueError:
        """Make the error that a row has another number of cells than there are names."""
        expected = f"{len(self.heads)} fields separated by {SEPARATORS[self.separator]}"
        return self.text.error(f"{expected} were expected, got {len(row.cells)}", row.line)

    def parse_number(self, row: Row, column: int) -> float | None:
        """Convert a cell to a number, NaN and infinity among them; None if it is none."""
        cell = row.cells[column] if column < len(row.cells) else ""
        # Behind semicolons a point may separate thousands, which `decimal` refuses.
        if ("," in cell or self.separator == ";") and self.decimal == ",":
            cell = cell.replace(",", ".", 1)
        return as_number(cell)

    def read_samples(self, columns: Sequence[int]) -> np.ndarray:
        """Read columns of finite numbers, in all lines to the end; of shape (columns, rows)."""
        values = self._read_quickly(columns)
        if values is None:
            rows = show_progress(self.rows, f"reading {self.text.path.name}")
            numbers = [self._require_number(row, column) for row in rows for column in columns]
            values = np.array(numbers).reshape(-1, len(columns))
            first = self.rows[0].line if self.rows else self._top + 1
            for number, line in enumerate(self.text.lines[first - 1 :], first):
                # A line that is missing would shift all samples that follow.
                if not line.strip():
                    raise self.error_of_width(Row(number, [""]))
                if is_comment(line):
                    raise self.text.error(
                        f"samples were expected up to the end, got a comment, {quote_word(line)}",
                        number,
                    )
        self.refuse_cut()
        return values.T

    def refuse_cut(self) -> None:
        """Refuse a file that is cut within the last number of its last row."""
        if self.text.ends or is_comment(self.text.lines[-1]):
            return
        top = max(self._top, len(self.text.lines) - _LAST_LINES)
        rows = [*split_lines(self.text, top, self.separator)]
        # Rows may be shorter than others: a number is compared with those above it.
        end = len(rows[-1].cells) - 1 if rows else 0
        words = [row.cells[end] for row in rows if len(row.cells) > end]
        if self.separator != ",":
            words = [word.replace(",", ".") for word in words]
        require_whole_end(self.text, words)

    def _read_quickly(self, columns: Sequence[int]) -> np.ndarray | None:
        """Read columns of plain numbers; None if anything is unusual."""
        lines = self.text.lines[self._top :]
        # Behind semicolons a point may be of thousands. With quotes, or with fields missing in
        # some lines, `loadtxt` would not always raise: it does for a missing last one that is
        # wanted, and the sum shows that none is too many.
        between = len(self.heads) - 1
        separator = self.separator
        if separator in " ;" or not lines or '"' in self.text.content:
            return None
        if between in columns:
            number = self.text.content.count(separator)
            number -= sum(line.count(separator) for line in self.text.lines[: self._top])
            if number != between * len(lines):
                return None
        elif any(line.count(separator) != between for line in lines):
            return None
        try:
            rows = np.loadtxt(
                lines, delimiter=separator, comments=None, usecols=columns, ndmin=2
            )
        except ValueError:
            return None
        # It passes over empty lines, which samples must not have.
        return rows if len(rows) == len(lines) and np.isfinite(rows).all() else None

    def _require_number(self, row: Row, column: int) -> float:
        """Convert a cell of a row that has all of them to a finite number."""
        if len(row.cells) != len(self.heads):
            raise self.error_of_width(row)
        number = self.parse_number(row, column)
        if number is not None and math.isfinite(number):
            return number
        # What is no finite number with a decimal comma is none without it.
        return self.text.parse_number(
            row.cells[column], row.line, f"column {self.names[column]!r}"
        )


def read_table(source: Path | TextFile) -> Table:
    """Read a table whose fields are separated by commas, semicolons, tabs, bars or blanks.

    Lines that begin with # are comments; the last one above numbers may have the names of the
    columns, as NumPy writes it. Above the names other lines may stand, below them units.
    """
    return Table(source if isinstance(source, TextFile) else TextFile(source))
