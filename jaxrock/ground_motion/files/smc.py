"""SMC files of the U.S. Geological Survey: headers of text, integers and reals, then values.

Everything stands in columns of fixed width. Accelerations are in cm/s2. The format is
described at https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html.
"""

import re

from .components import Component, Direction
from .fixed_columns import Columns, get_line, read_numbers, require_peak
from .text import STEP, UNIT, RecordText, Statements, collect_statements, quote_word
from .units import find_units_in_text

# The first line says what the file holds.
_FIRST = r"\s*\d\s+(?:unknown|(?:un)?corrected acc|velocity|displacement|response|fourier)"
_ACCELERATION = r"\s*[12]\s+(?:un)?corrected accelerogram"
# The headers have 11 lines of text, 6 of integers and 10 of reals.
_INTEGERS = 11
_REALS = 17
_COMMENTS = 27
# Higher rates occur, and are mistakes.
_HIGHEST_RATE = 1e5
# Degrees from upward, and names of components: an azimuth, a point of the compass, or up.
_ORIENTATIONS: dict[float, Direction] = {0: "up", 90: "level", 180: "down"}
_NAMES: dict[str, Direction] = {
    r"u|up": "up",
    r"d|dn|down": "down",
    r"[0-2]?\d?\d|3[0-5]\d|360|[nsew]|[ns]\d*[ew]|north|south|east|west": "level",
}


def recognize_smc(lines: list[str]) -> bool:
    """Tell by the first line whether it is an SMC file."""
    return bool(re.match(_FIRST, lines[0], re.I))


def read_smc(text: RecordText, units: Statements, steps: Statements) -> list[Component]:
    """Read the component of a file, where the caller states `units` and `steps`."""
    kind = text.lines[0].strip()
    other = not re.match(_ACCELERATION, kind, re.I)
    text.refuse(other, f"an accelerogram was expected, this is {quote_word(kind)}", 1)
    integers: list[float] = read_numbers(text, _INTEGERS, 48, Columns(8, 10)).values.tolist()
    reals = read_numbers(text, _REALS, 50, Columns(5, 15))
    # The first number of a header stands for all that are missing: -32768 and 1.7e38.
    text.refuse(integers[0] >= 0, "the first integer must be that for missing ones", 12)
    no_real = float(reals.values[0])
    text.refuse(no_real < 1e30, "the first real must be that for missing ones", 18)
    top = _find_values(text, integers[15])
    comments = [*enumerate(text.lines[:top], 1)][_COMMENTS:]
    units = [*units, (1, "an SMC file is in cm/s2", 0.01)]
    units += collect_statements(find_units_in_text, comments, "a comment")
    factor = text.require_agreement(UNIT, units, "")
    # In uncorrected records of film, times and accelerations alternate.
    rate = float(reals.values[1])
    uneven = (
        "the header states no sampling rate, so that the values are pairs of time and"
        " acceleration: take the corrected record, which has a uniform step"
    )
    text.refuse(rate == no_real, uneven, 18)
    wrong = f"the sampling rate must be from 0 to {_HIGHEST_RATE:g} per second, got {rate:g}"
    text.refuse(not 0 < rate <= _HIGHEST_RATE, wrong, 18)
    stated = (18, f"the header states {rate:g} samples per second", 1 / rate)
    step = text.require_agreement(STEP, [*steps, stated], "")
    points = integers[16]
    wrong = f"the number of values must be a whole number from 2 on, got {points:g}"
    text.refuse(points < 2 or points % 1 > 0, wrong, 14)
    # Some programs write more digits.
    more = re.match(r"\s*-?\d\.\d{7}E", get_line(text, top, "the values"), re.I)
    values = read_numbers(text, top, int(points), Columns(5, 14) if more else Columns(8, 10))
    over = f"the header states {points:g} values, but more lines follow"
    text.refuse(values.end < len(text.lines), over, values.end + 1)
    # The largest value and the smallest.
    peaks = [(line, reals.words[k]) for line, k in ((23, 29), (24, 31))]
    if no_real not in reals.values[[29, 31]]:
        line, peak = max(peaks, key=lambda each: abs(float(each[1])))
        require_peak(text, (line, peak, 0.01), values, factor)
    channel, direction = _find_direction(text, integers[12], integers[0])
    name = repr(str(text.path))
    return [Component(name, factor, values.values, step, direction, channel)]


def _find_values(text: RecordText, count: float) -> int:
    """Find the number of lines above the values, of which `count` are comments."""
    top = _COMMENTS
    while top < len(text.lines) and text.lines[top].startswith("|"):
        top += 1
    found = top - _COMMENTS
    wrong = f"the header states {count:g} lines of comments, but {found} begin with |"
    text.refuse(max(count, 0) != found, wrong, 13)
    return top


def _find_direction(text: RecordText, degrees: float, missing: float) -> tuple[str, Direction]:
    """Find the name of the component and its direction, by both the name and the degrees."""
    match = re.search(r"\bcomponent\s*=\s*(\S+)", text.lines[5], re.I)
    name = match[1] if match else ""
    named: Direction = ""
    for pattern, direction in _NAMES.items():
        named = direction if re.fullmatch(pattern, name, re.I) else named
    if degrees == missing:
        unclear = f"the component must be an azimuth, or up or down, got {quote_word(name)}"
        text.refuse(bool(name) and not named, unclear, 6)
        return name, named
    wrong = f"a sensor {degrees:g} degrees from upward is neither horizontal nor vertical"
    text.refuse(degrees not in _ORIENTATIONS, wrong, 13)
    direction = _ORIENTATIONS[degrees]
    wrong = f"the component is {name}, but the sensor is {degrees:g} degrees from upward"
    text.refuse(bool(named) and named != direction, wrong, 6)
    return name, direction
