"""ASCII files of the European Strong-Motion database and ITACA: keys, then one value a line.

The headers, DYNA 1.0 and 1.2 and an older one of ITACA, differ only in keys that are not
needed here.
"""

import re

import numpy as np

from .components import Component, Direction
from .cut import refuse_cut
from .fixed_columns import Numbers, require_duration, require_peak
from .text import STEP, UNIT, RecordText, Statements, quote_word
from .units import UNITS, parse_unit

# Spectra, velocities and displacements have the same layout.
_ACCELERATION = r"(?:(?:un)?processed )?acceleration"
# Ends of the names of channels; COMPONENT, in old files, is WE, NS or UP.
_DIRECTIONS: dict[str, Direction] = {r".*Z|U|UP": "up", r".*[NE12XY]|NS|WE|EW": "level"}
# As many are enough to see how numbers are printed.
_LAST_LINES = 200
# Number of the line and what stands in it, by the key.
_Fields = dict[str, tuple[int, str]]


def recognize_esm(lines: list[str]) -> bool:
    """Tell by the first line whether it is a file of the European database."""
    return lines[0].lstrip().startswith("EVENT_NAME:")


def read_esm(text: RecordText, units: Statements, steps: Statements) -> list[Component]:
    """Read the component of a file, where the caller states `units` and `steps`."""
    fields, top = _read_fields(text)
    line, kind = fields.get("DATA_TYPE", (0, "ACCELERATION"))
    other = not re.fullmatch(_ACCELERATION, kind, re.I)
    text.refuse(other, f"acceleration was expected, DATA_TYPE is {quote_word(kind)}", line)
    if "UNITS" in fields:
        line, unit = fields["UNITS"]
        units = [*units, (line, f"UNITS is {quote_word(unit)}", parse_unit(unit))]
    no_unit = f"the header has no UNITS, so that unit must be given: {UNITS}"
    factor = text.require_agreement(UNIT, units, no_unit)
    step = _read_step(text, fields, steps)
    text.refuse("NDATA" not in fields, "the header has no NDATA, the number of values")
    line, points = fields["NDATA"]
    values = text.read_values(
        top,
        lambda lines: np.array([float(each.replace("_", "?")) for each in lines]),
        lambda each, n: [text.parse_number(each.strip(), n)] if each.strip() else [],
    )
    refuse_cut(text, [each.strip() for each in text.lines[top:][-_LAST_LINES:]])
    wrong = values.size != text.parse_number(points, line, "NDATA")
    text.refuse(wrong, f"NDATA is {points}, but {values.size} values follow", line)
    if "DURATION_S" in fields:
        require_duration(text, (*fields["DURATION_S"], 0.0), values.size, step)
    if "PGA_CM/S^2" in fields and values.size:
        line, peak = fields["PGA_CM/S^2"]
        text.parse_number(peak, line, "PGA_CM/S^2")
        words = [each.strip() for each in text.lines[top:] if each.strip()]
        require_peak(text, (line, peak, 0.01), Numbers(words, values, len(text.lines)), factor)
    channel = fields.get("STREAM", fields.get("COMPONENT", (0, "")))[1]
    return [
        Component(
            repr(str(text.path)), factor, values, step, _find_direction(channel), channel
        )
    ]


def _read_fields(text: RecordText) -> tuple[_Fields, int]:
    """Read the header: its fields that are not empty, and how many lines it has."""
    fields: _Fields = {}
    for number, line in enumerate(text.lines, 1):
        if line.strip() and ":" not in line:
            return fields, number - 1
        key, _, value = (part.strip() for part in line.partition(":"))
        if value:
            first, before = fields.setdefault(key, (number, value))
            twice = f"{key} is {quote_word(before)} in line {first}, but {quote_word(value)}"
            text.refuse(before != value, twice, number)
    return fields, len(text.lines)


def _read_step(text: RecordText, fields: _Fields, steps: Statements) -> float:
    """Read the time step [s], on which the caller has to agree."""
    if "SAMPLING_INTERVAL_S" in fields:
        line, word = fields["SAMPLING_INTERVAL_S"]
        step = text.parse_number(word, line, "SAMPLING_INTERVAL_S")
        wrong = f"SAMPLING_INTERVAL_S must be greater than 0, got {word}"
        text.refuse(step <= 0, wrong, line)
        steps = [*steps, (line, f"SAMPLING_INTERVAL_S is {word}", step)]
    no_step = "the header has no SAMPLING_INTERVAL_S, so that time_step must be given"
    return text.require_agreement(STEP, steps, no_step)


def _find_direction(channel: str) -> Direction:
    """Find the direction of a channel, such as HNZ or NS; empty if it is not clear."""
    for name, direction in _DIRECTIONS.items():
        if re.fullmatch(name, channel, re.I):
            return direction
    return ""
