"""Files .bbp of SCEC's Broadband Platform: comments, then times and three components.

The columns are separated by blanks or tabs. The platform is described at
https://github.com/SCECcode/bbp/wiki.
"""

import re

import numpy as np

from ...tables import TextFile, parse_unit, require_whole_end
from .claims import Claims
from .components import Component, Direction
from .headers import Header

_COMMENT = r"\s*[#%]"
_UNIT = r"\s*\((?P<unit>[^)]*)(?:\)|$)"
# In one line, such as "# time(sec) N-S(cm/s/s) E-W(cm/s/s) U-D(cm/s/s)".
_NAMES = r"\W*time\s*\(s(?:ec)?\)\s+N-?S\b.*\bE-?W\b.*\bU(?:-?D|P)\b"
# Or in several, such as "# Column 2: North-south acceleration (cm/s/s)".
_COLUMN = r"\W*column\s+[234]:\s*(?:north-south|east-west|up-down)\s"
# The first column has the times; the third component points up.
_CHANNELS: tuple[tuple[str, Direction], ...] = (("NS", "level"), ("EW", "level"), ("UD", "up"))
_WIDTH = 1 + len(_CHANNELS)
# As many are enough to see how numbers are printed.
_LAST_LINES = 200


def recognize_bbp(lines: list[str]) -> bool:
    """Return whether the comments above the numbers name the columns of the platform."""
    return any(re.match(f"{_NAMES}|{_COLUMN}", line, re.I) for line in _get_comments(lines))


def read_bbp(text: TextFile, claims: Claims) -> list[Component]:
    """Read the three components."""
    comments = _get_comments(text.lines)
    header = Header(text, claims)
    for n, line in enumerate(comments, 1):
        if not re.match(f"{_NAMES}|{_COLUMN}", line, re.I):
            continue
        for match in re.finditer(
            rf"(?:N-?S|E-?W|U-?D|UP|acceleration|velocity){_UNIT}", line, re.I
        ):
            if parse_unit(match["unit"]).dimension == "velocity" or re.fullmatch(
                "cm/?", match["unit"]
            ):
                raise text.error(
                    f"the columns are velocities in {match['unit']}: take the accelerations,"
                    " which the platform writes beside them, in a file .acc.bbp",
                    n,
                )
            header.add("unit", n, match["unit"])
    top = len(comments)
    factor = header.require_unit("the comments state no unit")
    values = _read_columns(text, top)
    words = [line.split()[0] for line in text.lines[top:] if line.strip()]
    step = header.require_even_times(words, values[0], top + 1)
    return [
        Component(f"{str(text.path)!r} {channel}", factor, column, step, direction, channel)
        for (channel, direction), column in zip(_CHANNELS, values[1:], strict=True)
    ]


def _get_comments(lines: list[str]) -> list[str]:
    """Return the comments above the numbers, with empty lines among them."""
    top = next((k for k, line in enumerate(lines) if not _is_comment(line)), len(lines))
    return lines[:top]


def _is_comment(line: str) -> bool:
    """Return whether a line is a comment, or empty."""
    return not line.strip() or re.match(_COMMENT, line) is not None


def _read_columns(text: TextFile, top: int) -> np.ndarray:
    """Read the columns below line `top`, times first, shape (4, samples)."""

    def parse_all(lines: list[str]) -> np.ndarray:
        words = [line.split() for line in lines]
        if any(len(row) != _WIDTH for row in words) or any("_" in line for line in lines):
            raise ValueError
        return np.array(words, dtype=float).ravel()

    def parse_line(line: str, number: int) -> list[float]:
        words = line.split()
        if len(words) != _WIDTH:
            raise text.error(
                f"a time and {_WIDTH - 1} accelerations were expected, got {len(words)} words",
                number,
            )
        return [text.parse_number(word, number) for word in words]

    values = text.read_values(top, parse_all, parse_line).reshape(-1, _WIDTH).T
    if values.shape[1] < 2:
        raise text.error(f"at least two samples were expected, got {values.shape[1]}")
    require_whole_end(text, [line.split()[-1] for line in text.lines[top:][-_LAST_LINES:]])
    return values
