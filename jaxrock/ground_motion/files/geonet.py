"""Files .V1A and .V2A of GeoNet, New Zealand, with three components one after the other.

A component begins with 16 lines of text and 10 lines of numbers; then come accelerations,
velocities and displacements, all in columns of one width. The format is described at
https://www.geonet.org.nz/data/supplementary/strong_motion_file_formats.
"""

from ...tables import TextFile
from .components import Caller, Component, make_component
from .fields import find, read_fixed

GEONET_TITLE = r"\s*(?:un)?corrected accelerogram\b.*\bgns science\b"
_LAYOUT = (10, 8)
_TEXT_LINES = 16
_PEAK = r"^\s*acceleration: *peak +[-\d.]+ *(\S+) +at"
# Where they stand among the 100 numbers: how many values of each quantity, a factor, the step.
_COUNTS = slice(33, 36)
_FACTOR, _STEP = 47, 65


def read_geonet(text: TextFile, caller: Caller, top: int) -> tuple[list[Component], int]:
    """Read a component, and the index of the line after its displacements."""
    find(text, top, GEONET_TITLE, "a title with '... accelerogram ... GNS Science'")
    channel = find(text, top + 12, r"^\s*component +([nsewupdo\d]+)", "the component")[1]
    unit = find(text, top + 13, _PEAK, "the peak acceleration")[1]
    numbers, at = read_fixed(text, top + _TEXT_LINES, 100, _LAYOUT)
    if numbers[_FACTOR] != 1:
        raise text.error(f"values times {numbers[_FACTOR]:g} are not read", top + 21)
    # Velocities and displacements are read only to see that they are whole.
    series = []
    for count in numbers[_COUNTS]:
        values, at = read_fixed(text, at, int(count), _LAYOUT)
        series.append(values)
    step = float(numbers[_STEP])
    component = make_component(text, caller, series[0], unit=unit, step=step, channel=channel)
    return [component], at
