"""Files of K-NET and KiK-net in ASCII, one component each.

The format is described at https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html.
"""

import math

from ...tables import TextFile
from .components import Caller, Component, find_direction
from .fields import find, read_free

KNET_TITLE = r"Origin Time"
# Channels by what stands behind Dir., for KiK-net a digit: names that end in 1 are of the sensor in
# the borehole, in 2 of that at the surface.
_CHANNELS = {"N-S": "NS", "E-W": "EW", "U-D": "UD"}
_CHANNELS |= {"1": "NS1", "2": "EW1", "3": "UD1", "4": "NS2", "5": "EW2", "6": "UD2"}
KNET_SUFFIXES = tuple(f".{channel.lower()}" for channel in _CHANNELS.values())
_HEADER_LINES = 17


def read_knet(text: TextFile, caller: Caller, _: int) -> tuple[list[Component], int]:
    """Read the component of a file, which states a factor in gal a count."""
    rate = float(find(text, 10, r"^Sampling Freq.* ([\d.]+)(?:Hz)?\s*$", "a sampling rate")[1])
    duration = float(find(text, 11, r"^Duration.* ([\d.]+)\s*$", "a duration")[1])
    sensor = find(text, 12, r"^Dir\. +(N-S|E-W|U-D|[1-6])\s*$", "a direction")[1]
    factor = find(text, 13, r"^Scale.* ([\d.]+)\(gal\)/([\d.]+)\s*$", "a factor in gal")
    counts = read_free(text, _HEADER_LINES)
    if not math.isclose(counts.size, duration * rate):
        raise text.error(f"{duration:g} s at {rate:g} Hz are not {counts.size} values", 12)
    values = caller.choose_unit(text, "gal") * (float(factor[1]) / float(factor[2])) * counts
    channel = _CHANNELS[sensor.upper()]
    step = caller.choose_step(text, 1 / rate)
    component = Component(repr(str(text.path)), values, step, channel, find_direction(channel))
    return [component], len(text.lines)
