"""Lines of a known form, and numbers in columns of fixed width, as Fortran writes them."""

import contextlib
import re
from typing import NamedTuple

import numpy as np

from ...oldtables import TextFile, quote_word


class Columns(NamedTuple):
    """Numbers in a full line, and characters for each."""

    number: int
    width: int


class Numbers(NamedTuple):
    """Numbers that have been read, as they are written and as values, and the next line."""

    words: list[str]
    values: np.ndarray
    end: int


def get_line(text: TextFile, at: int, name: str) -> str:
    """Return the line with index `at`; an error that the file ends if there is none."""
    if at >= len(text.lines):
        raise text.error(f"the file ends before {name}")
    return text.lines[at]


def match_line(text: TextFile, at: int, pattern: str, name: str) -> re.Match[str]:
    """Match the line with index `at` against a pattern from its beginning on."""
    line = get_line(text, at, name)
    match = re.match(pattern, line, re.I)
    if match is None:
        raise text.error(f"{name} was expected, got {quote_word(line.strip())}", at + 1)
    return match


def parse_format(text: TextFile, words: str, line: int) -> Columns:
    """Understand a format of Fortran with one kind of number, such as (8f10.3) or (10I8)."""
    pattern = r"\(\s*(\d+)(?:i(?!.*\.)|[feg](?=\d+\.))(\d+)(?:\.\d+)?\s*\)"
    match = re.fullmatch(pattern, words.strip(), re.I)
    if match is None or not int(match[1]) or not int(match[2]):
        raise text.error(
            f"a format such as (8f10.3) was expected, got {quote_word(words)}", line
        )
    return Columns(int(match[1]), int(match[2]))


def read_numbers(text: TextFile, at: int, count: int, columns: Columns) -> Numbers:
    """Read `count` numbers in columns of fixed width, from the line with index `at` on.

    Every line is full except the last one, and every number ends where its column does:
    otherwise columns are shifted, or the file is cut.
    """
    words: list[str] = []
    first = at
    while len(words) < count:
        line = get_line(text, at, f"all of {count} values, {len(words)} of them are there")
        line = line.rstrip()
        number = min(columns.number, count - len(words))
        expected = f"{number} values in columns of {columns.width} characters were expected"
        if len(line) != number * columns.width:
            raise text.error(f"{expected}, the line has {len(line)} characters", at + 1)
        for k in range(0, len(line), columns.width):
            field = line[k : k + columns.width]
            if field[-1] == " " or "," in field:
                raise text.error(f"{expected}, got {quote_word(field)}", at + 1)
            words.append(field.lower().replace("d", "e").strip())
        at += 1
    return Numbers(words, convert_words(text, words, first, columns.number), at)


def convert_words(text: TextFile, words: list[str], at: int, width: int) -> np.ndarray:
    """Convert words, `width` in a line from the one with index `at` on, to finite numbers."""
    # Only if this fails they go one by one, to name the line of an error.
    with contextlib.suppress(ValueError):
        values = np.array([*map(float, words)])
        # Python would also take 1_000, which is a mistake elsewhere.
        if np.isfinite(values).all() and "_" not in "".join(words):
            return values
    numbered = [(word, at + k // width + 1) for k, word in enumerate(words)]
    return np.array([text.parse_number(word, line) for word, line in numbered])
