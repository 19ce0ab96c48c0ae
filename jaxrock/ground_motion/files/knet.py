"""Files of K-NET and KiK-net in ASCII, one component each, read by obspy."""

import math

import numpy as np

from .components import Component
from .cut import refuse_cut_column
from .obspy_files import find_channel_direction, read_by_obspy
from .obspy_traces import take_component
from .text import STEP, UNIT, RecordText, Statements, quote_word

# KiK-net has a digit: 1 in the borehole, 2 at the surface.
KNET_SUFFIXES = tuple(
    f".{axis}{place}" for axis in ("ns", "ew", "ud") for place in ("", "1", "2")
)
# As many are enough to see where columns end.
_LAST_LINES = 200
_HEADER_LINES = 17
_PEAK = "Max. Acc. (gal)"


def recognize_knet(lines: list[str]) -> bool:
    """Tell whether the lines are of a file of K-NET or KiK-net."""
    return lines[0].startswith("Origin Time")


def read_knet(text: RecordText, units: Statements, steps: Statements) -> list[Component]:
    """Read the component of a file, where the caller states `units` and `steps`.

    The file states a factor in gal a count. The offset of the instrument stays in the samples.
    """
    (trace,) = read_by_obspy(text.path, "KNET", "\n".join(text.lines).encode())
    channel = trace.stats.channel
    # obspy converts the factor to m/s2 a count, and does not apply it.
    found = take_component(repr(str(text.path)), trace, "m/s2", calibrated=False)
    text.require_agreement(UNIT, [*units, (0, "the file is in gal", 0.01)], "")
    rate = trace.stats.sampling_rate
    stated = (0, f"the file states {rate:g} samples per second", found.step)
    step = text.require_agreement(STEP, [*steps, stated], "")
    duration = trace.stats.knet["duration"]
    samples = found.values.size
    text.refuse(
        not math.isclose(samples, duration * rate),
        f"{duration:g} s were expected at {rate:g} samples per second, got {samples} samples",
    )
    refuse_cut_column(text, text.lines[_HEADER_LINES:][-_LAST_LINES:])
    _check_peak(text, found.factor * found.values / 0.01)
    direction = find_channel_direction(channel)
    text.refuse(not direction, f"Dir. is no direction of K-NET, got {quote_word(channel)}")
    return [found._replace(step=step, direction=direction, channel=channel)]


def _check_peak(text: RecordText, gals: np.ndarray) -> None:
    """Compare the peak that a file states, after its mean is removed, with the samples."""
    peak = float(np.abs(gals - gals.mean()).max())
    # obspy has read that line.
    number, line = next(
        (n, line) for n, line in enumerate(text.lines, 1) if line.startswith(_PEAK)
    )
    word = line.removeprefix(_PEAK).strip()
    stated = text.parse_number(word, number, _PEAK)
    # A unit of the last digit, since it may have been cut instead of rounded.
    unit = 10.0 ** -len(word.partition(".")[2])
    wrong = f"{_PEAK} is {word}, but without their mean the samples reach {peak:.6g} gal"
    text.refuse(abs(stated - peak) > 1.01 * unit, wrong, number)
