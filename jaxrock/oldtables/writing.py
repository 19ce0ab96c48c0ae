"""Tables as they are written, in one style: inputs above, heads with units, comma-separated."""

import csv
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np


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
