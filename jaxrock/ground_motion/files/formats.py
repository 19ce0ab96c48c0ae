"""Formats of whole files, each told by the first lines, and the readers for them.

Tables in .csv files are read beside it, since a caller picks columns of them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from .at2 import read_at2
from .components import Component
from .text import RecordText, Statements

# Takes a text, and what the caller states about unit and time step, which the file must not
# contradict; returns its components, one or several.
Reader = Callable[[RecordText, Statements, Statements], list[Component]]


class FileFormat(NamedTuple):
    """A format of text files.

    Attributes
    ----------
    name : str
        For messages.
    suffixes : tuple of str
        Ends of names by which files of a folder are taken; any other name is read as well.
    recognize : callable
        Tells by the lines of a text whether it is of this format.
    read : callable
        Reads the components.
    """

    name: str
    suffixes: tuple[str, ...]
    recognize: Callable[[list[str]], bool]
    read: Reader


FORMATS: tuple[FileFormat, ...] = ()


def list_suffixes() -> tuple[str, ...]:
    """List the ends of names, in lower case, of the files in a folder that are read."""
    return (".at2", ".csv", *(suffix for each in FORMATS for suffix in each.suffixes))


def read_components(path: Path, units: Statements, steps: Statements) -> list[Component]:
    """Read all components of a file that is no .csv file; a `ValueError` if it cannot be."""
    text = RecordText(path)
    if path.suffix.lower() == ".at2":
        return read_at2(text, units, steps)
    for each in FORMATS:
        if each.recognize(text.lines):
            return each.read(text, units, steps)
    names = ", ".join([".AT2", ".csv", *(each.name for each in FORMATS)])
    raise text.make_error(
        f"a file in one of these formats was expected: {names}; columns with commas, or one,"
        " are a .csv file"
    )
