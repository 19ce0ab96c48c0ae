"""Files .AT2 of the PEER databases: a header of about four lines, then one component.

PEER shows the layout at https://ngawest2.berkeley.edu. Older files, and those that programs
write after them, order number of values and step in other ways.
"""

import math
import re
from collections.abc import Iterable
from pathlib import Path

from ...tables import (
    NUMBER,
    TextFile,
    find_contents,
    find_unit_after,
    quote_word,
    read_fortran,
)
from .claims import Claims
from .components import Component, Direction
from .directions import Stated, find_name_direction, find_word_direction, settle_direction
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
    contents = find_contents(lines)
    if contents is not None:
        raise text.error(f"acceleration was expected, not {contents[1]}", contents[0])
    header.read_text(lines, "the header")
    return [header.read_component(top, direction)[0]]


def find_peer_direction(text: TextFile, paths: Iterable[Path]) -> Direction:
    """Find the direction by the name of the file among others, and by the title.

    Raises a `ValueError` if they disagree.
    """
    name = find_name_direction(text.path, paths)
    title = _find_title_direction(text.lines)
    direction = settle_direction(name, title)
    if direction is None:
        raise text.error(f"the component is {name} by its name, but {title} by its header")
    return direction


def _find_title_direction(lines: list[str]) -> Stated:
    """Find the direction of the component in the title: UP, DWN, 140, ..."""
    filled = [line for line in lines[:_HEADER_LINES] if line.strip()]
    if len(filled) < _TITLE_LINE:
        return ""
    # After the component the station's number may stand in brackets.
    title = re.sub(r"\s*\([^()]*\)\s*$", "", filled[_TITLE_LINE - 1])
    return find_word_direction(title.rpartition(",")[2].strip()) if "," in title else ""


def _read_points_and_step(text: TextFile, header: Header) -> int:
    """Add the number of values and the time step; return how many lines the header has."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        matches = (re.search(pattern, line.upper()) for pattern in _POINTS_AND_STEP)
        match = next(filter(None, matches), None)
        if match is None:
            continue
        header.add("points", number, match["points"])
        step = _parse_step(text, f"{match['step']} {match['tail']}".strip(), number)
        header.add_step(number, f"the header states DT= {step:.6g} s", step)
        return number
    raise text.error(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its"
        f" first {_HEADER_LINES} lines"
    )


def _parse_step(text: TextFile, words: str, line: int) -> float:
    """Convert a number and perhaps its unit, such as "10 MSEC", to a time step [s]."""
    value = re.match(NUMBER, words, re.I)
    # Whatever begins with no number is refused as it stands.
    word = value[0] if value else re.split(r"[\s,]", words)[0]
    step = read_fortran(word) if value else text.parse_number(word, line, "DT")
    step *= find_unit_after(words[len(word) :].lstrip())[1]
    if math.isnan(step):
        raise text.error(
            f"DT must be a number, if need be with a unit of time, got {quote_word(words)}",
            line,
        )
    if not 0 < step < math.inf:
        raise text.error(f"DT must be greater than 0, got {word}", line)
    return step
