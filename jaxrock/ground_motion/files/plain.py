"""Files of nothing but numbers, one or several in a line, as OpenSees' examples have them.

They are one series of accelerations, line by line. Numbers alone do not say so: what looks
like a header, or like columns side by side, is refused.
"""

import re

import numpy as np

from ...oldtables import NUMBER, TextFile, quote_word, read_fortran, require_whole_end
from .claims import Claims
from .components import Component

# Fixed columns run together where a sign fills the field. Each number has its decimal point,
# by which they can be told apart.
_FIELD = rf"(?=[-+]?\d*\.){NUMBER}"
_FIELDS = re.compile(rf"{_FIELD}(?:(?=[-+]){_FIELD})*", re.I)
# A line after the values, as OpenSees' elCentro.at2 has it.
_END_OF_DATA = r"\W*end\s+(?:of\s+)?data\W*"
# A number of values.
_COUNT = r"[1-9]\d*"
# As many are enough to see how numbers are printed.
LAST_LINES = 200
_WAY_OUT = (
    "write one number a line if they are one series, or name the columns in a .csv file,"
    " such as 'time [s],acceleration [g]'"
)


def read_free_numbers(text: TextFile, top: int) -> np.ndarray:
    """Read all numbers after line `top`, however many stand in a line."""
    lines = text.lines
    # Exactly one such line, at the end: anywhere else it is no number.
    is_ended = re.fullmatch(_END_OF_DATA, lines[-1], re.I) is not None
    if is_ended:
        del lines[-1]
    values = text.read_values(
        top,
        lambda rows: np.array([*map(float, " ".join(rows).replace("_", "?").split())]),
        lambda row, n: [value for word in row.split() for value in _split_word(text, word, n)],
    )
    if not is_ended:
        require_whole_end(text, " ".join(lines[top:][-LAST_LINES:]).split())
    return values


def recognize_plain(lines: list[str]) -> bool:
    """Return whether the first line has nothing but numbers."""
    first = next((line for line in lines if line.strip()), "")
    number = re.compile(f"{NUMBER}|{_FIELDS.pattern}", re.I)
    return all(map(number.fullmatch, first.split()))


def read_plain(text: TextFile, claims: Claims) -> list[Component]:
    """Read the only component; the caller has to state its unit and its time step."""
    values = read_free_numbers(text, 0)
    # How many numbers stand in each line, by its number.
    widths = {
        n: sum(len(_split_word(text, word, n)) for word in line.split())
        for n, line in enumerate(text.lines, 1)
        if line.strip()
    }
    _check_head(text, claims, [*widths.values()], values)
    width = next(iter(widths.values()))
    *_, last = widths
    for line, count in widths.items():
        if count > width or (count < width and line != last):
            raise text.error(
                f"{width} numbers a line were expected, as in the first one, got {count}", line
            )
    _check_columns(text, width, values)
    missing = "the file holds nothing but numbers"
    factor = claims.require_unit(text, missing)
    step = claims.require_step(text, missing)
    return [Component(repr(str(text.path)), factor, values, step)]


def _check_head(text: TextFile, claims: Claims, widths: list[int], values: np.ndarray) -> None:
    """Raise an error if the first line may be a header, such as '4000 0.005', 4000 or 0.005."""
    first, *below = [line for line in text.lines if line.strip()]
    # Some programs write a 0 without a point: that is no number of values.
    is_whole = re.fullmatch(_COUNT, first.split()[0]) is not None
    has_whole = any(re.fullmatch(_COUNT, word) for line in below for word in line.split())
    is_count = is_whole and (not has_whole or values[0] in (values.size, values.size - 1))
    is_step = any(values[0] == step.value for step in claims.steps)
    is_apart = len(widths) > 2 and widths[0] != widths[1]
    if is_count or is_step or is_apart:
        raise text.error(
            f"the first line {quote_word(first.strip())} may be a header: delete it if it is,"
            " and state unit and time_step; otherwise write all numbers alike, one a line",
            1,
        )


def _check_columns(text: TextFile, width: int, values: np.ndarray) -> None:
    """Raise an error if the numbers look like columns of a table, such as time and value.

    Times, and numbers of lines, increase from each line to the next. Numbers of one series
    differ from their neighbours in the line by less than from those above and below, which are
    further apart in time; those of columns side by side differ the other way round.
    """
    rows = values[: values.size // width * width].reshape(-1, width)
    if len(rows) < 3:
        return
    down = np.diff(rows, axis=0)
    increasing = np.flatnonzero((down > 0).all(axis=0))
    if increasing.size:
        raise text.error(
            f"column {increasing[0] + 1} of {width} increases all along, as times do: {_WAY_OUT}"
        )
    beside = np.diff(rows, axis=1)
    if width > 1 and np.mean(down**2) < np.mean(beside**2):
        raise text.error(f"the numbers look like {width} columns side by side: {_WAY_OUT}")


def _split_word(text: TextFile, word: str, line: int) -> list[float]:
    """Read the numbers in a word: one, or several of fixed columns without a space."""
    if not _FIELDS.fullmatch(word):
        return [text.parse_number(word, line)]
    # .1-02.3-02 may be .1e-02 and .3e-02, or .1 and -02.3e-02. A word is refused if a number
    # in it would begin with 0, or if it also has an exponent without a letter.
    perhaps = re.findall(r"(?<=[\d.])[-+]\d{2,3}\.", word)
    bare_exponent = re.search(r"[\d.][-+]\d{2,3}(?![\d.])", word)
    if any(number[1] == "0" for number in perhaps) or (perhaps and bare_exponent):
        raise text.error(f"numbers run together unclearly, got {quote_word(word)}", line)
    values = [read_fortran(match[0]) for match in re.finditer(NUMBER, word, re.I)]
    if not np.isfinite(values).all():
        raise text.error(f"a value must be finite, got {quote_word(word)}", line)
    return values
