"""Files in the COSMOS format, volumes 1 and 2, of strong-motion networks in America.

A channel has lines of text, integers, reals, comments, and then one quantity. The format is
described in "COSMOS Strong Motion Data Format, Version 1.20" (2001),
https://www.strongmotioncenter.org/vdc/cosmos_format_1_20.pdf.
"""

import re

from ...tables import TextFile
from .components import Caller, Component, Direction, make_component
from .fields import find, read_fixed, read_format

COSMOS_TITLE = r".*\(Format v\d+\.\d+ with +(\d+) text lines\)"
# The line with number and name of the channel, and the line above the values.
_CHANNEL_LINE = 8
_CHANNEL = r"^\s*Sta +Cha\w*:?\s*[^\s:]+\s*: *(\w+)"
# Station, channel, network and location, in a comment.
_SCNL = r"<SCNL>[^.]*\.(\w+)\."
_DATA = r"^\s*(\d+)\s+(\w+)[\w .]* pts"
# Where they stand: the step [ms] among the reals, the orientation among the integers.
_MILLISECONDS, _SENSOR = 61, 53
# Codes of orientations beside azimuths from 1 to 360.
_ORIENTATIONS: dict[int, Direction] = {400: "up", 401: "down", 402: ""}
_UNKNOWN = -999.0


def read_cosmos(text: TextFile, caller: Caller, top: int) -> tuple[list[Component], int]:
    """Read a channel, unless it is a velocity, and the index of the line after it."""
    lines = int(find(text, top, COSMOS_TITLE, "a title with (Format v01.20 ...)")[1])
    channel = find(text, top + _CHANNEL_LINE, _CHANNEL, "'Sta Chan 1: 360 deg'")[1]
    at = top + lines
    blocks = []
    for _ in ("integers", "reals"):
        count = int(find(text, at, r"^\s*(\d+) \w+-header values", "a header of numbers")[1])
        values, at = read_fixed(text, at + 1, count, read_format(text, at))
        blocks.append(values)
    integers, reals = blocks
    if len(integers) <= _SENSOR or len(reals) <= _MILLISECONDS:
        raise text.error("the headers of numbers are too short", at)
    data = at + 1 + int(find(text, at, r"^\s*(\d+) +comment line", "comment lines")[1])
    seed = re.search(_SCNL, "".join(text.lines[at:data]))
    if seed and channel.lower() == "other":
        channel = seed[1]
    points, quantity = find(text, data, _DATA, "'7200 acceleration pts, approx ...'").groups()
    unit = find(text, data, r"units *= *([^\s(,]+)", "a unit")[1]
    values, end = read_fixed(text, data + 1, int(points), read_format(text, data))
    find(text, end, r"^\W*end[ -]of[ -]data", "'End-of-data'")
    if quantity.lower() in ("velocity", "displacement"):
        return [], end + 1
    if quantity.lower() != "acceleration":
        raise text.error(f"acceleration was expected, got {quantity!r}", data + 1)
    step = float(reals[_MILLISECONDS])
    component = make_component(
        text,
        caller,
        values,
        unit=unit,
        step=None if step == _UNKNOWN else step / 1000,
        channel=channel,
        direction=_ORIENTATIONS.get(int(integers[_SENSOR])),
    )
    return [component], end + 1
