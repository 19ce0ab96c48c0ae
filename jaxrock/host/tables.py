"""Tables as text files: read line by line, and written in one style."""

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from .files import read_regular


def numbered_lines(path: Path) -> list[tuple[int, str]]:
    """Read the lines of a text file with their numbers, but for empty ones and comments (#).

    A `ValueError` names the file if it cannot be read or is binary.
    """
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
    return [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]


def is_number(word: str) -> bool:
    """Tell whether a word of a file is a number, NaN and infinity among them."""
    try:
        float(word.replace("_", "?"))  # 1_000 is a number in Python only
    except ValueError:
        return False
    return True


def heading(name: str, unit: str = "") -> str:
    """Write the head of a column: its name, and its unit in brackets, as CF or as one does."""
    above = re.sub(r"\S+-\d", "", unit).split()
    below = re.findall(r"(\S+)-(\d)", unit)
    for word, power in below:
        above = [f"{''.join(above) or '1'}/{word}{power if power != '1' else ''}"]
    plain = "-" if unit == "1" else " ".join(above)
    return f"{name} [{plain}]" if plain else name


def write_about(file: TextIO, about: Mapping[str, Any]) -> None:
    """Write what a table was computed from, in lines that begin with #."""
    for name, value in about.items():
        words = (
            value if isinstance(value, str) else " ".join(map(str, np.ravel(value).tolist()))
        )
        file.write(f"# {name}: {' '.join(words.split())}\n")


def write_csv(
    path: Path,
    columns: Mapping[str, Sequence[Any]],
    units: Mapping[str, str],
    about: Mapping[str, Any],
) -> None:
    """Write a table with a head, below what it was computed from."""
    heads = [heading(name, units.get(name, "")) for name in columns]
    rows: Iterable[Any] = zip(*columns.values(), strict=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        write_about(file, about)
        csv.writer(file, lineterminator="\n").writerows([heads, *rows])
