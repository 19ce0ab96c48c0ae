"""Files .bbp of SCEC's Broadband Platform: comments, then times and three components.

The columns are separated by blanks or tabs. The platform is described at
https://github.com/SCECcode/bbp/wiki.
"""

import re

from ...oldtables import TextFile, parse_unit, require_whole_end
from .claims import Claims
from .components import Component, Direction
from .fixed_columns import convert_words
from .headers import Header

# In one line, such as "# time(sec) N-S(cm/s/s) E-W(cm/s/s) U-D(cm/s/s)".
_NAMES = r"\W*time\s*\(s(?:ec)?\)\s+N-?S\b.*\bE-?W\b.*\bU(?:-?D|P)\b"
# Or in three, such as "# Column 2: North-south acceleration (cm/s/s)".
_COLUMNS = (
    r"\W*column\s+2:\s*north-south\b",
    r"\W*column\s+3:\s*east-west\b",
    r"\W*column\s+4:\s*up-down\b",
)
# The bracket may be missing where a line was too long.
_UNIT = r"(?:N-?S|E-?W|U-?D|UP|acceleration|velocity)\s*\((?P<unit>[^)]*)(?:\)|$)"
# The first column has the times; the third component points up.
_CHANNELS: tuple[tuple[str, Direction], ...] = (("NS", "level"), ("EW", "level"), ("UD", "up"))
_WIDTH = 1 + len(_CHANNELS)


def read_bbp(text: TextFile, claims: Claims) -> list[Component]:
    """Read the three components."""
    header = Header(text, claims)
    for n in find_bbp_names(text.lines):
        for match in re.finditer(_UNIT, text.lines[n - 1], re.I):
            unit = match["unit"]
            if parse_unit(unit).dimension == "velocity" or re.fullmatch("cm/?", unit):
                raise text.error(
                    f"the columns are velocities in {unit}: take the accelerations, which the"
                    " platform writes beside them, in a file .acc.bbp",
                    n,
                )
            header.add("unit", n, unit)
    top = _count_comments(text.lines)
    header.read_text(enumerate(text.lines[:top], 1), "a comment")
    factor = header.require_unit("the comments state no unit")
    rows = [line.split() for line in text.lines[top:]]
    for number, row in enumerate(rows, top + 1):
        if len(row) != _WIDTH:
            raise text.error(
                f"a time and three accelerations were expected, got {len(row)} words", number
            )
    if len(rows) < 2:
        raise text.error(f"at least two samples were expected, got {len(rows)}")
    words = [word for row in rows for word in row]
    values = convert_words(text, words, top, _WIDTH).reshape(-1, _WIDTH).T
    require_whole_end(text, words[_WIDTH - 1 :: _WIDTH])
    step = header.require_even_times(words[::_WIDTH], values[0], top + 1)
    return [
        Component(f"{str(text.path)!r} {channel}", factor, column, step, direction, channel)
        for (channel, direction), column in zip(_CHANNELS, values[1:], strict=True)
    ]


def _count_comments(lines: list[str]) -> int:
    """Count the lines above the numbers: comments, and empty ones."""
    numbers = (k for k, line in enumerate(lines) if not re.match(r"\s*(?:[#%]|$)", line))
    return next(numbers, len(lines))


def find_bbp_names(lines: list[str]) -> list[int]:
    """Find the lines of the comments that name the columns in order, by their numbers."""
    comments = [*enumerate(lines[: _count_comments(lines)], 1)]
    for patterns in ((_NAMES,), _COLUMNS):
        named = [n for p in patterns for n, line in comments if re.match(p, line, re.I)]
        if len(named) == len(patterns):
            return named
    return []
