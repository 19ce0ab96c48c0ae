"""Files of California's strong-motion program, volumes 1 and 2, as CESMD delivers them.

A channel has lines of text, integers and reals; then come accelerations, and in volume 2
velocities and displacements. The layout is described in Shakal and Huang (1985), "Standard tape
format for CSMIP strong-motion data tapes", report OSMS 85-03,
https://www.conservation.ca.gov/cgs/pages/program-smi/reports/other/osms85-03.aspx.
"""

import re

from ...tables import TextFile
from .components import Caller, Component, invert, make_component, require_number
from .fields import find, get_line, read_fixed, read_format

CSMIP_TITLE = r"^\s*(?:un)?corrected accelerogram"
# Of the first and of the second volume: lines above the values, the line with the channel, and how
# many numbers of which width a line has, where no format is stated.
_VOLUMES = {True: (27, 6, (8, 9)), False: (45, 7, (8, 10))}
_CHANNEL = r"^\s*chan *\d+: *(\w+)"
# The line above the values: how many they are, and of what.
_POINTS = r"^\s*(\d+) +(?:points of )?(accel|veloc|displ)"
_STEP = r" at +([\d.]+) *(pts/)?sec"
_UNIT = r" in (?:units of +)?([^\s(]+)|units: *([^\s)]+)"


def read_csmip(text: TextFile, caller: Caller, top: int) -> tuple[list[Component], int]:
    """Read a channel, and the index of the line after it."""
    title = find(text, top, CSMIP_TITLE, "the title of a channel")[0]
    length, channel_line, layout = _VOLUMES["un" in title.lower()]
    at = top + length
    components = []
    while not re.match(r"\W*end of data", get_line(text, at, "'End of data'"), re.I):
        points, quantity = find(text, at, _POINTS, "'7200 points of accel data ...'").groups()
        if re.search(r"\(\d", text.lines[at]):
            layout = read_format(text, at)
        values, end = read_fixed(text, at + 1, int(points), layout)
        if quantity.lower() == "accel":
            step, per_second = find(text, at, _STEP, "a time step").groups()
            number = require_number(text, step, at + 1)
            unit = find(text, at, _UNIT, "a unit")
            component = make_component(
                text,
                caller,
                values,
                unit=(unit[1] or unit[2]).strip("."),
                step=invert(number) if per_second else number,
                channel=find(text, top + channel_line, _CHANNEL, "'Chan 1: 360 Deg'")[1],
            )
            components.append(component)
        at = end
    return components, at + 1
