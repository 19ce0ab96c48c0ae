"""Files of K-NET and KiK-net in ASCII, one component each.

The format is described at https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html.
"""

import re
import warnings
from pathlib import Path

import numpy as np

from ...tables import TextFile, quote_names, quote_word
from .claims import Claims
from .components import Component

# Channels by what stands behind Dir., for KiK-net a digit. Its names end in 1 for the sensors in
# the borehole and in 2 for those at the surface.
_CHANNELS = {"N-S": "NS", "E-W": "EW", "U-D": "UD"}
_CHANNELS |= {"1": "NS1", "2": "EW1", "3": "UD1", "4": "NS2", "5": "EW2", "6": "UD2"}
KNET_SUFFIXES = tuple(f".{channel.lower()}" for channel in _CHANNELS.values())
_BOREHOLE = (".ns1", ".ew1", ".ud1")
_SURFACE = (".ns2", ".ew2", ".ud2")

# What is read of the header, by its lines.
_HEADER_LINES = 17
_RATE = 11
_DURATION = 12
_DIRECTION = 13
_SCALE = 14
_PEAK = 15
_FIELDS = {_RATE: "Sampling Freq(Hz)", _DURATION: "Duration Time(s)", _DIRECTION: "Dir."}
_FIELDS |= {_SCALE: "Scale Factor", _PEAK: "Max. Acc. (gal)"}


def recognize_knet(lines: list[str]) -> bool:
    """Return whether the lines are of a file of K-NET or KiK-net."""
    return lines[0].startswith("Origin Time")


def read_knet(text: TextFile, claims: Claims) -> list[Component]:
    """Read the component of a file, whose unit and step must not contradict the `claims`.

    The file states a factor in gal a count. The offset of the instrument stays in the samples.
    """
    rate = _parse_positive(text, _RATE, _read_field(text, _RATE).removesuffix("Hz"))
    duration = _parse_positive(text, _DURATION, _read_field(text, _DURATION))
    direction = _read_field(text, _DIRECTION)
    if direction not in _CHANNELS:
        names = ", ".join(_CHANNELS)
        raise text.error(
            f"Dir. must be one of {names}, got {quote_word(direction)}", _DIRECTION
        )
    gals, _, counts = _read_field(text, _SCALE).partition("(gal)/")
    gals_per_count = _parse_positive(text, _SCALE, gals) / _parse_positive(
        text, _SCALE, counts
    )
    unit = claims.add_unit(_SCALE, "the file is in gal", 0.01).require_unit(text)
    words = f"the file states {rate:g} samples per second"
    step = claims.add_step(_RATE, words, 1 / rate).require_step(text)
    values = text.read_values(
        _HEADER_LINES,
        _parse_counts,
        lambda line, number: [text.parse_number(word, number) for word in line.split()],
    )
    if values.size < 2 or values.size != round(duration * rate, 6):
        raise text.error(
            f"{duration:g} s were expected at {rate:g} samples per second, got {values.size}"
            " samples"
        )
    _require_last_number(text)
    _require_peak(text, gals_per_count * values)
    channel = _CHANNELS[direction]
    pointing = "up" if channel.startswith("UD") else "level"
    name = repr(str(text.path))
    return [Component(name, unit * gals_per_count, values, step, pointing, channel)]


def leave_out_boreholes(paths: list[Path]) -> list[Path]:
    """Leave out KiK-net's files of a borehole beside those at the surface, with a warning.

    A block stands on the ground: it does not feel the motion at depth.
    """
    stations = {
        (path.parent, path.stem.lower()) for path in paths if path.suffix.lower() in _SURFACE
    }
    # A dictionary, in which a path is found at once: archives have thousands of files.
    deep = {
        path: path.name
        for path in paths
        if path.suffix.lower() in _BOREHOLE and (path.parent, path.stem.lower()) in stations
    }
    if deep:
        warnings.warn(
            f"{len(deep)} files are left out, since their sensors are in a borehole and others"
            f" of the station at the surface: {quote_names(deep.values())}."
            " read_record reads one of them",
            stacklevel=3,
        )
    return [path for path in paths if path not in deep]


def _read_field(text: TextFile, number: int) -> str:
    """Read what stands behind the name of a field, in the line of this number."""
    line = "".join(text.lines[number - 1 : number])
    # The description of the format has Max Acc., its files Max. Acc.
    pattern = re.escape(_FIELDS[number]).replace(r"\.", r"\.?")
    match = re.fullmatch(rf"{pattern} +(\S+) *", line)
    if match is None:
        raise text.error(f"{_FIELDS[number]} was expected, got {quote_word(line)}", number)
    return match[1]


def _parse_positive(text: TextFile, line: int, word: str) -> float:
    """Convert a word in the header to a number above 0."""
    value = text.parse_number(word, line, _FIELDS[line])
    if value <= 0:
        raise text.error(f"{_FIELDS[line]} must be above 0, got {quote_word(word)}", line)
    return value


def _parse_counts(lines: list[str]) -> np.ndarray:
    """Convert all counts of a file; a `ValueError` if one of them is no number."""
    joined = " ".join(lines)
    # 1_000 is a number in Python only.
    return np.array([*map(float, joined.replace("_", "?").split())])


def _require_last_number(text: TextFile) -> None:
    """Refuse a text that ends within its last number: all numbers end where columns do."""
    if text.ends:
        return
    *before, last = text.lines[_HEADER_LINES:]
    ends = {match.end() for line in before for match in re.finditer(r"\S+", line)}
    if ends and len(last) not in ends:
        raise text.error(
            f"the file seems to be cut within its last number, {quote_word(last.split()[-1])},"
            " after which no line end stands: other numbers in its column end further right",
            len(text.lines),
        )


def _require_peak(text: TextFile, gals: np.ndarray) -> None:
    """Refuse samples whose peak is not the stated one, after their mean is removed."""
    word = _read_field(text, _PEAK)
    stated = text.parse_number(word, _PEAK, _FIELDS[_PEAK])
    peak = float(np.abs(gals - gals.mean()).max())
    # A unit of the last digit, since it may have been cut instead of rounded.
    digit = 10.0 ** -len(word.partition(".")[2])
    if abs(stated - peak) > 1.01 * digit:
        raise text.error(
            f"Max. Acc. (gal) is {word}, but without their mean the samples reach {peak:.6g} gal",
            _PEAK,
        )
