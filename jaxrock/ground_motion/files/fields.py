"""Fields of headers, found by short patterns, and numbers below them."""

import contextlib
import math
import re
from collections.abc import Callable

import numpy as np

from ...tables import TextFile, as_number, quote_word


def get_line(text: TextFile, at: int, name: str) -> str:
    """Return the line with index `at`; an error that the file ends if there is none."""
    if at >= len(text.lines):
        raise text.error(f"the file ends before {name}")
    return text.lines[at]


def find(text: TextFile, at: int, pattern: str, name: str) -> re.Match[str]:
    """Find a pattern in the line with index `at`, in upper or lower case."""
    line = get_line(text, at, name)
    match = re.search(pattern, line, re.I)
    if match is None:
        raise text.error(f"{name} was expected, got {quote_word(line.strip())}", at + 1)
    return match


def read_format(text: TextFile, at: int) -> tuple[int, int]:
    """Return how many numbers a line has and how wide they are, by a format such as (8f10.3)."""
    match = find(text, at, r"\( ?(\d+)[efgi](\d+)", "a format such as (8f10.3)")
    return int(match[1]), max(int(match[2]), 1)


def read_fixed(
    text: TextFile, at: int, count: int, layout: tuple[int, int]
) -> tuple[np.ndarray, int]:
    """Read numbers in columns of fixed width, and the index of the line after them.

    The layout is how many numbers a line has and how wide they are. Every line is full but the
    last one, and every number ends where its column does: otherwise columns are shifted, or the
    file is cut.
    """
    if count < 1:
        return np.zeros(0), at
    number, width = layout
    end = at - (-count // number)
    get_line(text, end - 1, f"all of {count} values")
    lines = [line.rstrip() for line in text.lines[at:end]]
    for k, line in enumerate(lines):
        expected = min(number, count - k * number)
        if len(line) != expected * width or " " in line[width - 1 :: width]:
            seen = f"{expected} values in columns of {width} characters were expected"
            raise text.error(f"{seen}, got {quote_word(line)}", at + 1 + k)
    block = "".join(lines)
    words = [block[k : k + width] for k in range(0, len(block), width)]
    return convert_words(text, words, lambda k: at + 1 + k // number), end


def read_free(text: TextFile, at: int, count: int | None = None) -> np.ndarray:
    """Read all numbers between blanks from the line with index `at` on, `count` if it is stated."""
    lines = text.lines[at:]
    words = " ".join(lines).split()
    if count not in (None, len(words)):
        raise text.error(f"the header states {count} values, but {len(words)} follow")
    if not text.ends:
        raise text.error(
            "no line end follows the last number: add one if the file is complete"
        )
    each = (k for k, line in enumerate(lines, at + 1) for _ in line.split())
    return convert_words(text, words, lambda j: [*each][j])


def convert_words(
    text: TextFile, words: list[str], find_line: Callable[[int], int]
) -> np.ndarray:
    """Convert words to finite numbers; an error names the line of a word that is none."""
    # Python would also take 1_000.
    with contextlib.suppress(ValueError):
        values = np.fromiter(map(float, words), float, len(words))
        if np.isfinite(values).all() and "_" not in "".join(words):
            return values
    # Fortran may write D for the exponent.
    numbers = [as_number(word.lower().replace("d", "e")) for word in words]
    for k, number in enumerate(numbers):
        if number is None or not math.isfinite(number):
            seen = quote_word(words[k])
            raise text.error(f"a number was expected, got {seen}", find_line(k))
    return np.array(numbers)
