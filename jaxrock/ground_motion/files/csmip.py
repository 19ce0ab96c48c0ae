"""Files of California's strong-motion program, volumes 1 and 2, as CESMD delivers them.

A channel has lines of text, integers and reals; then come accelerations, and in volume 2
velocities and displacements. In volume 1 pairs of time and acceleration may stand instead,
from film that was digitized, and in all files of RENADIC, the network of Chile's university.
The layout is described in Shakal and Huang (1985), "Standard tape format for CSMIP
strong-motion data tapes", report OSMS 85-03,
https://www.conservation.ca.gov/cgs/pages/program-smi/reports/other/osms85-03.aspx.
"""

import re
from typing import NamedTuple

from ...oldtables import TextFile
from ..units import convert_unit
from .claims import Claims
from .components import Component, Direction
from .fixed_columns import Columns, Numbers, get_line, match_line, parse_format, read_numbers
from .headers import DECIMAL, Header, Numbered, read_channels

_RAW = "uncorrected accelerogram data"
_CORRECTED = "corrected accelerogram"
_DURATION = rf".*\brecord\s+length\s*=\s*(?P<duration>{DECIMAL})\s*sec"
_CHANNEL = r"\s*chan\s*(?P<number>\d+):\s*(?P<channel>\d+(?=\s*deg)|[a-z]\w*)"
# A line before the values of a quantity. Unit and format stand in either of two ways.
_DATA = (
    rf"\s*(?P<points>\d+)\s+(?:accelerogram\s+points\s+at\s+(?P<rate>{DECIMAL})\s*pts/sec"
    r"|points\s+of\s+(?P<quantity>accel|veloc|displ)\s+data\s+equally[\s-]+spaced\s+at\s+"
    rf"(?P<step>{DECIMAL})\s*sec\.?)\s*"
    r"(?:,?\s*in\s+(?:units\s+of\s+)?(?P<unit>[^\s(]+?)\s*\.?\s*(?:format:)?\s*"
    r"(?P<format>\(.*)?|\(units:\s*(?P<unit_2>[^\s)]+?)\.?\s*\)\s*)$"
)
_PAIRS_LINE = 11
_PAIRS_UNIT = r"\s*units\s+of\s+uncor\s+\w+\s+are\s+sec\s+and\s+(?P<unit>g/10|g)\b"
# The second line of the integers, and the place of the orientation in it.
_INTEGERS = Columns(16, 5)
_ORIENTATION = 10


class _Volume(NamedTuple):
    """A layout."""

    # Lines of text, and lines of integers and reals below them.
    text: int
    headers: int
    # Columns of the values, where no format is stated.
    columns: Columns
    # By the index of the line in the text, what stands there.
    statements: dict[int, str]


_FIRST = _Volume(
    13,
    14,
    Columns(8, 9),
    {
        6: _CHANNEL,
        10: rf"\s*no\. of points\s*=\s*(?P<points>\d+)\b{_DURATION}"
        rf"(?:\s+at\s+(?P<rate>{DECIMAL})\s+samples/sec)?",
        11: rf".*\bmax\s*=\s*(?P<peak>{DECIMAL})\s*(?P<peak_unit>[^\s,]+)\s*,?\s+at\b",
    },
)
_SECOND = _Volume(
    25,
    20,
    Columns(8, 10),
    {
        7: _CHANNEL,
        11: _DURATION,
        15: r"\s*(?P<points>\d+)\s+points\b",
        16: rf"\s*at\s+equally[\s-]+spaced\s+intervals\s+of\s+(?P<step>{DECIMAL})\s*sec",
        17: rf"\s*peak\s+acceleration\s*=\s*(?P<peak>{DECIMAL})\s*(?P<peak_unit>\S+)\s+at\b",
    },
)
# Five pairs of time and acceleration in a line.
_PAIRS = Columns(10, 7)

# RENADIC writes V for the vertical channel, which points up as in the names of other files, and
# INTC for another sensor beside three.
_NAMES: dict[str, Direction] = {"v": "up", "intc": ""}
# Orientations in the integers. Any other number says nothing.
_AZIMUTHS = range(1, 361)
_CODES: dict[int, Direction] = {500: "up", 600: "down"}

# The title of volume 1; in volume 2 it stands below another title.
CSMIP_TITLE = rf"\s*(?:{_CORRECTED}.*\n\s*)?{_RAW}"


def read_csmip(text: TextFile, claims: Claims) -> list[Component]:
    """Read the accelerations of all channels."""
    return read_channels(text, claims, _read_channel, "CSMIP")


def _read_channel(text: TextFile, claims: Claims, top: int) -> tuple[list[Numbered], int]:
    """Read a channel, and the index of the line after it."""
    match_line(text, top, rf"\s*(?:{_RAW}|{_CORRECTED})\b", "the title of a channel")
    volume = _FIRST
    if text.lines[top].lower().lstrip().startswith(_CORRECTED):
        volume = _SECOND
        match_line(text, top + 1, rf"\s*{_RAW}\b", "the title of the uncorrected data")
    at = top + volume.text + volume.headers
    numbered: list[Numbered] = []
    while not re.match(r"\W*end of data\b", get_line(text, at, "'End of data'"), re.I):
        header = Header(text, claims, _NAMES, _CODES)
        has_pairs = volume is _FIRST and re.match(r"[\s\d.-]+$", text.lines[at])
        columns = volume.columns
        if not has_pairs:
            expected = "a line such as '7200 points of accel data equally spaced at ...'"
            header.read_line(at, _DATA, expected)
            at += 1
            if stated := header.find("format"):
                columns = parse_format(text, stated.words, at)
            quantity = header.find("quantity")
            if quantity and quantity.words.lower() != "accel":
                at += -(-int(header.fields["points"][0].value) // columns.number)
                continue
        for line, pattern in volume.statements.items():
            expected = "what the header states of channel, points, duration, step and peak"
            header.read_line(top + line, pattern, expected)
        integers = top + volume.text + 1
        header.read_numbers(integers, _INTEGERS.number, _INTEGERS, {_ORIENTATION: "sensor"})
        line, word, code = header.fields["sensor"][0]
        if code in _AZIMUTHS or code in _CODES:
            header.add("azimuth" if code in _AZIMUTHS else "code", line, word)
        if has_pairs:
            component, at = _read_pairs(text, header, top, at)
        else:
            component, at = header.read_component(at, columns)
        numbered.append((header.fields["number"][0].words, component))
    return numbered, at + 1


def _read_pairs(text: TextFile, header: Header, top: int, at: int) -> tuple[Component, int]:
    """Read pairs of time and acceleration, from the line with index `at` on."""
    expected = "a line 'Units of uncor accel are sec and g/10'"
    unit = match_line(text, top + _PAIRS_LINE, _PAIRS_UNIT, expected)["unit"]
    factor = convert_unit("g") * (0.1 if unit.endswith("/10") else 1.0)
    header.add_unit(top + _PAIRS_LINE + 1, f"the header states {unit}", factor)
    points = header.require_points()
    factor = header.require_unit()
    numbers = read_numbers(text, at, 2 * points, _PAIRS)
    step = header.require_even_times(numbers.words[::2], numbers.values[::2], at + 1)
    header.require_duration(points, step)
    numbers = Numbers(numbers.words[1::2], numbers.values[1::2], numbers.end)
    header.require_peak(numbers, factor)
    return header.make_component(factor, numbers.values, step), numbers.end
