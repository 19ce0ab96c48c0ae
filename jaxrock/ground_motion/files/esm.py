"""ASCII files of the European Strong-Motion database and ITACA: keys, then one value a line.

The headers, DYNA 1.0 and 1.2 and an older one of ITACA, differ only in keys that are not
needed here. They are described at https://esm-db.eu/#/data_and_services (format DYNA 1.2).
"""

import re

from ...oldtables import TextFile, quote_word
from .claims import Claims
from .components import Component, Direction
from .headers import Header

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
# Names of channels that are not SEED's; in old files they are WE, NS or UP.
_NAMES: dict[str, Direction] = {".*z|u": "up", ".*[ne12xy]": "level", ".*": ""}


def read_esm(text: TextFile, claims: Claims) -> list[Component]:
    """Read the component of a file."""
    header = Header(text, claims, _NAMES)
    top = _read_keys(text, header)
    quantity = header.find("quantity")
    named = re.search(_OTHER_NAMES, text.path.name, re.I)
    if named and not quantity:
        raise text.error(
            f"acceleration was expected, the header has no DATA_TYPE and the name says {named[1]}"
        )
    if quantity and not re.fullmatch(_ACCELERATION, quantity.words, re.I):
        kind = quote_word(quantity.words)
        raise text.error(f"acceleration was expected, DATA_TYPE is {kind}", quantity.line)
    if peak := header.find("peak"):
        header.add("peak_unit", peak.line, "cm/s2")
    return [header.read_component(top)[0]]


def _read_keys(text: TextFile, header: Header) -> int:
    """Read the lines of the header that are not empty; return how many lines it has."""
    first: dict[str, tuple[int, str]] = {}
    for number, line in enumerate(text.lines, 1):
        if line.strip() and ":" not in line:
            return number - 1
        key, _, word = (part.strip() for part in line.partition(":"))
        if not word:
            continue
        if key in _KEYS and key not in first:
            header.add(_KEYS[key], number, word)
        line, before = first.setdefault(key, (number, word))
        if before != word:
            agreed = f"{key} is {quote_word(before)} in line {line}"
            raise text.error(f"{agreed}, but {quote_word(word)}", number)
    return len(text.lines)
