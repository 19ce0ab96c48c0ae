"""Files that a broken transfer has cut within their last number."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from .text import TextFile, quote_word

# A number at the end of a word: in fixed columns several may run together, and Fortran may
# write 1.0-100 for 1e-100.
_NUMBER = re.compile(
    r"\s*(?:[-+.\d]|(?<=[\d.])[ed])*?"
    r"(?:(?P<digits>\d+\.|\.(?=\d))(?P<decimals>\d*)"
    r"(?P<exponent>[ed][-+]?\d+|[-+]\d{2,3})?"
    r"|(?P<whole>\d+)(?P<power>[ed][-+]?\d+)?)",
    re.I,
)
# As many are enough to see how numbers are printed.
_MANY = 1000


class _Digits(NamedTuple):
    """Characters after the point of a number and of its exponent, and whether it is 0."""

    decimals: int
    exponent: int
    is_zero: bool


def require_whole_end(text: TextFile, words: Sequence[str]) -> None:
    """Raise a `ValueError` if the file looks as if it were cut within its last number.

    `words` are numbers printed alike, up to the last word of the file, perhaps with the blanks
    in front that fill a column of fixed width. Where no line end or blank follows, the last is
    doubtful if it has fewer digits after its point than each before it, a shorter exponent, or
    ends before its column does. A number that was cut down to as many digits as another one has
    by chance cannot be told from it.
    """
    if text.ends or not words:
        return
    *before, last = words[-_MANY:]
    ends = {len(word) for word in before}
    is_padded = any(word[:1].isspace() for word in before)
    if _has_fewer_digits(last, before):
        reason = "has fewer digits than the others"
    elif is_padded and len(ends) == 1 and len(last) < min(ends):
        reason = "ends before those above it do"
    else:
        return
    raise text.error(
        f"the file looks truncated: its last number {quote_word(last.strip())} {reason} and no"
        " newline follows; add a newline if it is complete",
        len(text.lines),
    )


def _has_fewer_digits(last: str, before: list[str]) -> bool:
    """Return whether a number has fewer digits than each number before it."""
    counted = _count_digits(last)
    counts = [digits for digits in map(_count_digits, before) if digits is not None]
    # Among numbers that differ from it, a 0 may be printed in a way of its own.
    counts = [digits for digits in counts if not digits.is_zero] or counts
    if counted is None or not counts:
        return False
    exponent = min(digits.exponent for digits in counts)
    if exponent and counted.is_zero:
        return False
    # 9e-1 among 0.5 and 0.75 is whole: programs that print the shortest form write so.
    if counted.exponent and not exponent:
        return False
    decimals = min(digits.decimals for digits in counts)
    return counted.decimals < decimals or counted.exponent < exponent


def _count_digits(word: str) -> _Digits | None:
    """Count the digits of the number at the end of a word; None if there is none."""
    match = _NUMBER.fullmatch(word)
    if match is None:
        return None
    if match["whole"]:
        return _Digits(0, len(match["power"] or ""), int(match["whole"]) == 0)
    is_zero = not re.search("[1-9]", match["digits"] + match["decimals"])
    return _Digits(len(match["decimals"]), len(match["exponent"] or ""), is_zero)
