"""Binary files that obspy reads where it is installed: miniSEED and SAC.

obspy warns of what it leaves out, and passes over what files state about themselves. Here a
warning is an error, and statements are compared with the samples.
"""

import io
import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ...host import import_optional, read_regular
from .components import Component, Direction
from .miniseed import find_fault, is_miniseed
from .obspy_traces import take_component
from .text import STEP, Statements
from .units import UNITS

# Formats as people call them, by obspy's names.
_NAMES = {"MSEED": "miniSEED", "SAC": "SAC", "KNET": "K-NET"}
_SUFFIXES = {".mseed": "MSEED", ".miniseed": "MSEED", ".msd": "MSEED", ".sac": "SAC"}
TRACE_SUFFIXES = (*_SUFFIXES,)

# Two numbers in a header of SAC: its version, and whether steps are even.
_SAC_VERSION = slice(304, 308)
_SAC_EVEN = slice(420, 424)
# SAC's codes: what the samples are, and that they are samples over time.
_SAC_QUANTITIES = {6: "displacement", 7: "velocity", 50: "volts"}
_SAC_UNKNOWN = 5
_SAC_ACCELERATION = 8
_SAC_OVER_TIME = 1
_SAC_UNDEFINED = -12345.0
# Degrees from upward, and how far components may be off, as in SEED.
_SAC_ANGLES: dict[Direction, float] = {"up": 0.0, "level": 90.0, "down": 180.0}
_SAC_TILT = 5.0

# Channels of SEED, by the last letter, and of K-NET. Where 3, U or V point varies.
_LEVEL = r"(?:[A-Z]{2})?[NE12RT]|(?:NS|EW)[12]?"
_UPWARD = r"(?:[A-Z]{2})?Z|UD[12]?"
# Fraction of a step by which channels of one file may start apart.
_TOGETHER = 0.01


def find_trace_format(path: Path) -> str:
    """Find a binary format, by content or else by name: "MSEED" or "SAC", "" for others."""
    try:
        content = read_regular(path)
    # Whoever reads the file next says what is wrong with it.
    except OSError:
        return ""
    if is_miniseed(content):
        return "MSEED"
    for order in ("little", "big"):
        version = int.from_bytes(content[_SAC_VERSION], order)
        if version in (6, 7) and int.from_bytes(content[_SAC_EVEN], order) in (0, 1):
            return "SAC"
    return _SUFFIXES.get(path.suffix.lower(), "") if content else ""


def read_traces(path: Path, units: Statements, steps: Statements) -> list[Component]:
    """Read a miniSEED or SAC file, a component of each channel.

    Neither format states a unit that can be relied on, so that the caller has to. Counts of an
    instrument are refused, and channels with gaps.
    """
    kind = find_trace_format(path)
    content = read_regular(path)
    if kind == "MSEED" and (fault := find_fault(content)):
        raise make_error(path, fault)
    traces = read_by_obspy(path, kind, content)
    _refuse_pieces(path, traces)
    channels = [trace.stats.channel for trace in traces]
    components = []
    for trace in traces:
        # Several stations in a file may have channels of the same name.
        unique = channels.count(trace.stats.channel) == 1
        channel = trace.stats.channel if unique else trace.id
        name = f"{str(path)!r} {channel}".rstrip()
        # The factor that obspy calls calib is 1, or refused.
        found = take_component(name, trace, "m/s2", calibrated=True)
        _refuse_counts(name, trace)
        step = _check_sac(path, trace.stats.sac, found) if kind == "SAC" else found.step
        for _, words, given in steps:
            if not math.isclose(given, step, rel_tol=STEP[1]):
                raise make_error(path, f"{words}, but the file states {step:g} s")
            step = given
        direction = find_channel_direction(trace.stats.channel)
        if kind == "SAC":
            direction = _find_sac_direction(path, trace.stats.sac, channel, direction)
        if not units:
            said = "states no unit that can be relied on, so that unit must be given"
            raise make_error(path, f"{_NAMES[kind]} {said}: {UNITS}")
        components.append(Component(name, units[0][2], found.values, step, direction, channel))
    return components


def read_by_obspy(path: Path, kind: str, content: bytes) -> list[Any]:
    """Read traces; a `ValueError` for any error or warning of obspy, and if it is missing."""
    with warnings.catch_warnings():
        # What obspy's own imports warn of says nothing about a file.
        warnings.simplefilter("ignore")
        try:
            obspy: Any = import_optional("obspy", "records")
        except ModuleNotFoundError as error:
            raise make_error(path, str(error)) from error
    options = {"checksize": True} if kind == "SAC" else {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # The content instead of the name, in which obspy would expand signs such as *.
        try:
            traces = [*obspy.read(io.BytesIO(content), format=kind, **options)]
        # Its readers pass on whatever goes wrong in them.
        except Exception as error:
            reason = _join_lines(str(error)) or type(error).__name__
            said = f"obspy cannot read it as {_NAMES[kind]}: {reason}"
            raise make_error(path, said) from error
    for each in caught:
        # Imports at need may warn of code. SAC's step is not taken as obspy has rounded it.
        about_code = issubclass(each.category, DeprecationWarning | FutureWarning)
        if not about_code and "Sample spacing" not in str(each.message):
            raise make_error(path, f"obspy warns: {_join_lines(str(each.message))}")
    if min((trace.data.size for trace in traces), default=0) < 2:
        raise make_error(path, "less than two samples")
    return traces


def find_channel_direction(channel: str) -> Direction:
    """Find the direction of a channel by its name, empty if it is not known."""
    # UD2 is K-NET's, though in SEED the last letter would be a horizontal one.
    if re.fullmatch(_UPWARD, channel.upper()):
        return "up"
    return "level" if re.fullmatch(_LEVEL, channel.upper()) else ""


def make_error(path: Path, reason: str) -> ValueError:
    """Make the error that gives the reason, with the file."""
    return ValueError(f"{str(path)!r}: {reason}")


def _join_lines(message: str) -> str:
    """Make one line of a message, cut if it is long."""
    return " ".join(message.split())[:200].rstrip(". ")


def _refuse_pieces(path: Path, traces: list[Any]) -> None:
    """Refuse channels in several pieces, and channels that do not start together."""
    names = [trace.id for trace in traces]
    first = traces[0].stats
    for name, trace in zip(names, traces, strict=True):
        if (pieces := names.count(name)) > 1:
            gaps = f"{name} is in {pieces} pieces, with gaps, overlaps or other steps between"
            raise make_error(path, gaps)
        apart = abs(trace.stats.starttime - first.starttime)
        if apart > _TOGETHER * first.delta:
            late = f"{name} starts {apart:g} s apart from {names[0]}: trim them in obspy"
            raise make_error(path, late)


def _refuse_counts(name: str, trace: Any) -> None:
    """Refuse counts of an instrument, which no unit makes accelerations."""
    if (trace.data == np.round(trace.data)).all():
        whole = "all samples are whole numbers, as counts of an instrument are"
        way = "remove the response in obspy and use jaxrock.from_obspy"
        raise ValueError(f"{name}: {whole}: {way}")
    if trace.stats.calib != 1:
        factor = f"a factor of {trace.stats.calib:g} is stated, but not whether it is applied"
        raise ValueError(f"{name}: {factor}: use obspy and jaxrock.from_obspy")


def _find_sac_direction(path: Path, header: Any, channel: str, named: Direction) -> Direction:
    """Find the direction that CMPINC states, on which the name of the channel has to agree."""
    angle = float(header.get("cmpinc", _SAC_UNDEFINED))
    if angle == _SAC_UNDEFINED:
        return named
    near: list[Direction] = [
        d for d, at in _SAC_ANGLES.items() if abs(angle - at) <= _SAC_TILT
    ]
    stated = near[0] if near else ""
    if not stated:
        must = "CMPINC must be 0, 90 or 180, for upward, horizontal or downward"
        raise make_error(path, f"{must}, got {angle:g}")
    # A channel Z may point downward: the letter says that it is vertical.
    if named and (named == "level") != (stated == "level"):
        says = f"CMPINC is {angle:g}, but KCMPNM is {channel!r}"
        raise make_error(path, f"{says}: 0 is upward, 90 horizontal, 180 downward")
    return stated


def _check_sac(path: Path, header: Any, found: Component) -> float:
    """Compare the statements in a SAC header with the samples; return the step [s]."""
    quantity = int(header.get("idep", _SAC_UNKNOWN))
    if quantity not in (_SAC_UNKNOWN, _SAC_ACCELERATION):
        named = _SAC_QUANTITIES.get(quantity, str(quantity))
        raise make_error(path, f"acceleration was expected, but IDEP says {named}")
    if header.get("iftype") != _SAC_OVER_TIME or header.get("leven") != 1:
        raise make_error(path, "samples in even steps of time were expected")
    # A float32, of which obspy makes whole microseconds. Here it is the shortest decimal
    # number that it may stand for.
    step = float(str(np.float32(header["delta"])))
    duration = (found.values.size - 1) * step
    start = float(header.get("b", 0.0))
    end = float(header.get("e", start + duration))
    # Start and end are float32 as well, of about seven digits.
    digits = 1e-6 * (abs(start) + abs(end))
    if not math.isclose(end - start, duration, rel_tol=STEP[1], abs_tol=digits):
        lasts = f"{found.values.size} samples last from B= {start:g} s to E= {end:g} s"
        raise make_error(path, f"DELTA is {step:g} s, but {lasts}")
    least = float(found.values.min())
    most = float(found.values.max())
    for key, extreme in (("depmin", least), ("depmax", most)):
        stated = float(header.get(key, extreme))
        if not math.isclose(stated, extreme, abs_tol=1e-5 * max(abs(least), abs(most))):
            wrong = (
                f"{key.upper()} is {stated:g}, but the samples lie in {least:g} to {most:g}"
            )
            raise make_error(path, wrong)
    return step
