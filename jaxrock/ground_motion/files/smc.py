"""SMC files of the U.S. Geological Survey: headers of text, integers and reals, then values.

Everything stands in columns of fixed width. Accelerations are in cm/s2. The format is
described at https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html.
"""

import re

from ...tables import TextFile
from .components import Caller, Component, Direction, NotAcceleration, invert, make_component
from .fields import get_line, read_fixed

SMC_TITLE = r"\s*\d +(?:un)?(?:known|corr|velo|disp|resp|four)"
_COMPONENT = r"component *= *(\S+)"
# Below 11 lines of text: where they stand among the integers and the reals.
_INTEGERS, _TILT, _COMMENTS, _POINTS = 11, 12, 15, 16
_REALS, _RATE = 17, 1
_VALUES = 27
# No number that is there is as large as that for missing ones.
_MISSING = 1e30
# Degrees from upward.
_TILTS: dict[int, Direction] = {0: "up", 90: "level", 180: "down"}


def read_smc(text: TextFile, caller: Caller, _: int) -> tuple[list[Component], int]:
    """Read the component of a file."""
    if not re.match(r"\s*[12] +(?:un)?corrected accel", text.lines[0], re.I):
        raise NotAcceleration(str(text.error(f"it holds {text.lines[0].strip()!r}")))
    channel = re.search(_COMPONENT, get_line(text, 5, "the component"), re.I)
    integers, _ = read_fixed(text, _INTEGERS, 48, (8, 10))
    reals, _ = read_fixed(text, _REALS, 50, (5, 15))
    if reals[_RATE] > _MISSING:
        raise text.error(
            "pairs of time and acceleration have no uniform step: take volume 2", 18
        )
    top = _VALUES + max(int(integers[_COMMENTS]), 0)
    # Some programs write more digits.
    is_long = re.match(r"\s*-?\d\.\d{7}E", get_line(text, top, "the values"), re.I)
    layout = (5, 14) if is_long else (8, 10)
    values, end = read_fixed(text, top, int(integers[_POINTS]), layout)
    if end < len(text.lines):
        raise text.error(
            f"the header states {values.size} values, but more lines follow", end + 1
        )
    component = make_component(
        text,
        caller,
        values,
        unit="cm/s2",
        step=invert(float(reals[_RATE])),
        channel=channel[1] if channel else "",
        direction=_TILTS.get(int(integers[_TILT])),
    )
    return [component], end
