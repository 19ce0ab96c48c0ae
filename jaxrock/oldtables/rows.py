"""Rows of a table: lines, or several where a line end stands within quotes."""

import csv
import re
from collections.abc import Iterator
from typing import NamedTuple

from .text import TextFile, as_number

SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
# No text has it: within a cell it shows a quote that does not end.
_END = "\x01"

DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[ed][-+]?\d+)?", re.I)


class Row(NamedTuple):
    """A row of a table: the line in which it begins, and its cells."""

    line: int
    cells: list[str]


def split_lines(text: TextFile, top: int, separator: str) -> Iterator[Row]:
    """Split lines into rows without comments; a line end within quotes belongs to its cell."""
    # The lines of the row that is being read: within it none is left out.
    begun: list[int] = []

    def feed_lines() -> Iterator[str]:
        for line, words in enumerate(text.lines[top:], top + 1):
            if begun or (words.strip() and not is_comment(words)):
                begun.append(line)
                yield f"{words.strip() if separator == ' ' else words}\n"
        yield _END

    try:
        for cells in csv.reader(feed_lines(), delimiter=separator, skipinitialspace=True):
            if cells == [_END]:
                return
            if _END in cells[-1]:
                raise text.error("a quote in this line does not end", begun[0])
            yield Row(begun[0], [cell.replace("\n", " ").strip() for cell in cells])
            begun.clear()
    # For example a field of more than 131,072 characters raises one.
    except csv.Error as error:
        raise text.error(
            f"the line cannot be split into fields: {error}", begun[-1]
        ) from error


def split_line(line: str, separator: str) -> list[str]:
    """Split a line into its fields, without blanks around them."""
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [""])
    return [field.strip() for field in fields]


def is_comment(line: str) -> bool:
    """Return whether a line begins with #."""
    return line.lstrip().startswith("#")


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    return as_number(cell) is not None or DECIMAL_COMMA.fullmatch(cell) is not None
