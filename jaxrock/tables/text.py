"""Text files: their lines, and errors that name file and line."""

import os
import unicodedata
from collections.abc import Iterable
from pathlib import Path


class NamedFile:
    """A file of any kind, and errors that name it."""

    def __init__(self, path: str | os.PathLike[str]):
        """Take the name."""
        self.path = Path(path)

    def error(self, reason: str, line: int = 0) -> ValueError:
        """Make the error that gives the reason, with the file and perhaps the line."""
        return ValueError(f"{str(self.path)!r}{f', line {line}' if line else ''}: {reason}")


class TextFile(NamedFile):
    """The lines of a text file.

    Attributes
    ----------
    lines : list of str
        Without their ends, and without blank lines at the end of the file.
    ends : bool
        Whether the file ends with a line end or another blank.
    """

    def __init__(self, path: str | os.PathLike[str], content: bytes | None = None):
        """Take the lines of the content, or of the file; a `ValueError` if that is no text."""
        super().__init__(path)
        content = self.path.read_bytes() if content is None else content
        marked = content.startswith((b"\xff\xfe", b"\xfe\xff"))
        try:
            text = content.decode("utf-16" if marked else "utf-8-sig")
        # As Windows writes it. Numbers are the same; only names and comments have other letters.
        except UnicodeDecodeError:
            text = content.decode("latin-1")
        text = text.replace("\r\n", "\n").replace("\r", "\n")
        # DOS files end with a Ctrl-Z. A tab may be in front of a cell that is empty.
        whole = text.rstrip("\x1a\n ")
        if not whole.strip() or "\0" in whole:
            raise self.error("a text with lines was expected: save a spreadsheet as CSV")
        self.ends = len(text) > len(whole)
        self.lines = whole.split("\n")


def as_number(word: str) -> float | None:
    """Convert a word to a number, NaN and infinity among them; None if it is none."""
    # 1_000 is a number in Python only: elsewhere it is a mistake.
    try:
        return float(word.replace("_", "?"))
    except ValueError:
        return None


def quote_names(names: Iterable[str]) -> str:
    """Quote several names, for a message."""
    return ", ".join(map(quote_word, names))


def quote_word(word: str) -> str:
    """Quote a word, cut if it is long."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")


def normalize(text: str) -> str:
    """Give one form to what looks alike: powers, minus signs, dots of products, micro."""
    # NFKC turns a superscript 2 into 2 and the micro sign into a Greek letter, but leaves the
    # minus sign, the middle dot and the dot operator.
    return unicodedata.normalize("NFKC", text).translate({0x2212: "-", 0xB7: ".", 0x22C5: "."})
