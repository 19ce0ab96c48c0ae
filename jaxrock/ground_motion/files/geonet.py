"""Files .V1A and .V2A of GeoNet, New Zealand, with three components one after the other."""

import math
import re

from .components import Component, Direction
from .fixed_columns import (
    Columns,
    match_line,
    name_channels,
    read_numbers,
    require_duration,
    require_peak,
)
from .text import STEP, UNIT, RecordText, Statements
from .units import UNITS, parse_unit

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_TITLE = r"\s*(?:un)?corrected accelerogram\b.*\bgns science\b"
_COLUMNS = Columns(10, 8)
# A component begins with 16 lines of text and 10 lines of numbers; then come accelerations,
# velocities and displacements. By the index of the line, what stands in the text:
_LENGTH = 9, rf"\s*number of points\s+(?P<points>\d+)\s+duration\s+(?P<duration>{_NUMBER})\s*s"
_STEP = (
    10,
    rf"(?:raw readings in units of\s+(?P<scale>{_NUMBER})\s*(?P<unit>\S+)\s+at intervals of"
    rf"\s+(?P<after>{_NUMBER})\s*s\b|.*\bat\s+(?P<before>{_NUMBER})\s*sec intervals\b)",
)
_COMPONENT = 12, r"\s*component\s+(?P<name>[ns]\d+[ew]|[nesw]|up|down)(?!\S)"
_PEAK = 13, rf"\s*acceleration:\s*peak\s+(?P<peak>{_NUMBER})\s*(?P<unit>\S+)\s+at\b"
# And in the numbers: the direction, how many values follow, their scale and time step.
_AZIMUTH = 18, 7
_COUNTS = 19
_SCALE = 20, 7
_INTERVAL = 22, 5
_HEADER_LINES = 26


def recognize_geonet(lines: list[str]) -> bool:
    """Tell GeoNet's files by the title."""
    return re.match(_TITLE, lines[0], re.I) is not None


def read_geonet(text: RecordText, units: Statements, steps: Statements) -> list[Component]:
    """Read accelerations of all components, where the caller states `units` and `steps`."""
    found: list[tuple[str, Component]] = []
    at = 0
    while at < len(text.lines):
        number = str(len(found) + 1)
        component, at = _read_component(text, at, units, steps)
        name = f"component {component.channel} of {str(text.path)!r}"
        found.append((number, component._replace(name=name)))
    return name_channels(text, found, "GeoNet")


def _read_component(
    text: RecordText, top: int, units: Statements, steps: Statements
) -> tuple[Component, int]:
    """Read a component, and the index of the line after its displacements."""
    match_line(text, top, _TITLE, "a title with '... accelerogram ... GNS Science'")
    length, sampling, component, peak = [
        match_line(text, top + at, pattern, f"a line with {name}")
        for (at, pattern), name in (
            (_LENGTH, "the number of points"),
            (_STEP, "the time step"),
            (_COMPONENT, "the component"),
            (_PEAK, "the peak acceleration"),
        )
    ]
    accelerations, *others = _read_header(text, top + _COUNTS)[3:6]
    stated = length["points"]
    wrong = f"{stated} points are stated, but the line of counts has {accelerations:g}"
    text.refuse(int(stated) != accelerations, wrong, top + _LENGTH[0] + 1)
    whole = all(each >= 0 and each % 1 == 0 for each in others)
    text.refuse(not whole, "numbers of values must be whole", top + _COUNTS + 1)
    factor = _find_unit(text, top, sampling, peak, units)
    step = _find_step(text, top, sampling, steps)
    duration = top + _LENGTH[0] + 1, length["duration"], 0.0
    require_duration(text, duration, int(stated), step)
    numbers = read_numbers(text, top + _HEADER_LINES, int(stated), _COLUMNS)
    require_peak(text, (top + _PEAK[0] + 1, peak["peak"], factor), numbers, factor)
    end = numbers.end
    for count in others:
        # Only to see that they are whole: what is cut or shifted in them shifts the rest.
        end = read_numbers(text, end, int(count), _COLUMNS).end
    direction = _find_direction(text, top, component["name"])
    values = numbers.values
    return Component("", factor, values, step, direction, component["name"]), end


def _read_header(text: RecordText, at: int) -> list[float]:
    """Read a line of ten numbers."""
    return read_numbers(text, at, 10, _COLUMNS).values.tolist()


def _find_unit(
    text: RecordText,
    top: int,
    sampling: re.Match[str],
    peak: re.Match[str],
    units: Statements,
) -> float:
    """Find the unit of the values, as the lines of the peak and of raw readings state it."""
    at, column = _SCALE
    scale = _read_header(text, top + at)[column]
    scales = [(top + at + 1, scale), (top + _STEP[0] + 1, float(sampling["scale"] or 1))]
    for line, factor in scales:
        wrong = f"values that are to be multiplied by {factor:g} are not read"
        text.refuse(factor != 1, wrong, line)
    stated = [(top + _PEAK[0] + 1, f"the peak is in {peak['unit']}", peak["unit"])]
    if sampling["unit"]:
        words = f"the readings are in units of {sampling['unit']}"
        stated += [(top + _STEP[0] + 1, words, sampling["unit"])]
    units = units + [(line, words, parse_unit(unit)) for line, words, unit in stated]
    for line, words, unit in units:
        text.refuse(math.isnan(unit), f"{words}, which is not {UNITS}", line)
    return text.require_agreement(UNIT, units, "")


def _find_step(
    text: RecordText, top: int, sampling: re.Match[str], steps: Statements
) -> float:
    """Find the time step [s], in the text and in the header."""
    at, column = _INTERVAL
    interval = _read_header(text, top + at)[column]
    printed = float(sampling["after"] or sampling["before"])
    steps = [*steps]
    for line, step in ((top + at + 1, interval), (top + _STEP[0] + 1, printed)):
        text.refuse(step <= 0, f"the time step must be greater than 0, got {step:g}", line)
        steps.append((line, f"the file states a time step of {step:g} s", step))
    return text.require_agreement(STEP, steps, "")


def _find_direction(text: RecordText, top: int, name: str) -> Direction:
    """Find the direction of a component by its name; a `ValueError` if the azimuth differs."""
    if name.lower() in ("up", "down"):
        return "up" if name.lower() == "up" else "down"
    at, column = _AZIMUTH
    azimuth = _read_header(text, top + at)[column]
    stated = {"n": 0, "e": 90, "s": 180, "w": 270}[name[0].lower()]
    if name[1:]:
        # N28W is 28 degrees from north to the west.
        clockwise = name[0].lower() + name[-1].lower() in ("ne", "sw")
        stated += int(name[1:-1]) if clockwise else -int(name[1:-1])
    wrong = f"the text states {name}, but the header an azimuth of {azimuth:g} degrees"
    text.refuse((azimuth - stated) % 360 != 0, wrong, top + at + 1)
    return "level"
