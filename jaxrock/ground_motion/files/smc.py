"""SMC files of the U.S. Geological Survey: headers of text, integers and reals, then values.

Everything stands in columns of fixed width. Accelerations are in cm/s2. The format is
described at https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html.
"""

import re

from ...oldtables import TextFile, quote_word
from .claims import Claims
from .components import Component, Direction
from .fixed_columns import Columns, get_line
from .headers import Header

# The first line says what the file holds.
_ACCELERATION = r"\s*[12]\s+(?:un)?corrected accelerogram"
_COMPONENT_LINE = 5
_COMPONENT = r"(?:.*\bcomponent\s*=\s*(?P<channel>\S+))?"
# Below 11 lines of text: index of the line, how many numbers, their columns, and what they
# state, from index 0 on.
_INTEGERS = 11
_REALS = 17
_BLOCKS = {
    _INTEGERS: (48, Columns(8, 10), {12: "code", 15: "comments", 16: "points"}),
    _REALS: (50, Columns(5, 15), {1: "rate", 29: "peak", 31: "peak"}),
}
_COMMENTS = 27
# No number that is there is as large as that for missing ones.
_NO_REAL = 1e30
# Some programs write more digits.
_VALUES = Columns(8, 10)
_LONG_VALUES = Columns(5, 14)
# Degrees from upward, and names of components that are no azimuths.
_TILTS: dict[int, Direction] = {0: "up", 90: "level", 180: "down"}
_NAMES: dict[str, Direction] = {"u": "up", "d": "down", "ne|nw|se|sw": "level"}
_SILENT: dict[str, Direction] = {".*": ""}


def read_smc(text: TextFile, claims: Claims) -> list[Component]:
    """Read the component of a file."""
    kind = text.lines[0].strip()
    if not re.match(_ACCELERATION, kind, re.I):
        raise text.error(f"an accelerogram was expected, this is {quote_word(kind)}", 1)
    header = Header(text, claims, _NAMES, _TILTS)
    header.read_line(_COMPONENT_LINE, _COMPONENT, "a line with the component")
    for at, (count, columns, names) in _BLOCKS.items():
        # The first number stands for all that are missing: -32768 and 1.7e38.
        word = get_line(text, at, "the headers")[: columns.width]
        missing = text.parse_number(word, at + 1)
        if not (missing < 0 if at == _INTEGERS else missing >= _NO_REAL):
            kind = "integer" if at == _INTEGERS else "real"
            raise text.error(f"the first {kind} must mark missing values", at + 1)
        header.read_numbers(at, count, columns, names, missing)
    if "rate" not in header.fields:
        raise text.error(
            "the header states no sampling rate, so that the values are pairs of time and"
            " acceleration: take the corrected record, which has a uniform step",
            _REALS + 1,
        )
    header.add_unit(1, "an SMC file is in cm/s2", "cm/s2")
    top = _COMMENTS
    while top < len(text.lines) and text.lines[top].startswith("|"):
        top += 1
    header.read_text(enumerate(text.lines[_COMMENTS:top], _COMMENTS + 1), "a comment")
    stated = header.find("comments")
    count = max(stated.value, 0) if stated else 0
    if count != top - _COMMENTS:
        raise text.error(
            f"the header states {count:g} lines of comments, but {top - _COMMENTS} begin with |",
            _INTEGERS + 2,
        )
    if len(header.fields.get("peak", [])) < 2:
        # One alone may be the smaller of both.
        header.fields.pop("peak", None)
    if "code" in header.fields:
        # Beside the degrees, a name that is not understood says nothing.
        header.names = _NAMES | _SILENT
    first = get_line(text, top, "the values")
    columns = _LONG_VALUES if re.match(r"\s*-?\d\.\d{7}E", first, re.I) else _VALUES
    component, end = header.read_component(top, columns)
    if end < len(text.lines):
        points = header.fields["points"][0].words
        raise text.error(f"the header states {points} values, but more lines follow", end + 1)
    return [component]
