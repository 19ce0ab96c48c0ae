"""Files in the COSMOS format, volumes 1 and 2, of strong-motion networks in America.

A channel has lines of text, integers, reals, comments, and then one quantity. The format is
described in "COSMOS Strong Motion Data Format, Version 1.20" (2001),
https://www.strongmotioncenter.org/vdc/cosmos_format_1_20.pdf.
"""

import re

from ...oldtables import TextFile
from .claims import Claims
from .components import Component, Direction
from .fixed_columns import match_line, parse_format
from .headers import NO_COUNTS, Header, Numbered, read_channels

_TITLE = r".*\(format v\d+\.\d+ with\s+(?P<text_lines>\d+) text lines\)"
_QUANTITY = r"acceleration|velocity|displacement"
_CHANNEL = r"\s*sta\s+cha\w*:?\s*(?P<number>[^\s:]+)\s*:\s*(?P<channel>\d+(?=\s*deg)|[a-z]\w*)"
_CHANNEL_LINE = 8
_BLOCK = r"\s*(\d+)\s+{}-header values follow on\s+\d+\s+lines\s*,\s*format\s*=(.*)$"
_COMMENTS = r"\s*(\d+)\s+comment line\(s\) follow"
# The line above the values.
_DATA = (
    r"\s*(?P<points>\d+)\s+(?P<quantity>[a-z]+(?:[\s.]+[a-z]+)*)[.\s]+pts,"
    r"\s*approx\s+(?P<seconds>\d+)\s+secs,\s*units\s*=\s*(?P<unit>[^\s(,]+)"
    r"\s*(?:\(\s*(?P<unit_code>\d+)\s*\))?\s*,?\s*format\s*=(?P<format>.*)$"
)
# Station, channel, network and location; the channel's last letter is its direction.
_SCNL = r"^[ \t]*\|[ \t]*<SCNL>[ \t]*[^.\s]*\.(\w+)\."

# What stands where in the integers and in the reals, from index 0 on.
_BLOCKS = {
    "integer": {1: "parameter", 2: "unit_code", 53: "sensor", 54: "relative"},
    # Of the values, not of the recorder, whose step is at 33: they may have been resampled.
    "real": {61: "milliseconds", 62: "duration", 63: "peak"},
}
_UNKNOWN = -999.0

_ACCELERATION = 1
# Codes of units.
_COUNTS = 50
_UNIT_CODES = {2: "g", 4: "cm/s2", 7: "in/s2", 10: "gal", 11: "mg"}
# Codes of orientations: azimuths from 1 to 360, up and down, radial, tangential and others.
_AZIMUTHS = range(1, 361)
_VERTICAL = 402
_ORIENTATIONS: dict[int, Direction] = {400: "up", 401: "down"}
_ORIENTATIONS |= dict.fromkeys((*_AZIMUTHS, 500, 501, 600, 601, 700, 701), "level")
_OTHER = "othe?r"


def read_cosmos(text: TextFile, claims: Claims) -> list[Component]:
    """Read the accelerations of all channels."""
    return read_channels(text, claims, _read_channel, "COSMOS")


def _read_channel(text: TextFile, claims: Claims, top: int) -> tuple[list[Numbered], int]:
    """Read a channel, unless it is a velocity, and the index of the line after it."""
    header = Header(text, claims, {_OTHER: ""}, _ORIENTATIONS)
    header.read_line(top, _TITLE, "the title of a channel with (Format v01.20 ...)")
    lines = int(header.fields["text_lines"][0].value)
    if lines <= _CHANNEL_LINE:
        raise text.error(f"at least 9 text lines were expected, got {lines}", top + 1)
    header.read_line(top + _CHANNEL_LINE, _CHANNEL, "a line such as 'Sta Chan 1: 360 deg'")
    at = top + lines
    for kind, names in _BLOCKS.items():
        match = match_line(text, at, _BLOCK.format(kind), f"the {kind} header")
        count = int(match[1])
        if count <= max(names):
            raise text.error(
                f"at least {max(names) + 1} {kind} values were expected, got {count}", at + 1
            )
        columns = parse_format(text, match[2], at + 1)
        at = header.read_numbers(at + 1, count, columns, names, _UNKNOWN)
    data = at + 1 + int(match_line(text, at, _COMMENTS, "the number of comment lines")[1])
    for k in range(at + 1, data):
        match_line(text, k, r"\s*\|", "a comment that begins with |")
    header.read_line(data, _DATA, "a line such as '7200 acceleration pts, approx ...'")
    columns = parse_format(text, header.fields["format"][0].words, data + 1)
    quantity = header.fields["quantity"][0].words.lower()
    numbered: list[Numbered] = []
    if quantity in ("velocity", "displacement"):
        end = data + 1 + -(-int(header.fields["points"][0].value) // columns.number)
    else:
        _add_units(text, header)
        if quantity != "acceleration":
            raise text.error(f"acceleration was expected, got {quantity!r}", data + 1)
        channel, direction = _find_orientation(
            text, header, "\n".join(text.lines[at + 1 : data])
        )
        component, end = header.read_component(data + 1, columns)
        component = component._replace(channel=channel, direction=direction)
        numbered = [(header.fields["number"][0].words, component)]
    pattern = rf"\W*end[\s-]of[\s-]data\b(?:.*\b{quantity}\b|(?!.*(?:{_QUANTITY})))"
    match_line(text, end, pattern, f"'End-of-data for ... {quantity}'")
    return numbered, end + 1


def _add_units(text: TextFile, header: Header) -> None:
    """Add units that are stated by words and by codes; an error for counts."""
    parameter = header.find("parameter")
    if parameter is not None and parameter.value != _ACCELERATION:
        raise text.error(
            f"parameter 1, acceleration, was expected, got {parameter.words}", parameter.line
        )
    # By its words first, with which the codes have to agree.
    header.require_unit()
    for line, word, code in header.fields.get("unit_code", []):
        if code == _COUNTS:
            raise text.error(NO_COUNTS, line)
        header.add_unit(line, f"the header states unit {word}", _UNIT_CODES.get(int(code), ""))


def _find_orientation(text: TextFile, header: Header, comments: str) -> tuple[str, Direction]:
    """Find a channel's name and direction, which text, integers and comments state."""
    line, name, _ = header.fields["channel"][0]
    # Where no azimuth is known, for which USGS writes 0, there may be an orientation in the
    # structure.
    sensor = header.find("sensor")
    code = sensor if sensor and sensor.value != 0 else header.find("relative")
    if name.lower() == "vert" or (code and code.value == _VERTICAL):
        raise text.error("the channel is vertical, but not said to point up or down", line)
    if code and code.value != 0:
        is_azimuth = code is sensor and code.value in _AZIMUTHS
        header.add("azimuth" if is_azimuth else "code", code.line, code.words)
    direction = header.require_direction()
    channel = name
    for match in re.finditer(_SCNL, comments, re.I | re.M):
        # In the codes of seismic channels, Z is vertical and points up.
        code_of_seed = match[1].upper()
        is_up = code_of_seed.endswith("Z")
        if is_up and direction == "level":
            raise text.error(
                f"the text states {name}, but the channel is {code_of_seed}", line
            )
        direction = direction or ("up" if is_up else "")
        if re.fullmatch(_OTHER, name, re.I):
            channel = code_of_seed
    return channel, direction
