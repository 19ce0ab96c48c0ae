"""Files of California's strong-motion program, volumes 1 and 2, as CESMD delivers them."""

import functools
import math
import re
from typing import NamedTuple

from .components import Component, Direction
from .fixed_columns import (
    Columns,
    get_line,
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

_RAW = "uncorrected accelerogram data"
_CORRECTED = "corrected accelerogram"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_DURATION = rf".*\brecord\s+length\s*=\s*(?P<duration>{_NUMBER})\s*sec"
# A line before the values of a quantity. Unit and format stand in either of two ways.
_DATA = (
    rf"\s*(?P<points>\d+)\s+(?:accelerogram\s+points\s+at\s+(?P<rate>{_NUMBER})\s*pts/sec"
    r"|points\s+of\s+(?P<quantity>accel|veloc|displ)\s+data\s+equally[\s-]+spaced\s+at\s+"
    rf"(?P<step>{_NUMBER})\s*sec\.?)\s*"
    r"(?:,?\s*in\s+(?:units\s+of\s+)?(?P<unit>[^\s(]+)\s*\.?\s*(?:format:)?\s*(?P<format>\(.*)"
    r"|\(units:\s*(?P<declared>[^\s)]+)\s*\)\s*)$"
)
_CHANNEL = r"\s*chan\s*(?P<number>\d+):\s*(?P<name>\d+(?=\s*deg)|[a-z]\w*)"
_DIRECTIONS: dict[str, Direction] = {"up": "up", "down": "down"}
_DIRECTIONS |= dict.fromkeys(("h1", "h2", "long", "tran", "radl", "tang"), "level")
# Orientations in the integer header, beside azimuths.
_CODES: dict[int, Direction] = {500: "up", 600: "down"}
_CODES |= dict.fromkeys(range(1, 361), "level")


class _Volume(NamedTuple):
    """A layout: lines of text and of both headers, and what stands in lines of the text."""

    text: int
    headers: int
    channel: int
    columns: Columns
    statements: tuple[tuple[int, str], ...]


_FIRST = _Volume(
    13,
    14,
    6,
    Columns(8, 9),
    (
        (
            10,
            rf"\s*no\. of points\s*=\s*(?P<points>\d+)\b{_DURATION}"
            rf"(?:\s+at\s+(?P<rate>{_NUMBER})\s+samples/sec)?",
        ),
        (11, rf".*\bmax\s*=\s*(?P<peak>{_NUMBER})\s*(?P<unit>[^\s,]+)\s*,?\s+at\b"),
    ),
)
_SECOND = _Volume(
    25,
    20,
    7,
    Columns(8, 10),
    (
        (11, _DURATION),
        (15, r"\s*(?P<points>\d+)\s+points\b"),
        (16, rf"\s*at\s+equally[\s-]+spaced\s+intervals\s+of\s+(?P<step>{_NUMBER})\s*sec"),
        (17, rf"\s*peak\s+acceleration\s*=\s*(?P<peak>{_NUMBER})\s*(?P<unit>\S+)\s+at\b"),
    ),
)


def recognize_csmip(lines: list[str]) -> bool:
    """Tell the files by the title of volume 1, perhaps below that of volume 2."""
    first, second = [line.lower().lstrip() for line in [*lines[:2], ""][:2]]
    return first.startswith(_RAW) or (first.startswith(_CORRECTED) and second.startswith(_RAW))


def read_csmip(text: RecordText, units: Statements, steps: Statements) -> list[Component]:
    """Read the accelerations of all channels, where the caller states `units` and `steps`."""
    read_channel = functools.partial(_read_channel, units, steps)
    return read_channels(text, read_channel, "CSMIP")


def _read_channel(
    units: Statements,
    steps: Statements,
    text: RecordText,
    top: int,
    found: list[tuple[str, Component]],
) -> int:
    """Read a channel into `found`; return the index of the line after it."""
    match_line(text, top, rf"\s*(?:{_RAW}|{_CORRECTED})\b", "the title of a channel")
    volume = _FIRST
    if text.lines[top].lower().lstrip().startswith(_CORRECTED):
        volume = _SECOND
        match_line(text, top + 1, rf"\s*{_RAW}\b", "the title of the uncorrected data")
    number, channel, direction = _find_orientation(text, top, volume)
    at = top + volume.text + volume.headers
    while not re.match(r"\W*end of data\b", get_line(text, at, "'End of data'"), re.I):
        name = "a line such as '7200 points of accel data equally spaced at ...'"
        match = match_line(text, at, _DATA, name)
        points = int(match["points"])
        columns = volume.columns
        if match["format"]:
            columns = parse_format(text, match["format"], at + 1)
        if (match["quantity"] or "accel").lower() == "accel":
            factor = _find_unit(text, at + 1, match, units)
            stated = _collect_statements(text, top, volume)
            step = _find_step(text, [(at + 1, match), *stated], steps)
            _check_length(text, stated, points, step)
            numbers = read_numbers(text, at + 1, points, columns)
            line, peak = stated[-1]
            unit = parse_unit(peak["unit"])
            wrong = f"the header states a peak in {peak['unit']}, which is not {UNITS}"
            text.refuse(math.isnan(unit), wrong, line)
            require_peak(text, (line, peak["peak"], unit), numbers, factor)
            name = f"channel {number} of {str(text.path)!r}"
            component = Component(name, factor, numbers.values, step, direction, channel)
            found.append((number, component))
        at += 1 + -(-points // columns.number)
    return at + 1


def _collect_statements(
    text: RecordText, top: int, volume: _Volume
) -> list[tuple[int, re.Match[str]]]:
    """Find what the text of a channel states: points, duration, step, and last the peak."""
    name = "what the header states of points, duration, time step and peak"
    return [
        (top + at + 1, match_line(text, top + at, pattern, name))
        for at, pattern in volume.statements
    ]


def _find_unit(text: RecordText, line: int, match: re.Match[str], units: Statements) -> float:
    """Find the unit of the values, as the line above them states it."""
    words = (match["unit"] or match["declared"]).rstrip(".")
    refuse_counts(text, words.lower().startswith("count"), line)
    units = [*units, (line, f"the line states {words}", parse_unit(words))]
    text.refuse(math.isnan(units[-1][2]), f"{units[-1][1]}, which is not {UNITS}", line)
    return text.require_agreement(UNIT, units, "")


def _find_step(
    text: RecordText, matches: list[tuple[int, re.Match[str]]], steps: Statements
) -> float:
    """Find the time step [s], which several lines state, or the number of samples a second."""
    steps = [*steps]
    for line, match in matches:
        stated = match.groupdict()
        word = stated.get("step") or stated.get("rate")
        if word:
            wrong = f"a time step or rate must be greater than 0, got {word}"
            text.refuse(float(word) <= 0, wrong, line)
            step = float(word) if stated.get("step") else 1 / float(word)
            words = f"{word} s" if stated.get("step") else f"{word} samples per second"
            steps.append((line, f"the file states {words}", step))
    return text.require_agreement(STEP, steps, "")


def _check_length(
    text: RecordText, matches: list[tuple[int, re.Match[str]]], points: int, step: float
) -> None:
    """Refuse a number of points that the text does not state, or no such duration."""
    for line, match in matches:
        stated = match.groupdict()
        other = stated.get("points")
        wrong = f"the header states {other} points, but the line above the values {points}"
        text.refuse(other is not None and int(other) != points, wrong, line)
        if "duration" in stated:
            require_duration(text, (line, match["duration"], 0.0), points, step)


def _find_orientation(
    text: RecordText, top: int, volume: _Volume
) -> tuple[str, str, Direction]:
    """Find a channel's number, name and direction, which text and integer header state."""
    at = top + volume.channel
    match = match_line(text, at, _CHANNEL, "a line such as 'Chan 1: 360 deg'")
    channel = match["name"]
    header = top + volume.text + 1
    # The 27th integer of five characters, 16 in a line.
    word = get_line(text, header, "the integer header")[50:55]
    code = int(text.parse_number(word, header + 1, "an orientation"))
    direction: Direction = "level"
    if not channel.isdigit():
        wrong = f"an orientation such as '360 deg' or 'Up' was expected, got {channel}"
        text.refuse(channel.lower() not in _DIRECTIONS, wrong, at + 1)
        direction = _DIRECTIONS[channel.lower()]
    differs = _CODES.get(code, direction) != direction
    differs |= channel.isdigit() and code in range(1, 361) and (code - int(channel)) % 360 != 0
    stated = f"the text states {channel}, but the integer header an orientation of {code}"
    text.refuse(differs, stated, at + 1)
    return match["number"], channel, direction
