"""Files of K-NET and KiK-net in ASCII, one component each.

The format is described at https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html.
"""

import math
import re
import warnings
from pathlib import Path

import numpy as np

from ...oldtables import TextFile, quote_names, require_whole_end
from .claims import Claims
from .components import Component
from .fixed_columns import Numbers
from .headers import Header
from .plain import LAST_LINES, read_free_numbers

# Channels by what stands behind Dir., for KiK-net a digit. Its names end in 1 for the sensors in
# the borehole and in 2 for those at the surface.
_CHANNELS = {"N-S": "NS", "E-W": "EW", "U-D": "UD"}
_CHANNELS |= {"1": "NS1", "2": "EW1", "3": "UD1", "4": "NS2", "5": "EW2", "6": "UD2"}
KNET_SUFFIXES = tuple(f".{channel.lower()}" for channel in _CHANNELS.values())
_BOREHOLE = (".ns1", ".ew1", ".ud1")
_SURFACE = (".ns2", ".ew2", ".ud2")

_HEADER_LINES = 17
_POSITIVE = r"(?=[\d.]*[1-9])\d+\.?\d*"
# What is read of the header, by the index of the line: the name of a field, what stands behind
# it, and words for that. The description of the format has Max Acc., its files Max. Acc.
_FIELDS = {
    10: ("Sampling Freq(Hz)", rf"(?P<rate>{_POSITIVE})(?:Hz)?", "a number above 0"),
    11: ("Duration Time(s)", rf"(?P<duration>{_POSITIVE})", "a number above 0"),
    12: ("Dir.", rf"(?P<sensor>{'|'.join(_CHANNELS)})", f"one of {', '.join(_CHANNELS)}"),
    13: (
        "Scale Factor",
        rf"(?P<gals>{_POSITIVE})\(gal\)/(?P<counts>{_POSITIVE})",
        "a factor such as 2000(gal)/8388608",
    ),
    14: ("Max. Acc. (gal)", r"(?P<peak>\S+)", "a number"),
}


def read_knet(text: TextFile, claims: Claims) -> list[Component]:
    """Read the component of a file, which states a factor in gal a count."""
    header = Header(text, claims)
    for at, (name, pattern, words) in _FIELDS.items():
        field = re.escape(name).replace(r"\.", r"\.?")
        header.read_line(at, rf"{field} +{pattern}\s*$", f"'{name}' with {words}")
    line, sensor, _ = header.fields["sensor"][0]
    header.add("channel", line, _CHANNELS[sensor.upper()])
    line, peak, _ = header.fields["peak"][0]
    header.add_unit(line, "the file is in gal", "gal")
    factor = header.require_unit()
    step = header.require_step()
    values = read_free_numbers(text, _HEADER_LINES)
    line, duration, seconds = header.fields["duration"][0]
    _, rate, frequency = header.fields["rate"][0]
    if not math.isclose(values.size, seconds * frequency):
        stated = f"the header states {duration} s at {rate} samples per second"
        raise text.error(f"{stated}, but {values.size} values follow", line)
    # The last number may not end before the others of its column do.
    lines = [re.findall(r"\s*\S+", row) for row in text.lines[_HEADER_LINES:][-LAST_LINES:]]
    width = len(lines[-1])
    require_whole_end(text, [words[width - 1] for words in lines if len(words) >= width])
    gals_per_count = header.fields["gals"][0].value / header.fields["counts"][0].value
    # The offset of the instrument stays in the samples, though not in the peak that is stated.
    # Printed like the peak, which may have been cut instead of rounded: both may be off by half
    # a unit of their last digit.
    extremes = gals_per_count * (np.array([values.min(), values.max()]) - values.mean())
    decimals = len(peak.partition(".")[2])
    numbers = Numbers([f"{extreme:.{decimals}f}" for extreme in extremes], extremes, 0)
    header.require_peak(numbers, factor, "the values less their mean")
    return [header.make_component(factor * gals_per_count, values, step)]


def leave_out_boreholes(paths: list[Path]) -> list[Path]:
    """Leave out KiK-net's files of a borehole beside those at the surface, with a warning.

    A block stands on the ground: it does not feel the motion at depth.
    """
    stations = {_strip_suffix(path) for path in paths if path.suffix.lower() in _SURFACE}
    deep = {
        path: path.name
        for path in paths
        if path.suffix.lower() in _BOREHOLE and _strip_suffix(path) in stations
    }
    if deep:
        warnings.warn(
            f"{len(deep)} files are left out, since their sensors are in a borehole and others"
            f" of the station at the surface: {quote_names(deep.values())}."
            " read_record reads one of them",
            stacklevel=3,
        )
    return [path for path in paths if path not in deep]


def _strip_suffix(path: Path) -> Path:
    """Return the path of a station's files without their suffixes, in lower case."""
    return path.with_name(path.stem.lower())
