"""Files .AT2 of the PEER databases: a header of about four lines, then one component.

PEER shows the layout at https://ngawest2.berkeley.edu. Older files, and those that programs
write after them, order number of values and step in other ways.
"""

import math
import re
from collections.abc import Iterable
from pathlib import Path

from ...oldtables import TextFile, find_contents, find_steps, quote_word
from .claims import Claims
from .components import Component, Direction
from .directions import find_name_direction, find_word_direction, settle_direction
from .headers import Header

# At most; usually there are four.
_HEADER_LINES = 20
_TITLE_LINE = 2
# "NPTS= 400, DT= .01 SEC", "DT= .01 NPTS= 400" and "400 .01 NPTS, DT". What follows the name
# DT may be a unit; in the first two forms that belongs to the step.
_POINTS_AND_STEP = (
    r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>\S.*)(?P<tail>)$",
    r"\bDT\s*=\s*(?P<step>\S.*?)[\s,]+NPTS\s*=\s*(?P<points>[^\s,]+)(?P<tail>)",
    r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b(?P<tail>.*)$",
)


def read_peer(text: TextFile, claims: Claims, paths: Iterable[Path] = ()) -> list[Component]:
    """Read the component in an .AT2 file, which may lie beside other files, the `paths`."""
    direction = find_peer_direction(text, paths)
    header = Header(text, claims)
    top = _read_points_and_step(text, header)
    lines = [*enumerate(text.lines[:top], 1)]
    if contents := find_contents(lines):
        raise text.error(f"acceleration was expected, not {contents[1]}", contents[0])
    header.read_text(lines, "the header")
    component, _ = header.read_component(top)
    return [component._replace(direction=direction)]


def find_peer_direction(text: TextFile, paths: Iterable[Path]) -> Direction:
    """Find the direction by the file's name among others, and by the title, which must agree."""
    name = find_name_direction(text.path, paths)
    filled = [line for line in text.lines[:_HEADER_LINES] if line.strip()]
    # The component ends the title, such as UP or 140; the station's number may stand behind it
    # in brackets.
    title = re.sub(r"\s*\([^()]*\)\s*$", "", "".join(filled[_TITLE_LINE - 1 : _TITLE_LINE]))
    stated = find_word_direction(title.rpartition(",")[2].strip()) if "," in title else ""
    direction = settle_direction(name, stated)
    if direction is None:
        raise text.error(f"the component is {name} by its name, but {stated} by its header")
    return direction


def _read_points_and_step(text: TextFile, header: Header) -> int:
    """Add the number of values and the time step; return how many lines the header has."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        matches = (re.search(pattern, line.upper()) for pattern in _POINTS_AND_STEP)
        match = next(filter(None, matches), None)
        if match is None:
            continue
        header.add("points", number, match["points"])
        # The number and perhaps its unit, such as "10 MSEC".
        words = f"{match['step']} {match['tail']}".strip()
        _, step = next(iter(find_steps(f"DT= {words}")), ("", math.nan))
        if not 0 < step < math.inf:
            raise text.error(f"DT must be a time above 0, got {quote_word(words)}", number)
        stated = f"the header states DT= {step:.6g} s"
        header.claims = header.claims.add_step(number, stated, step)
        return number
    raise text.error(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )
