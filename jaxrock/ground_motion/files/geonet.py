"""Files .V1A and .V2A of GeoNet, New Zealand, with three components one after the other.

A component begins with 16 lines of text and 10 lines of numbers; then come accelerations,
velocities and displacements, all in columns of one width. The format is described at
https://www.geonet.org.nz/data/supplementary/strong_motion_file_formats.
"""

from ...oldtables import TextFile
from .claims import Claims
from .components import Component
from .fixed_columns import Columns, match_line, read_numbers
from .headers import DECIMAL, Header, Numbered, find_azimuth, read_channels

GEONET_TITLE = r"\s*(?:un)?corrected accelerogram\b.*\bgns science\b"
_COLUMNS = Columns(10, 8)
_HEADER_LINES = 26
# By the index of the line in the text: what stands there, and its name for an error.
_TEXT = {
    9: (
        rf"\s*number of points\s+(?P<points>\d+)\s+duration\s+(?P<duration>{DECIMAL})\s*s",
        "the number of points",
    ),
    10: (
        rf"(?:raw readings in units of\s+(?P<scale>{DECIMAL})\s*(?P<unit>\S+)\s+at intervals"
        rf" of\s+(?P<step>{DECIMAL})\s*s\b|.*\bat\s+(?P<step_2>{DECIMAL})\s*sec intervals\b)",
        "the time step",
    ),
    12: (r"\s*component\s+(?P<channel>[ns]\d+[ew]|[nesw]|up|down)(?!\S)", "the component"),
    # The peak is in the unit of the values.
    13: (
        rf"\s*acceleration:\s*peak\s+(?P<peak>{DECIMAL})\s*(?P<unit>\S+)\s+at\b",
        "the peak acceleration",
    ),
}
# By the index of the line in the numbers, and by their indices in it.
_NUMBERS = {
    18: {7: "degrees"},
    19: {3: "points", 4: "velocities", 5: "displacements"},
    20: {7: "scale"},
    22: {5: "step"},
}


def read_geonet(text: TextFile, claims: Claims) -> list[Component]:
    """Read the accelerations of all components."""
    return read_channels(text, claims, _read_component, "GeoNet")


def _read_component(text: TextFile, claims: Claims, top: int) -> tuple[list[Numbered], int]:
    """Read a component, and the index of the line after its displacements."""
    match_line(text, top, GEONET_TITLE, "a title with '... accelerogram ... GNS Science'")
    header = Header(text, claims)
    for at, (pattern, name) in _TEXT.items():
        header.read_line(top + at, pattern, f"a line with {name}")
    for at, names in _NUMBERS.items():
        header.read_numbers(top + at, _COLUMNS.number, _COLUMNS, names)
    for line, word, value in header.fields["scale"]:
        if value != 1:
            raise text.error(f"values that are to be multiplied by {word} are not read", line)
    if find_azimuth(header.fields["channel"][0].words) is not None:
        header.fields["azimuth"] = header.fields["degrees"]
    component, end = header.read_component(top + _HEADER_LINES, _COLUMNS)
    # Only to see that they are whole: what is cut or shifted in them shifts the next component.
    for quantity in ("velocities", "displacements"):
        line, word, value = header.fields[quantity][0]
        if not (value >= 0 and value % 1 == 0):
            raise text.error(f"a whole number of {quantity} was expected, got {word}", line)
        end = read_numbers(text, end, int(value), _COLUMNS).end
    return [("", component)], end
