"""Tables as text files: read line by line, and written in one style."""

import csv
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from .files import read_regular


def read_numbered_lines(path: Path) -> list[tuple[int, str]]:
    """Read the lines of a text file with their numbers, but for empty ones and comments (#).

    Raises
    ------
    ValueError
        If it cannot be read or is binary. The error names the file.
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


def format_heading(name: str, unit: str = "") -> str:
    """Write the head of a column: its name, and its unit in brackets.

    A unit in the style of CF, ``m s-2``, is written as ``m/s2``.
    """
    # Words with a negative power move behind a stroke each, the others stay in front.
    above = re.sub(r"\S+-\d", "", unit).split()
    below = re.findall(r"(\S+)-(\d)", unit)
    for word, power in below:
        above = [f"{''.join(above) or '1'}/{word}{power if power != '1' else ''}"]
    plain = "-" if unit == "1" else " ".join(above)
    return f"{name} [{plain}]" if plain else name


def write_inputs(file: TextIO, about: Mapping[str, object]) -> None:
    """Write the inputs that a table was computed from, in lines that begin with #."""
    for name, value in about.items():
        words = (
            value
            if isinstance(value, str)
            else " ".join(map(str, np.asarray(value).ravel().tolist()))
        )
        # In one line, since the next would not begin with #.
        file.write(f"# {name}: {' '.join(words.split())}\n")


def write_csv(
    path: Path,
    columns: Mapping[str, Iterable[object]],
    units: Mapping[str, str],
    about: Mapping[str, object],
) -> None:
    """Write a table with a head, below the inputs that it was computed from."""
    heads = [format_heading(name, units.get(name, "")) for name in columns]
    rows: Iterable[Iterable[object]] = zip(*columns.values(), strict=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        write_inputs(file, about)
        csv.writer(file, lineterminator="\n").writerows([heads, *rows])
