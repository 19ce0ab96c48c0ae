"""Files .AT2 of the PEER databases: a header of about four lines, then one component.

PEER shows the layout at https://ngawest2.berkeley.edu. Older files, and those that programs
write after them, order number of values and step in other ways.
"""

import re

from ...tables import TextFile, parse_unit
from .components import (
    Caller,
    Component,
    Direction,
    NotAcceleration,
    find_direction,
    make_component,
    require_number,
)
from .fields import read_free

_HEADER_LINES = 20  # at most; usually there are four
_POINTS = r"\bNPTS *= *(\d+)|^\s*(\d+)[\s,]+\S+[\s,]+NPTS"
_STEP = r"\bDT *= *([\d.E+-]+) *([A-Z]*)|^\s*\d+[\s,]+([\d.E+-]+)"
_CONTENTS = r"\b(ACC|VEL|DISP|SPECTR)\w*"
_UNIT = r"\bUNITS OF ([^\s.,;]+)"
# The end of the file's name, perhaps with the code of a location behind.
_VERTICAL = r"(-(?i:UP|DWN|UD|V)|UP|DWN|UD|Z)(?:\.\d\d)?$"


def read_at2(text: TextFile, caller: Caller, _: int) -> tuple[list[Component], int]:
    """Read the component of a file."""
    head = [line.upper() for line in text.lines[:_HEADER_LINES]]
    at = next((k for k, line in enumerate(head) if re.search(_POINTS, line)), len(head) - 1)
    points = re.search(_POINTS, head[at])
    step = re.search(_STEP, head[at])
    if points is None or step is None:
        raise text.error("'NPTS= ..., DT= ...' or '... NPTS, DT' was expected in an .AT2 file")
    # In the title any word may stand.
    stated = "\n".join(head[min(2, at - 1) : at])
    contents = re.search(_CONTENTS, stated)
    if contents and contents[1] != "ACC":
        raise NotAcceleration(str(text.error(f"its header states {contents[0].lower()}")))
    unit = re.search(_UNIT, stated)
    # "DT= .01 NPTS= 400" has no unit of the step.
    seconds = parse_unit(step[2] if step[2] not in (None, "", "NPTS") else "s")
    component = make_component(
        text,
        caller,
        read_free(text, at + 1, int(points[1] or points[2])),
        unit=unit[1] if unit else "",
        step=require_number(text, step[1] or step[3], at + 1) * seconds.factor,
        direction=_find_direction(text, head[min(1, at)]),
    )
    return [component], len(text.lines)


def _find_direction(text: TextFile, title: str) -> Direction:
    """Find the direction that the end of the title states, or else of the file's name."""
    word = title.rpartition(",")[2].partition("(")[0].strip(" .")
    end = re.search(_VERTICAL, text.path.stem)
    return find_direction(word) or find_direction(end[1].lstrip("-") if end else "")
