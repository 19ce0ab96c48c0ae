"""Text files of records: their lines, the statements in them, and errors that name both."""

import contextlib
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from ...host import read_regular, show_progress
from .units import UNITS, Stated

# Control characters that no text file contains.
_BINARY = bytes({*range(0x20)} - {*b"\t\n\v\f\r"})

# Relative difference of time steps that count as the same: files print them with few digits.
UNIFORM = 1e-3
# What a statement must be, in words for an error, and the relative difference up to which two
# statements agree.
UNIT = UNITS, 1e-9
STEP = "a time step in s, ms or the like, or in samples per second", UNIFORM

# Lines with their numbers, counted from 1 on.
Lines = list[tuple[int, str]]
# Line (0 for what the caller states), words, value.
Statements = list[tuple[int, str, float]]


class RecordText:
    """The lines of a file, and errors that name it."""

    def __init__(self, path: Path):
        """Read the lines; a `ValueError` if the file is empty, binary or cannot be read."""
        self.path = path
        try:
            content = read_regular(path)
        except OSError as error:
            raise self.make_error(
                f"the file cannot be read: {error.strerror or error}"
            ) from error
        # Programs on Windows may put a byte order mark first; DOS files end with a Ctrl-Z.
        content = content.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\r\n\t ")
        self.refuse(not content, "the file is empty")
        binary = len(content.translate(None, _BINARY)) < len(content)
        self.refuse(binary, "a text file was expected, this one is binary")
        self.lines = _decode(content.splitlines())

    def make_error(self, reason: str, line: int = 0) -> ValueError:
        """Make the error that gives the reason, with the file and perhaps the line."""
        return ValueError(f"{str(self.path)!r}{f', line {line}' if line else ''}: {reason}")

    def refuse(self, wrong: bool, reason: str, line: int = 0) -> None:
        """Raise an error that names the file if something is wrong."""
        if wrong:
            raise self.make_error(reason, line)

    def parse_number(self, word: str, line: int, name: str = "a value") -> float:
        """Convert a word to a finite number; `name` says of what."""
        # 1_000 is a number in Python only: elsewhere it is a mistake.
        try:
            value = float(word.replace("_", "?"))
        except ValueError:
            got = quote_word(word) if word.strip() else "an empty field"
            raise self.make_error(f"{name} must be a number, got {got}", line) from None
        self.refuse(
            not math.isfinite(value), f"{name} must be finite, got {quote_word(word)}", line
        )
        return value

    def read_values(
        self,
        top: int,
        parse_all: Callable[[list[str]], np.ndarray],
        parse_line: Callable[[str, int], Iterable[float]],
    ) -> np.ndarray:
        """Read the numbers after line `top`.

        The lines go to `parse_all` together, which is faster. If that raises a `ValueError` or
        returns a number that is not finite, they go to `parse_line` one by one, which accepts
        unusual writing and names the line of an error.
        """
        lines = self.lines[top:]
        with contextlib.suppress(ValueError):
            if np.isfinite(values := parse_all(lines)).all():
                return values
        numbered = enumerate(show_progress(lines, f"reading {self.path.name}"), top + 1)
        return np.array([value for n, line in numbered for value in parse_line(line, n)])

    def require_agreement(
        self, about: tuple[str, float], statements: Statements, missing: str, at: int = 0
    ) -> float:
        """Return the value that all statements agree on, the first one's.

        Raises a `ValueError`, with the words `missing` and line `at` if there is no statement.
        """
        self.refuse(not statements, missing, at)
        line, first, value = statements[0]
        self.refuse(math.isnan(value), f"{first}, which is not {about[0]}", line)
        for number, words, other in statements[1:]:
            where = f" in line {line}" if line else ""
            differs = not math.isclose(value, other, rel_tol=about[1])
            self.refuse(differs, f"{first}{where}, but {words}", number)
        return value


def _decode(lines: list[bytes]) -> list[str]:
    """Decode lines from UTF-8, or from Latin-1 those which are not in it."""
    # Only names of stations and comments have other letters: numbers are the same in both.
    try:
        return [line.decode() for line in lines]
    except UnicodeDecodeError:
        if len(lines) == 1:
            return [lines[0].decode("latin-1")]
        return [text for line in lines for text in _decode([line])]


def collect_statements(
    find: Callable[[str], list[Stated]], lines: Lines, where: str
) -> Statements:
    """Collect the statements that `find` finds in lines; `where` says in what they stand."""
    return [
        (n, f"{where} states {words}", value)
        for n, line in lines
        for words, value in find(line)
    ]


def quote_names(names: Iterable[str]) -> str:
    """Quote the first of several names, for a message."""
    names = [*names]
    return ", ".join([quote_word(name) for name in names[:12]]) + (
        ", ..." if names[12:] else ""
    )


def quote_word(word: str) -> str:
    """Quote a word, cut if it is long."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")
