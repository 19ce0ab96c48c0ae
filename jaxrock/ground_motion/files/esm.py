"""ASCII files of the European Strong-Motion database and ITACA: keys, then one value a line.

The headers, DYNA 1.0 and 1.2 and an older one of ITACA, differ only in keys that are not
needed here. They are described at https://esm-db.eu/#/data_and_services (format DYNA 1.2).
"""

import re

import numpy as np

from ...tables import TextFile, quote_word, require_whole_end
from .claims import Claims
from .components import Component, Direction
from .headers import Header
from .orientations import find_direction

# Spectra, velocities and displacements have the same layout.
_ACCELERATION = r"(?:(?:un)?processed )?acceleration"
# Where the header does not say it, the name of the file may.
_OTHER_NAMES = r"\.(VEL|DIS|SA|SD|PSV|PSA)\.(?:\w+\.)?ASC$"
# What the values of keys state. STREAM, or COMPONENT in old files, is the channel.
_KEYS = {
    "DATA_TYPE": "quantity",
    "UNITS": "unit",
    "SAMPLING_INTERVAL_S": "step",
    "NDATA": "points",
    "DURATION_S": "duration",
    "PGA_CM/S^2": "peak",
    "STREAM": "channel",
    "COMPONENT": "channel",
}
# Ends of the names of channels; in old files they are WE, NS or UP.
_DIRECTIONS: dict[str, Direction] = {
    ".*Z|U|UP": "up",
    ".*[NE12XY]|NS|WE|EW": "level",
    ".*": "",
}


def recognize_esm(lines: list[str]) -> bool:
    """Return whether the first line is that of a file of the European database."""
    return lines[0].lstrip().startswith("EVENT_NAME:")


def read_esm(text: TextFile, claims: Claims) -> list[Component]:
    """Read the component of a file."""
    header = Header(text, claims)
    top = _read_keys(text, header)
    quantity = header.find("quantity")
    named = re.search(_OTHER_NAMES, text.path.name, re.I)
    if named and not quantity:
        raise text.error(
            f"acceleration was expected, the header has no DATA_TYPE and the name says {named[1]}"
        )
    if quantity and not re.fullmatch(_ACCELERATION, quantity.word, re.I):
        raise text.error(
            f"acceleration was expected, DATA_TYPE is {quote_word(quantity.word)}",
            quantity.line,
        )
    if "peak" in header.fields:
        header.add("peak_unit", header.fields["peak"][0].line, "cm/s2")
    factor = header.require_unit("the header has no UNITS")
    step = header.require_step("the header has no SAMPLING_INTERVAL_S")
    points = header.require_points()
    values = text.read_values(
        top,
        lambda lines: np.array([float(line.replace("_", "?")) for line in lines]),
        lambda line, n: [text.parse_number(line.strip(), n)] if line.strip() else [],
    )
    words = [line.strip() for line in text.lines[top:] if line.strip()]
    require_whole_end(text, words)
    if values.size != points:
        raise text.error(
            f"NDATA is {points}, but {values.size} values follow",
            header.fields["points"][0].line,
        )
    header.require_duration(points, step)
    header.require_peak(words, values, factor)
    direction = find_direction(text, header, _DIRECTIONS, {})
    return [header.make_component(repr(str(text.path)), factor, values, step, direction)]


def _read_keys(text: TextFile, header: Header) -> int:
    """Read the lines of the header that are not empty; return how many lines it has."""
    first: dict[str, tuple[int, str]] = {}
    for number, line in enumerate(text.lines, 1):
        if line.strip() and ":" not in line:
            return number - 1
        key, _, word = (part.strip() for part in line.partition(":"))
        if not word:
            continue
        if key in first and first[key][1] != word:
            before = first[key]
            raise text.error(
                f"{key} is {quote_word(before[1])} in line {before[0]}, but {quote_word(word)}",
                number,
            )
        if key in _KEYS and key not in first:
            header.add(_KEYS[key], number, word)
        first.setdefault(key, (number, word))
    return len(text.lines)
