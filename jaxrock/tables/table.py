"""Tables in text files: separators, names of columns, numbers, and what stands above them.

Python's own ``csv`` splits the lines, since it says in which line of the file a row stands; the
bulk of the numbers is read by NumPy. What is not read is refused with the line.
"""

import csv
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..host import show_progress
from .cut import require_whole_end
from .quantities import Head, read_head
from .text import TextFile, as_number, quote_word
from .units import parse_unit

# By the first line, as Excel understands it, or else the first that fits.
_SEPARATOR_LINE = re.compile(r'\s*"?sep=(?P<separator>[,;|\t]?)"?\s*', re.I)
_SEPARATORS = (";", "\t", "|", ",", " ")
_NAMES_OF_SEPARATORS = {
    ",": "commas",
    ";": "semicolons",
    "\t": "tabs",
    "|": "bars",
    " ": "blanks",
}
# As many lines tell how a table is laid out.
_SAMPLE = 30
# No text has it: within a cell it shows a quote that does not end.
_END = "\x01"
# As many are enough to see how numbers are printed.
_LAST_LINES = 1000

# As Fortran may write a number, with a letter that Python does not know.
_FORTRAN = re.compile(r"([-+]?(?:\d+[.,]?\d*|[.,]\d+))d([-+]?\d+)", re.I)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[ed][-+]?\d+)?", re.I)
_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[ed][-+]?\d+)?", re.I)
_PERHAPS_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")
# In a comment above numbers: a word, and perhaps its unit in brackets.
_NAME_IN_COMMENT = re.compile(r"[^\s\[\]()]+(?:\s*[\[(][^\[\]()]*[\])])?")
# A line above one column that is no name of it: "Time Step: 0.005", "dt = 0.01".
_STATEMENT = re.compile(r"[^:=]*[:=].*")


class Row(NamedTuple):
    """A row of a table: the line in which it begins, and its cells."""

    line: int
    cells: list[str]


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
        Comments and lines above the names, with the numbers of their lines.
    separator : str
        The character between two cells.
    """

    def __init__(
        self,
        text: TextFile,
        heads: Sequence[str],
        line: int,
        notes: list[tuple[int, str]],
        separator: str,
        top: int,
    ):
        """Describe a table whose rows begin after the line number `top`."""
        self.text = text
        self.heads: tuple[Head, ...] = tuple(map(read_head, heads))
        self.line = line
        self.notes = notes
        self.separator = separator
        self._top = top

    @property
    def names(self) -> list[str]:
        """The names of the columns as they are printed."""
        return [head.words for head in self.heads]

    @cached_property
    def rows(self) -> list[Row]:
        """The rows, without empty lines and comments; an error if one has too many cells."""
        rows = [*_split_lines(self.text, self._top, self.separator)]
        width = len(self.heads)
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
        named = {k for k, head in enumerate(self.heads) if head.quantity == "name"}
        cells = [
            (row.line, cell)
            for row in self.rows
            for column, cell in enumerate(row.cells)
            if column not in named
        ]
        commas = [pair for pair in cells if _DECIMAL_COMMA.fullmatch(pair[1])]
        points = [pair for pair in cells if _DECIMAL_POINT.fullmatch(pair[1])]
        if commas and points:
            raise self.text.error(
                f"decimals must all stand behind points or all behind commas, got"
                f" {commas[0][1]!r} in line {commas[0][0]} and {points[0][1]!r}",
                points[0][0],
            )
        # Where semicolons separate cells, points separate thousands in many languages.
        doubtful = points if self.separator == ";" and not commas else commas
        if doubtful and all(_PERHAPS_THOUSANDS.fullmatch(cell) for _, cell in doubtful):
            line, cell = doubtful[0]
            raise self.text.error(
                f"{cell!r} may be a number with decimals, or one of thousands: write numbers"
                " with decimal points and without separators of thousands, cells separated by"
                " commas",
                line,
            )
        return "," if commas else "."

    def error_of_width(self, row: Row) -> ValueError:
        """Make the error that a row has another number of cells than there are names."""
        between = _NAMES_OF_SEPARATORS[self.separator]
        expected = f"{len(self.heads)} fields separated by {between} were expected"
        return self.text.error(f"{expected}, got {len(row.cells)}", row.line)

    def parse_number(self, row: Row, column: int) -> float | None:
        """Convert a cell to a number, NaN and infinity among them; None if it is none."""
        cell = row.cells[column] if column < len(row.cells) else ""
        # Behind semicolons a point may separate thousands, which `decimal` refuses.
        if ("," in cell or self.separator == ";") and self.decimal == ",":
            cell = cell.replace(",", ".", 1)
        number = as_number(cell)
        if number is None and (fortran := _FORTRAN.fullmatch(cell)):
            number = as_number(f"{fortran[1]}e{fortran[2]}")
        return number

    def read_samples(self, columns: Sequence[int]) -> np.ndarray:
        """Read columns of finite numbers in all lines; of shape (columns, rows).

        Raises a `ValueError` with the line if one is no such number, if a line is empty, or if
        the file is cut within its last number.
        """
        lines = self.text.lines[self._top :]
        values = self._read_quickly(lines, columns)
        if values is None:
            rows = show_progress(self.rows, f"reading {self.text.path.name}")
            values = np.array([self._read_row(row, columns) for row in rows])
            values = values.reshape(-1, len(columns))
            first = self.rows[0].line if self.rows else self._top + 1
            for number, line in enumerate(self.text.lines[first - 1 :], first):
                # A line that is missing would shift all samples that follow.
                if not line.strip():
                    raise self.error_of_width(Row(number, [""]))
                if _is_comment(line):
                    raise self.text.error(
                        f"samples were expected up to the end, got a comment, {quote_word(line)}",
                        number,
                    )
        self.refuse_cut()
        return values.T

    def refuse_cut(self) -> None:
        """Refuse a file that is cut within the last number of its last row."""
        if self.text.ends or _is_comment(self.text.lines[-1]):
            return
        top = max(self._top, len(self.text.lines) - _LAST_LINES)
        rows = [*_split_lines(self.text, top, self.separator)]
        # Rows may be shorter than others: a number is compared with those above it.
        end = len(rows[-1].cells) - 1 if rows else 0
        words = [row.cells[end] for row in rows if len(row.cells) > end]
        if self.separator != ",":
            words = [word.replace(",", ".") for word in words]
        require_whole_end(self.text, words)

    def _read_quickly(self, lines: list[str], columns: Sequence[int]) -> np.ndarray | None:
        """Read columns of plain numbers; None if anything is unusual."""
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

    def _read_row(self, row: Row, columns: Sequence[int]) -> list[float]:
        """Read finite numbers of a row that has all cells."""
        if len(row.cells) != len(self.heads):
            raise self.error_of_width(row)
        return [self.require_number(row, column) for column in columns]

    def require_number(self, row: Row, column: int) -> float:
        """Convert a cell to a finite number; a `ValueError` with line and column if it is none."""
        number = self.parse_number(row, column)
        if number is not None and math.isfinite(number):
            return number
        cell = row.cells[column] if column < len(row.cells) else ""
        allowed = "a number" if number is None else "finite"
        cell = quote_word(cell) if cell else "an empty field"
        raise self.text.error(
            f"column {self.names[column]!r} must be {allowed}, got {cell}", row.line
        )


def read_table(source: Path | TextFile) -> Table:
    """Read a table whose fields are separated by commas, semicolons, tabs, bars or blanks.

    Lines that begin with # are comments; the last one above numbers may have the names of the
    columns, as NumPy writes it. Above the names other lines may stand, below them a line of
    units.

    Raises a `ValueError` that names the file if it cannot be read, is binary, or if all lines
    are comments.
    """
    text = source if isinstance(source, TextFile) else TextFile(source)
    notes: list[tuple[int, str]] = []
    if "#" in text.content:
        notes = [(n, line) for n, line in enumerate(text.lines, 1) if _is_comment(line)]
    stated = _SEPARATOR_LINE.fullmatch(text.lines[0])
    top = 1 if stated else 0
    # Of a tab at the end of the first line the reader of lines has taken away, as it may be.
    separator = (stated["separator"] or "\t") if stated else _find_separator(text)
    sample = [*itertools.islice(_split_lines(text, top, separator), _SAMPLE)]
    if not sample:
        raise text.error(
            "a line with the names of the columns was expected, all lines are comments"
        )
    head, first = _find_head(sample)
    titles = [row for k, row in enumerate(sample[:first]) if k != head]
    top = sample[first].line - 1 if first < len(sample) else len(text.lines)
    if head is not None:
        names = sample[head].cells
        line = sample[head].line
        units = titles[-1].cells if titles and head + 1 < first else []
        if _are_units(units, len(names)):
            del titles[-1]
            names = [
                f"{n} [{u.strip('[]()')}]" if u else n
                for n, u in zip(names, units, strict=True)
            ]
        # Spreadsheets end lines with separators of empty cells.
        while len(names) > 1 and not names[-1]:
            del names[-1]
    elif first == len(sample):
        got = quote_word(text.lines[sample[-1].line - 1])
        raise text.error(f"rows of numbers were expected below {got}", sample[-1].line)
    else:
        names, line = _find_names_in_comments(notes, sample[first:], separator)
        if not names and titles:
            got = quote_word(text.lines[top])
            raise text.error(f"names of the columns were expected above {got}", top + 1)
    notes = [note for note in notes if note[0] != line]
    notes += [(row.line, text.lines[row.line - 1]) for row in titles]
    return Table(text, names, line, sorted(notes), separator, top)


def _find_head(sample: list[Row]) -> tuple[int | None, int]:
    """Find the row of the names, None if there is none, and the first row below it."""
    leading = [0]
    while leading[-1] + 1 < len(sample) and not any(
        map(_is_number, sample[leading[-1] + 1].cells)
    ):
        leading.append(leading[-1] + 1)
    if all(map(_is_number, filter(None, sample[0].cells))):
        return None, 0
    width = Counter(len(row.cells) for row in sample).most_common(1)[0][0]
    # Titles have one cell, or are statements such as "Time Step: 0.005".
    names = [
        k
        for k in leading
        if (width == 1 or any(sample[k].cells[1:]))
        and not (len(sample[k].cells) == 1 and _STATEMENT.fullmatch(sample[k].cells[0]))
    ]
    if not names:
        return None, leading[-1] + 1
    known = {k: sum(bool(read_head(cell).quantity) for cell in sample[k].cells) for k in names}
    fitting = [k for k in names if len(sample[k].cells) == width] or names
    head = max(names, key=lambda k: known[k])
    if not known[head]:
        head = fitting[-1 if width == 1 else 0]
    first = head + 1
    while first < len(sample) and _stands_between(
        sample[first].cells, len(sample[head].cells)
    ):
        first += 1
    return head, first


def _stands_between(cells: list[str], width: int) -> bool:
    """Return whether a row below the names is none of numbers: of units, or a statement."""
    return _are_units(cells, width) or (
        len(cells) == 1 and not _is_number(cells[0]) and bool(_STATEMENT.fullmatch(cells[0]))
    )


def _are_units(cells: list[str], width: int) -> bool:
    """Return whether cells are units, or empty: the line below names in some logs."""
    words = [cell.strip("[]() ") for cell in cells]
    known = [word for word in words if word and parse_unit(word).dimension]
    numbers = [word for word in words if _is_number(word)]
    return (
        len(cells) == width
        and bool(known)
        and not numbers
        and len(known) == sum(map(bool, words))
    )


def _find_names_in_comments(
    notes: list[tuple[int, str]], rows: list[Row], separator: str
) -> tuple[list[str], int]:
    """Find names in the last comment above numbers, and its line; else names of one column."""
    first = rows[0].line
    width = max(len(row.cells) for row in rows)
    above = [note for note in notes if note[0] < first]
    if above and width > 1:
        line, comment = above[-1]
        names = _split_line(comment.strip(), separator)
        # A lone # is the name of a counter.
        names[0] = names[0].lstrip("# ") or "#"
        # Of sentences, which have commas as well, the parts are seldom single words.
        plain = all(
            _NAME_IN_COMMENT.fullmatch(name)
            or (name.endswith(("]", ")")) and read_head(name).units)
            or read_head(name).is_whole
            for name in names
        )
        if plain and len(names) == width and not any(map(_is_number, names)):
            return names, line
    # One column needs no name.
    return (["column 1"] if width == 1 else []), first


def _find_separator(text: TextFile) -> str:
    """Find what separates fields: what splits most lines into the same number of them."""
    candidates: dict[str, tuple[float, float, bool]] = {}
    for separator in _SEPARATORS:
        if separator not in text.content:
            continue
        rows = [*itertools.islice(_split_lines(text, 0, separator), _SAMPLE)]
        if not rows:
            return ","
        counts = Counter(len(row.cells) for row in rows)
        width, number = counts.most_common(1)[0]
        if width == 1 or (separator == " " and (candidates or number < len(rows))):
            continue
        # Rather commas within fields than semicolons or tabs.
        inside = any(
            set(cell) & (set(_SEPARATORS) - {separator, " "})
            for row in rows
            for cell in row.cells
        )
        # "0,5;0,1" has as many commas as semicolons, but only these leave numbers.
        cells = [cell for row in rows for cell in row.cells if cell]
        numbers = sum(map(_is_number, cells)) / max(len(cells), 1)
        candidates[separator] = (number / len(rows), numbers, not inside)
    if not candidates:
        # What is in none of the lines leaves each whole.
        return next((s for s in _SEPARATORS if s in text.lines[0] and s != " "), ",")
    # Of equal ones the first.
    return max(candidates, key=lambda separator: candidates[separator])


def _split_lines(text: TextFile, top: int, separator: str) -> Iterator[Row]:
    """Split the lines after `top` into rows, without empty lines and comments.

    A line end within quotes belongs to its cell.
    """
    begun = False
    line = top
    first = top

    def feed_lines() -> Iterator[str]:
        nonlocal begun, line, first
        for line, words in enumerate(text.lines[top:], top + 1):
            if not begun and (not words.strip() or _is_comment(words)):
                continue
            if not begun:
                first = line
            begun = True
            yield f"{words.strip() if separator == ' ' else words}\n"
        yield _END

    # For example a field of more than 131,072 characters raises an error.
    reader = csv.reader(feed_lines(), delimiter=separator, skipinitialspace=True)
    while True:
        begun = False
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise text.error(f"the line cannot be split into fields: {error}", line) from error
        if cells == [_END]:
            return
        if _END in cells[-1]:
            raise text.error("a quote in this line does not end", first)
        yield Row(first, [cell.replace("\n", " ").strip() for cell in cells])


def _split_line(line: str, separator: str) -> list[str]:
    """Split a line into its fields, without blanks around them."""
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [""])
    return [field.strip() for field in fields]


def _is_comment(line: str) -> bool:
    """Return whether a line begins with #."""
    return line.lstrip().startswith("#")


def _is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    return as_number(cell) is not None or bool(
        _DECIMAL_COMMA.fullmatch(cell) or _FORTRAN.fullmatch(cell)
    )
