"""Tables as they are written, in one style: inputs above, heads with units, comma-separated."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from .quantities import UNITS, print_unit


def format_heading(name: str, unit: str = "") -> str:
    """Write the head of a column: its name, and its unit in brackets."""
    return f"{name} [{print_unit(unit)}]" if unit else name


def write_inputs(file: TextIO, about: Mapping[str, object]) -> None:
    """Write the inputs that a table was computed from, in lines that begin with #."""
    for name, value in about.items():
        words = " ".join(map(str, np.asarray(value).ravel().tolist()))
        # In one line, since the next would not begin with #.
        file.write(f"# {name}: {' '.join(words.split())}\n")


def write_csv(path: Path, columns: Mapping[str, Any], about: Mapping[str, object]) -> None:
    """Write a table with a head, below the inputs that it was computed from."""
    heads = [format_heading(name, UNITS.get(name, "")) for name in columns]
    rows = zip(*columns.values(), strict=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        write_inputs(file, about)
        csv.writer(file, lineterminator="\n").writerows([heads, *rows])
