"""Tables as text files, read line by line."""

import csv
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from .files import read_regular

# A line: its number, its text, its fields.
Row = tuple[int, str, list[str]]
# A number in decimals, with what cutting it short would take away.
_DIGITS = r"[-+]?\d*(?:\.(?P<decimals>\d*))?(?:e(?P<exponent>[-+]?\d*))?"


class TextTable(NamedTuple):
    """The lines of a table: comments (#), the others, and whether the last one has an end."""

    path: Path
    comments: list[Row]
    rows: list[Row]
    ends: bool

    def refuse(self, wrong: bool, reason: str, line: int = 0) -> None:
        """Raise a `ValueError` that names the file, and perhaps the line, if it is wrong."""
        if wrong:
            place = f", line {line}" if line else ""
            raise ValueError(f"{str(self.path)!r}{place}: {reason}")

    def refuse_cut(self, row: Row, column: int, others: Iterable[str]) -> None:
        """Raise a `ValueError` if the file ends within a number of this row."""
        word = row[2][column]
        last = not self.ends and row == self.rows[-1] and column == len(row[2]) - 1
        cut = last and _is_cut(word, others)
        seems = f"the file seems to be cut within a number, it ends in {word!r}"
        way = "end the last line with a line end if the number is whole"
        self.refuse(cut, f"{seems}: {way}", row[0])


def read_text_table(path: Path) -> TextTable:
    """Read a table whose fields are separated by commas, tabs or what a line ``sep=;`` says.

    Raises
    ------
    ValueError
        If it cannot be read or is binary, or if fields are separated by semicolons without
        such a line. The error names the file.
    """
    lines, ends = _read_lines(path)
    first = next((pair for pair in lines if not _is_comment(pair[1])), (0, ""))
    separator = "\t" if "\t" in first[1].strip() and "," not in first[1] else ","
    if stated := re.fullmatch(r'\s*"?sep=([,;|\t])"?\s*', first[1], re.I):
        separator = stated[1]
        lines.remove(first)
    elif ";" in first[1]:
        # A semicolon comes with decimal commas, at which numbers would be cut in two.
        must = "columns were expected to be separated by commas and decimals by points"
        raise ValueError(f"{str(path)!r}, line {first[0]}: {must}, got {first[1][:60]!r}")
    rows = [(number, line, _split_fields(line, separator)) for number, line in lines]
    comments = [row for row in rows if _is_comment(row[1])]
    return TextTable(path, comments, [row for row in rows if not _is_comment(row[1])], ends)


def _read_lines(path: Path) -> tuple[list[tuple[int, str]], bool]:
    """Read the lines that are not empty with their numbers, and tell if the last has an end."""
    try:
        content = read_regular(path)
    except OSError as error:
        reason = error.strerror or error
        raise ValueError(f"{str(path)!r}: the file cannot be read: {reason}") from error
    if b"\0" in content:
        raise ValueError(f"{str(path)!r}: a text file was expected, this one is binary")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # names; numbers are the same in both
    numbered = enumerate(text.splitlines(), 1)
    return [pair for pair in numbered if pair[1].strip()], text[-1:] in ("\n", "\r")


def _is_comment(line: str) -> bool:
    """Tell whether a line begins with #."""
    return line.lstrip().startswith("#")


def _split_fields(line: str, separator: str) -> list[str]:
    """Split a line into its fields, without blanks and quotes around them."""
    try:
        fields = next(
            csv.reader([line.strip(" ")], delimiter=separator, skipinitialspace=True)
        )
    except csv.Error:  # a field of more than 131,072 characters
        return [line]
    return [field.strip().strip('"').strip() for field in fields]


def _is_cut(word: str, others: Iterable[str]) -> bool:
    """Tell whether a number at the end of a file must have had more digits.

    It must if it has fewer of them after the point, or in its exponent, than all the others
    that are printed like it.
    """
    counts = [_count_digits(other) for other in others if is_number(other) and float(other)]
    if not counts or not is_number(word):
        return False
    decimals, exponent = _count_digits(word)
    least = [min(column) for column in zip(*counts, strict=True)]
    # A 0 is printed in its own way among numbers with exponents, and so is a number that has an
    # exponent where others have none.
    if (exponent and not least[1]) or (least[1] and not float(word)):
        return False
    return decimals < least[0] or exponent < least[1]


def _count_digits(word: str) -> tuple[int, int]:
    """Count the digits of a number after its point, and the characters of its exponent."""
    found = re.fullmatch(_DIGITS, word, re.I)
    return (len(found["decimals"] or ""), len(found["exponent"] or "")) if found else (0, 0)


def is_number(word: str) -> bool:
    """Tell whether a word of a file is a number, NaN and infinity among them."""
    try:
        float(word.replace("_", "?"))  # 1_000 is a number in Python only
    except ValueError:
        return False
    return True
