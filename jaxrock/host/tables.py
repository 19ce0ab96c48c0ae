"""Reading small tables from text files."""

from pathlib import Path

from .files import read_regular


def numbered_lines(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file with their numbers, without empty ones and those that begin with #.

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
    """Whether a word of a file is a number, NaN and infinity among them."""
    try:
        float(word.replace("_", "?"))  # 1_000 is a number in Python only
    except ValueError:
        return False
    return True
