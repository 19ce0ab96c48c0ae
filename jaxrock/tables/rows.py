"""Rows of a table: lines, or several where a line end stands within quotes."""

import csv
import re
from collections.abc import Iterator
from typing import NamedTuple

from .text import TextFile, as_number

SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
# No text has it: within a cell it shows a quote that does not end.
_END = "\x01"

# As Fortran may write a number, with a letter that Python does not know.
FORTRAN = re.compile(r"([-+]?(?:\d+[.,]?\d*|[.,]\d+))d([-+]?\d+)", re.I)
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[ed][-+]?\d+)?", re.I)
DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[ed][-+]?\d+)?", re.I)


class Row(NamedTuple):
    """A row of a table: the line in which it begins, and its cells."""

    line: int
    cells: list[str]


def split_lines(text: TextFile, top: int, separator: str) -> Iterator[Row]:
    """Split the lines after `top` into rows, without empty lines and comments.

    A line end within quotes belongs to its cell.
    """
    begun = False
    line = top
    first = top

    def feed_lines() -> Iterator[str]:
        nonlocal begun, line, first
        for line, words in enumerate(text.lines[top:], top + 1):
            if not begun and (not words.strip() or is_comment(words)):
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


def split_line(line: str, separator: str) -> list[str]:
    """Split a line into its fields, without blanks around them."""
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [""])
    return [field.strip() for field in fields]


def is_comment(line: str) -> bool:
    """Return whether a line begins with #."""
    return line.lstrip().startswith("#")


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    return as_number(cell) is not None or bool(
        DECIMAL_COMMA.fullmatch(cell) or FORTRAN.fullmatch(cell)
    )
