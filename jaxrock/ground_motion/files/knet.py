"""Files of K-NET and KiK-net in ASCII, one component each.

The format is described at https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html.
"""

import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from ...tables import Statement, TextFile, quote_word
from .claims import Claims
from .components import Component
from .text import RecordText, Statements

# Channels by what stands behind Dir., for KiK-net a digit. Its names end in 1 for the sensors in
# the borehole and in 2 for those at the surface.
_CHANNELS = {"N-S": "NS", "E-W": "EW", "U-D": "UD"}
_CHANNELS |= {"1": "NS1", "2": "EW1", "3": "UD1", "4": "NS2", "5": "EW2", "6": "UD2"}
KNET_SUFFIXES = tuple(f".{channel.lower()}" for channel in _CHANNELS.values())
_BOREHOLE = (".ns1", ".ew1", ".ud1")
_SURFACE = (".ns2", ".ew2", ".ud2")
_HEADER_LINES = 17


class _Field(NamedTuple):
    """A line of the header: its number, its pattern, and an example of it for messages."""

    line: int
    pattern: str
    example: str


_RATE = _Field(11, r"Sampling Freq\(Hz\) +([\d.]+) ?Hz", "Sampling Freq(Hz) 100Hz")
_DURATION = _Field(12, r"Duration Time\(s\) +([\d.]+)", "Duration Time(s)  120")
_DIRECTION = _Field(13, rf"Dir\. +({'|'.join(_CHANNELS)})", "Dir.              N-S")
_SCALE = _Field(
    14, r"Scale Factor +([\d.]+)\(gal\)/([\d.]+)", "Scale Factor      2000(gal)/8388608"
)
_PEAK = _Field(15, r"Max\.? Acc\. \(gal\) +([\d.]+)", "Max. Acc. (gal)   4.383")


def recognize_knet(lines: list[str]) -> bool:
    """Return whether the lines are of a file of K-NET or KiK-net."""
    return lines[0].startswith("Origin Time")


def read_knet(
    text: TextFile | RecordText, claims: Claims | Statements, steps: Statements | None = None
) -> list[Component]:
    """Read the component of a file, whose unit and step must not contradict the `claims`.

    The file states a factor in gal a count. The offset of the instrument stays in the samples.
    """
    if not isinstance(text, TextFile) or not isinstance(claims, Claims):  # SHIM for formats.py
        text = TextFile(text.path)
        pair = cast("tuple[Statements, Statements]", (claims, steps or []))
        claims = Claims(*(tuple(Statement(*s) for s in given) for given in pair))
    (rate,) = _read_numbers(text, _RATE)
    (duration,) = _read_numbers(text, _DURATION)
    gals, counts = _read_numbers(text, _SCALE)
    (peak,) = _match_field(text, _PEAK)
    (direction,) = _match_field(text, _DIRECTION)
    claims = claims.add_unit(_SCALE.line, "the file is in gal", 0.01)
    unit = claims.require_unit(text)
    claims = claims.add_step(
        _RATE.line, f"the file states {rate:g} samples per second", 1 / rate
    )
    step = claims.require_step(text)
    values = np.array(
        [
            text.parse_number(word, number)
            for number, line in enumerate(text.lines[_HEADER_LINES:], _HEADER_LINES + 1)
            for word in line.split()
        ]
    )
    if values.size < 2 or not np.isclose(values.size, duration * rate, rtol=1e-9, atol=0):
        raise text.error(
            f"{duration:g} s were expected at {rate:g} samples per second, got {values.size}"
            " samples"
        )
    _require_whole(text)
    # The mean is the offset of the instrument.
    largest = gals / counts * float(np.abs(values - values.mean()).max())
    # A unit of the last digit, since it may have been cut instead of rounded.
    digit = 10.0 ** -len(peak.partition(".")[2])
    if abs(text.parse_number(peak, _PEAK.line) - largest) > 1.01 * digit:
        raise text.error(
            f"Max. Acc. (gal) is {peak}, but without their mean the samples reach"
            f" {largest:.6g} gal",
            _PEAK.line,
        )
    channel = _CHANNELS[direction]
    pointing = "up" if channel.startswith("UD") else "level"
    name = repr(str(text.path))
    return [Component(name, unit * gals / counts, values, step, pointing, channel)]


def leave_out_boreholes(paths: list[Path]) -> list[Path]:
    """Leave out KiK-net's files of a borehole beside those at the surface, with a warning.

    A block stands on the ground: it does not feel the motion at depth.
    """
    stations = {_name_station(path) for path in _select(paths, _SURFACE)}
    deep = [path for path in _select(paths, _BOREHOLE) if _name_station(path) in stations]
    if deep:
        listed = ", ".join(path.name for path in deep[:6]) + (", ..." if deep[6:] else "")
        warnings.warn(
            f"{len(deep)} files are left out, since their sensors are in a borehole and others"
            f" of the station at the surface: {listed}. read_record reads one of them",
            stacklevel=3,
        )
    return [path for path in paths if path not in deep]


def _select(paths: Iterable[Path], suffixes: tuple[str, ...]) -> list[Path]:
    """Select the paths that end in one of the suffixes."""
    return [path for path in paths if path.suffix.lower() in suffixes]


def _name_station(path: Path) -> tuple[Path, str]:
    """Name a station and its earthquake, by the folder and the name of a file."""
    return path.parent, path.stem.lower()


def _match_field(text: TextFile, field: _Field) -> tuple[str, ...]:
    """Match a line of the header; an error with an example if it is another one."""
    if len(text.lines) < field.line:
        raise text.error(f"the file ends before the line {field.example!r}")
    line = text.lines[field.line - 1].rstrip()
    match = re.fullmatch(field.pattern, line)
    if match is None:
        raise text.error(
            f"a line such as {field.example!r} was expected, got {quote_word(line)}",
            field.line,
        )
    return match.groups()


def _read_numbers(text: TextFile, field: _Field) -> list[float]:
    """Read the numbers in a line of the header, which have to be above 0."""
    numbers = [text.parse_number(word, field.line) for word in _match_field(text, field)]
    if min(numbers) <= 0:
        line = quote_word(text.lines[field.line - 1].rstrip())
        raise text.error(f"numbers above 0 were expected, got {line}", field.line)
    return numbers


def _require_whole(text: TextFile) -> None:
    """Refuse a text that ends within its last number: all numbers end where columns do."""
    *before, last = text.lines[_HEADER_LINES:]
    ends = {match.end() for line in before for match in re.finditer(r"\S+", line)}
    if ends and not text.ends and len(last) not in ends:
        raise text.error(
            f"the file seems to be cut within its last number, {quote_word(last.split()[-1])},"
            " after which no line end stands: other numbers in its column end further right",
            len(text.lines),
        )
