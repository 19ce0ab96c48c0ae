"""Text files: their lines, errors that name file and line, and statements that must agree."""

import contextlib
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..host import read_regular, show_progress

# Control characters that no text file contains.
_BINARY = bytes({*range(0x20)} - {*b"\t\n\v\f\r"})
# Byte-order marks; the little-endian mark of UTF-32 begins like that of UTF-16, so it stands first.
_MARKS = {
    b"\xef\xbb\xbf": "utf-8",
    b"\xff\xfe\0\0": "utf-32-le",
    b"\0\0\xfe\xff": "utf-32-be",
    b"\xff\xfe": "utf-16-le",
    b"\xfe\xff": "utf-16-be",
}


class Statement(NamedTuple):
    """Statement of a caller or a file about a quantity.

    Attributes
    ----------
    line : int
        Line of the file, 0 for what the caller states.
    words : str
        The statement as a part of a sentence, such as "the header states cm/s2".
    value : float
        Its value in SI; NaN if it is not understood.
    """

    line: int
    words: str
    value: float


class NamedFile:
    """A file of any kind, and errors that name it."""

    def __init__(self, path: Path):
        """Take the name."""
        self.path = path

    def error(self, reason: str, line: int = 0) -> ValueError:
        """Make the error that gives the reason, with the file and perhaps the line."""
        return ValueError(f"{str(self.path)!r}{f', line {line}' if line else ''}: {reason}")

    def require_agreement(
        self,
        statements: Iterable[Statement],
        allowed: str,
        tolerance: float,
        missing: str,
        line: int = 0,
    ) -> float:
        """Return the first value, from which none may differ by more than the `tolerance`.

        A `ValueError` says what is `missing`, at this line, if there is no statement, and what
        is `allowed` if the first one is not understood.
        """
        statements = [*statements]
        if not statements:
            raise self.error(missing, line)
        first = statements[0]
        if math.isnan(first.value):
            raise self.error(f"{first.words}, which is not {allowed}", first.line)
        for other in statements[1:]:
            if not math.isclose(first.value, other.value, rel_tol=tolerance):
                where = f" in line {first.line}" if first.line else ""
                raise self.error(f"{first.words}{where}, but {other.words}", other.line)
        return first.value


class TextFile(NamedFile):
    """The lines of a text file.

    Attributes
    ----------
    content : str
        The text, with line ends of one kind.
    lines : list of str
        Its lines without their ends. Blank lines at the end of the file are left out.
    ends : bool
        Whether the file ends with a line end, another blank or Ctrl-Z.
    """

    def __init__(self, path: Path, content: bytes | None = None):
        """Take the lines of the content, or of the file; a `ValueError` if that is no text."""
        super().__init__(path)
        content = read_content(path) if content is None else content
        if any(map(content.startswith, _MARKS)):
            mark, code = next(pair for pair in _MARKS.items() if content.startswith(pair[0]))
            try:
                content = content.removeprefix(mark).decode(code).encode()
            except UnicodeDecodeError:
                raise self.error(f"the file seems to be damaged: it is no {code}") from None
        self.ends = content[-1:] in [b" ", b"\t", b"\r", b"\n", b"\v", b"\f", b"\x1a"]
        # DOS files end with a Ctrl-Z.
        content = content.rstrip(b"\x1a\r\n\t ")
        if not content:
            raise self.error("the file is empty")
        if len(content.translate(None, _BINARY)) < len(content):
            raise self.error("a text file was expected, this one is binary")
        self.content = _decode(content)
        self.lines = self.content.split("\n")

    def parse_number(self, word: str, line: int, name: str = "a value") -> float:
        """Convert a word to a finite number; `name` says of what."""
        value = as_number(word)
        if value is not None and math.isfinite(value):
            return value
        allowed = "a number" if value is None else "finite"
        seen = quote_word(word) if word.strip() else "an empty field"
        raise self.error(f"{name} must be {allowed}, got {seen}", line)

    def read_values(
        self,
        top: int,
        parse_all: Callable[[list[str]], np.ndarray],
        parse_line: Callable[[str, int], Iterable[float]],
    ) -> np.ndarray:
        """Read the numbers after line `top`, all together or else line by line."""
        lines = self.lines[top:]
        # The first is faster, the second accepts unusual writing and names the line of an error.
        with contextlib.suppress(ValueError):
            values = parse_all(lines)
            if np.isfinite(values).all():
                return values
        numbered = enumerate(show_progress(lines, f"reading {self.path.name}"), top + 1)
        return np.array([value for n, line in numbered for value in parse_line(line, n)])


def read_content(path: Path) -> bytes:
    """Read a whole file; a `ValueError` that names it if it cannot be read."""
    try:
        return read_regular(path)
    except OSError as error:
        reason = error.strerror or error
        raise ValueError(f"{str(path)!r}: the file cannot be read: {reason}") from error


def as_number(word: str) -> float | None:
    """Convert a word to a number, NaN and infinity among them; None if it is none."""
    # 1_000 is a number in Python only: elsewhere it is a mistake. Fortran writes 1D3.
    try:
        return float(word.replace("_", "?").lower().replace("d", "e"))
    except ValueError:
        return None


def quote_names(names: Iterable[str]) -> str:
    """Quote the first of several names, for a message."""
    quoted = [*map(quote_word, names)]
    return ", ".join(quoted[:12] + ["..."] * bool(quoted[12:]))


def quote_word(word: str) -> str:
    """Quote a word, cut if it is long."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")


def _decode(content: bytes) -> str:
    """Decode a text from UTF-8, or from Latin-1 those lines which are not in it."""
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    # Only names of stations and comments have other letters: numbers are the same in both.
    try:
        return content.decode()
    except UnicodeDecodeError:
        if b"\n" not in content:
            return content.decode("latin-1")
        return "\n".join(map(_decode, content.split(b"\n")))
