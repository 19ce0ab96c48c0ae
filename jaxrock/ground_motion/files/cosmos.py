"""Files in the COSMOS format, volumes 1 and 2, of strong-motion networks in America."""

import functools
import math
import re

from .components import Component, Direction
from .fixed_columns import (
    Numbers,
    match_line,
    parse_format,
    read_channels,
    read_numbers,
    refuse_counts,
    require_duration,
    require_peak,
)
from .text import STEP, UNIT, RecordText, Statements
from .units import UNITS, parse_unit

_TITLE = r".*\(format v\d+\.\d+ with\s+(\d+) text lines\)"
_HEADER = r"\s*(\d+)\s+{}-header values follow on\s+\d+\s+lines\s*,\s*format\s*=(.*)$"
_COMMENTS = r"\s*(\d+)\s+comment line\(s\) follow"
_QUANTITY = r"acceleration|velocity|displacement"
_DATA = (
    rf"\s*(?P<points>\d+)\s+(?P<quantity>{_QUANTITY})\s+pts,"
    r"\s*approx\s+(?P<duration>\d+)\s+secs,\s*units\s*=\s*(?P<unit>[^\s(,]+)"
    r"\s*(?:\(\s*(?P<code>\d+)\s*\))?\s*,?\s*format\s*=(?P<format>.*)$"
)
_CHANNEL = r"\s*sta\s+cha\w*:?\s*(?P<number>[^\s:]+)\s*:\s*(?P<name>\d+(?=\s*deg)|[a-z]\w*)"
# Station, channel, network and location; the channel's last letter is its direction.
_SCNL = r"\s*\|\s*<SCNL>\s*[^.\s]*\.(\w+)\."

# Codes of units and of orientations in tables of the format; azimuths are from 1 to 360.
_COUNTS = 50
_UNIT_CODES = {2: "g", 4: "cm/s2", 10: "gal", 11: "mg"}
_ORIENTATIONS: dict[int, Direction] = {400: "up", 401: "down"}
_ORIENTATIONS |= dict.fromkeys((*range(1, 361), 500, 501, 600, 601, 700, 701), "level")
_NAMES: dict[str, Direction] = {"up": "up", "down": "down", "other": "", "othr": ""}
_NAMES |= dict.fromkeys(("h1", "h2", "radl", "tran", "long", "tang"), "level")
_VERTICAL = 402, "vert"
_UNKNOWN = -999


def recognize_cosmos(lines: list[str]) -> bool:
    """Tell the COSMOS format by the version in the title."""
    return re.match(r".*\(format v\d+\.\d+ with\b", lines[0], re.I) is not None


def read_cosmos(text: RecordText, units: Statements, steps: Statements) -> list[Component]:
    """Read the accelerations of all channels, where the caller states `units` and `steps`."""
    read_channel = functools.partial(_read_channel, units, steps)
    return read_channels(text, read_channel, "COSMOS")


def _read_channel(
    units: Statements,
    steps: Statements,
    text: RecordText,
    top: int,
    found: list[tuple[str, Component]],
) -> int:
    """Read a channel into `found`, unless it is a velocity; return the index after it."""
    title = match_line(text, top, _TITLE, "the title of a channel with (Format v01.20 ...)")
    lines = int(title[1])
    text.refuse(lines < 9, f"at least 9 text lines were expected, got {lines}", top + 1)
    integers = _read_header(text, top + lines, "integer", 55)
    reals = _read_header(text, integers.end, "real", 65)
    comments = match_line(text, reals.end, _COMMENTS, "the number of comment lines")
    at = reals.end + 1
    data = at + int(comments[1])
    for k in range(at, data):
        match_line(text, k, r"\s*\|", "a comment that begins with |")
    match = match_line(text, data, _DATA, "a line such as '7200 acceleration pts, approx ...'")
    points = int(match["points"])
    columns = parse_format(text, match["format"], data + 1)
    quantity = match["quantity"].lower()
    if quantity != "acceleration":
        end = data + 1 + -(-points // columns.number)
        return _end_channel(text, end, quantity)
    parameter = int(integers.values[1])
    wrong = parameter not in (1, _UNKNOWN)
    text.refuse(
        wrong,
        f"the integer header states parameter {parameter}, which is not 1 for acceleration",
        top + lines + 2,
    )
    factor = _find_unit(text, data + 1, match, int(integers.values[2]), units)
    step = _find_step(text, data + 1, reals, steps)
    # The line has whole seconds, rounded in one way or another.
    require_duration(text, (data + 1, match["duration"], 1.0), points, step)
    if reals.values[62] != _UNKNOWN:
        require_duration(text, (data + 1, reals.words[62], 0.0), points, step)
    numbers = read_numbers(text, data + 1, points, columns)
    if reals.values[63] != _UNKNOWN:
        require_peak(text, (data + 1, reals.words[63], factor), numbers, factor)
    number, channel, direction = _find_orientation(
        text, top + 8, integers, text.lines[at:data]
    )
    name = f"channel {number} of {str(text.path)!r}"
    values = numbers.values
    found.append((number, Component(name, factor, values, step, direction, channel)))
    return _end_channel(text, numbers.end, quantity)


def _read_header(text: RecordText, at: int, kind: str, least: int) -> Numbers:
    """Read the integer or the real header, with its numbers in columns."""
    match = match_line(text, at, _HEADER.format(kind), f"the {kind} header")
    count = int(match[1])
    wrong = f"at least {least} values were expected in the {kind} header, got {count}"
    text.refuse(count < least, wrong, at + 1)
    return read_numbers(text, at + 1, count, parse_format(text, match[2], at + 1))


def _end_channel(text: RecordText, at: int, quantity: str) -> int:
    """Check that the data end here; return the index of the line after."""
    name = f"'End-of-data for ... {quantity}'"
    match_line(text, at, rf"\s*end-of-data\b(?:.*\b{quantity}\b|(?!.*(?:{_QUANTITY})))", name)
    return at + 1


def _find_unit(
    text: RecordText, line: int, match: re.Match[str], header: int, units: Statements
) -> float:
    """Find the unit of the values, which words and codes state."""
    words = match["unit"].rstrip(".")
    codes = [("the line states unit", int(match["code"] or _UNKNOWN))]
    codes += [("the integer header states unit", header)]
    counts = words.lower().startswith("count") or _COUNTS in [code for _, code in codes]
    refuse_counts(text, counts, line)
    units = [*units, (line, f"the line states {words}", parse_unit(words))]
    units += [
        (line, f"{where} {code}", parse_unit(_UNIT_CODES.get(code, "")))
        for where, code in codes
        if code != _UNKNOWN
    ]
    for at, stated, factor in units:
        text.refuse(math.isnan(factor), f"{stated}, which is not {UNITS}", at)
    return text.require_agreement(UNIT, units, "")


def _find_step(text: RecordText, line: int, reals: Numbers, steps: Statements) -> float:
    """Find the time step [s] of the values, not the recorder's, which may be another one."""
    milliseconds = float(reals.values[61])
    if milliseconds != _UNKNOWN:
        word = reals.words[61]
        wrong = f"the time step must be greater than 0, got {word} ms in the real header"
        text.refuse(milliseconds <= 0, wrong, line)
        steps = [*steps, (line, f"the real header states {word} ms", milliseconds / 1000)]
    missing = "the real header states no time step, so that time_step must be given"
    return text.require_agreement(STEP, steps, missing, line)


def _find_orientation(
    text: RecordText, at: int, integers: Numbers, comments: list[str]
) -> tuple[str, str, Direction]:
    """Find a channel's number, name and direction, which text and header state."""
    match = match_line(text, at, _CHANNEL, "a line such as 'Sta Chan 1: 360 deg'")
    channel = match["name"]
    azimuth, orientation = [int(value) for value in integers.values[53:55]]
    # Where no azimuth is known, for which USGS writes 0, there may be an orientation in the
    # structure.
    code = orientation if azimuth in (_UNKNOWN, 0) else azimuth
    vertical = code == _VERTICAL[0] or channel.lower() == _VERTICAL[1]
    text.refuse(vertical, "the channel is vertical, but not said to point up or down", at + 1)
    wrong = f"the integer header states an orientation of {code}, which is not understood"
    text.refuse(code not in (_UNKNOWN, 0, *_ORIENTATIONS), wrong, at + 1)
    named: Direction | None = "level" if channel.isdigit() else _NAMES.get(channel.lower())
    if named is None:
        wrong = f"an orientation such as '360 deg' or 'Up' was expected, got {channel}"
        raise text.make_error(wrong, at + 1)
    coded = _ORIENTATIONS.get(code, "")
    differs = bool(named and coded) and named != coded
    if channel.isdigit() and code == azimuth in range(1, 361):
        differs = (azimuth - int(channel)) % 360 != 0
    wrong = f"the text states {channel}, but the integer header an orientation of {code}"
    text.refuse(differs, wrong, at + 1)
    direction = named or coded
    code_names = [found[1].upper() for line in comments if (found := re.match(_SCNL, line))]
    for name in code_names:
        # In the codes of seismic channels, Z is vertical and points up.
        wrong = f"the text states {match['name']}, but the channel is {name}"
        text.refuse(name.endswith("Z") and direction == "level", wrong, at + 1)
        direction = direction or ("up" if name.endswith("Z") else "")
        channel = channel if named else name
    return match["number"], channel, direction
