"""Fields of headers, found by short patterns, and numbers below them."""

import contextlib
import math
import re

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
    lengths = [number * width] * (len(lines) - 1) + [
        (count - number * (len(lines) - 1)) * width
    ]
    for k, (line, length) in enumerate(zip(lines, lengths, strict=True), at + 1):
        if len(line) != length or " " in line[width - 1 :: width]:
            expected = f"{length // width} values in columns of {width} characters"
            raise text.error(f"{expected} were expected, got {quote_word(line)}", k)
    block = "".join(lines)
    words = [block[k : k + width] for k in range(0, len(block), width)]
    return convert_words(text, words, [at + 1 + k // number for k in range(count)]), end


def read_free(text: TextFile, at: int, count: int | None = None) -> np.ndarray:
    """Read all numbers between blanks from the line with index `at` on, `count` if it is stated."""
    split = [line.split() for line in text.lines[at:]]
    words = [word for line in split for word in line]
    if count not in (None, len(words)):
        raise text.error(f"the header states {count} values, but {len(words)} follow")
    text.require_whole_end(words)
    return convert_words(
        text, words, [k for k, line in enumerate(split, at + 1) for _ in line]
    )


def convert_words(text: TextFile, words: list[str], lines: list[int]) -> np.ndarray:
    """Convert words, each in its line, to finite numbers; an error names the line of a word."""
    # Fortran may write D for the exponent; Python would also take 1_000.
    plain = " ".join(words).lower().replace("d", "e").replace("_", "?").split()
    with contextlib.suppress(ValueError):
        values = np.array(plain, dtype=float)
        if len(plain) == len(words) and np.isfinite(values).all():
            return values
    # An empty word is one of a column of fixed width.
    wrong = next((k for k, w in enumerate(plain) if not _is_finite(w)), len(words) - 1)
    raise text.error(f"a number was expected, got {quote_word(words[wrong])}", lines[wrong])


def _is_finite(word: str) -> bool:
    """Return whether a word is a finite number."""
    number = as_number(word)
    return number is not None and math.isfinite(number)
