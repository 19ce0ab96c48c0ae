"""Binary files that obspy reads where it is installed: miniSEED and SAC.

obspy warns of what it leaves out, and passes over what files state about themselves. Here a
warning is an error, and statements are compared with the samples.
"""

import io
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ...host import import_optional
from ...oldtables import NamedFile
from .claims import UNIFORM, Claims
from .components import Component, Direction
from .directions import find_channel_direction
from .miniseed import count_samples, is_miniseed
from .obspy_traces import take_component

# Formats as people call them, by obspy's names.
_NAMES = {"MSEED": "miniSEED", "SAC": "SAC"}
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

# Channels of SEED of any instrument, by the last letter. Where 3, U or V point varies.
_CHANNELS: dict[str, Direction] = {r"(?:[a-z]{2})?[ne12rt]": "level", r"[a-z]{2}z": "up"}
# Fraction of a step by which channels of one file may start apart.
_TOGETHER = 0.01


def find_trace_format(content: bytes, suffix: str) -> str:
    """Find a format, "MSEED", "SAC" or "" for others, by content or else by the suffix."""
    if is_miniseed(content):
        return "MSEED"
    for order in ("little", "big"):
        version = int.from_bytes(content[_SAC_VERSION], order)
        if version in (6, 7) and int.from_bytes(content[_SAC_EVEN], order) in (0, 1):
            return "SAC"
    return _SUFFIXES.get(suffix.lower(), "") if content else ""


def read_traces(path: Path, content: bytes, claims: Claims) -> list[Component]:
    """Read the content of a miniSEED or SAC file, a component of each channel."""
    file = NamedFile(path)
    kind = find_trace_format(content, path.suffix)
    samples = count_samples(file, content) if kind == "MSEED" else None
    traces = _read_by_obspy(file, kind, content)
    sizes = [trace.data.size for trace in traces]
    if samples not in (None, sum(sizes)):
        raise file.error(f"obspy reads {sum(sizes)} samples of {samples}")
    if min(sizes, default=0) < 2:
        raise file.error("less than two samples")
    _require_whole(file, traces)
    channels = [trace.stats.channel for trace in traces]
    missing = f"{_NAMES[kind]} states no unit that can be relied on"
    components: list[Component] = []
    for trace in traces:
        # Several stations in a file may have channels of the same name.
        named = trace.stats.channel
        channel = named if channels.count(named) == 1 else trace.id
        name = f"{str(path)!r} {channel}".rstrip()
        # The factor that obspy calls calib is 1, or refused.
        component = take_component(name, trace, "m/s2", calibrated=True)
        _refuse_counts(name, trace)
        step = component.step
        direction = find_channel_direction(named, _CHANNELS) or ""
        if kind == "SAC":
            step = _check_sac(file, trace.stats.sac, component)
            direction = _find_sac_direction(file, trace.stats.sac, channel, direction)
        stated = claims.add_step(0, f"the file states {step:g} s", step)
        step = stated.require_step(file)
        unit = claims.require_unit(file, missing)
        components.append(Component(name, unit, component.values, step, direction, channel))
    return components


def _read_by_obspy(file: NamedFile, kind: str, content: bytes) -> list[Any]:
    """Read traces; a `ValueError` for any error or warning of obspy, and if it is missing."""
    with warnings.catch_warnings():
        # What obspy's own imports warn of says nothing about a file.
        warnings.simplefilter("ignore")
        try:
            obspy: Any = import_optional("obspy", "records")
        except ModuleNotFoundError as error:
            raise file.error(str(error)) from error
    options = {"checksize": True} if kind == "SAC" else {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # The content instead of the name, in which obspy would expand signs such as *.
        try:
            traces = [*obspy.read(io.BytesIO(content), format=kind, **options)]
        # Its readers pass on whatever goes wrong in them.
        except Exception as error:
            reason = _join_lines(str(error)) or type(error).__name__
            raise file.error(f"obspy cannot read it as {_NAMES[kind]}: {reason}") from error
    for warning in caught:
        # Imports at need may warn of code. SAC's step is not taken as obspy has rounded it.
        about_code = issubclass(warning.category, DeprecationWarning | FutureWarning)
        if not about_code and "Sample spacing" not in str(warning.message):
            raise file.error(f"obspy warns: {_join_lines(str(warning.message))}")
    return traces


def _join_lines(message: str) -> str:
    """Make one line of a message, cut if it is long."""
    return " ".join(message.split())[:200].rstrip(". ")


def _require_whole(file: NamedFile, traces: list[Any]) -> None:
    """Refuse channels in several pieces, and channels that do not start together."""
    names = [trace.id for trace in traces]
    first = traces[0]
    for trace in traces:
        if (pieces := names.count(trace.id)) > 1:
            raise file.error(
                f"{trace.id} is in {pieces} pieces, with gaps, overlaps or other steps between"
            )
        late = abs(trace.stats.starttime - first.stats.starttime)
        if late > _TOGETHER * first.stats.delta:
            raise file.error(
                f"{trace.id} starts {late:g} s apart from {first.id}: trim them in obspy"
            )


def _refuse_counts(name: str, trace: Any) -> None:
    """Refuse counts of an instrument, which no unit makes accelerations."""
    if (trace.data == np.round(trace.data)).all():
        raise ValueError(
            f"{name}: all samples are whole numbers, as counts of an instrument are: remove the"
            " response in obspy and use jaxrock.ground_motion.from_obspy"
        )
    if trace.stats.calib != 1:
        raise ValueError(
            f"{name}: a factor of {trace.stats.calib:g} is stated, but not whether it is applied:"
            " use obspy and jaxrock.ground_motion.from_obspy"
        )


def _find_sac_direction(
    file: NamedFile, header: Any, channel: str, named: Direction
) -> Direction:
    """Find the direction that CMPINC states, on which the name of the channel has to agree."""
    angle = float(header.get("cmpinc", _SAC_UNDEFINED))
    if angle == _SAC_UNDEFINED:
        return named
    for stated, degrees in _SAC_ANGLES.items():
        # A channel Z may point downward: the letter says that it is vertical.
        agrees = not named or (named == "level") == (stated == "level")
        if agrees and abs(angle - degrees) <= _SAC_TILT:
            return stated
    raise file.error(
        f"CMPINC is {angle:g}, but KCMPNM is {channel!r}: CMPINC must be 0 for upward, 90 for"
        " horizontal or 180 for downward"
    )


def _check_sac(file: NamedFile, header: Any, component: Component) -> float:
    """Compare the statements in a SAC header with the samples; return the step [s]."""
    quantity = int(header.get("idep", _SAC_UNKNOWN))
    if quantity not in (_SAC_UNKNOWN, _SAC_ACCELERATION):
        named = _SAC_QUANTITIES.get(quantity, str(quantity))
        raise file.error(f"acceleration was expected, but IDEP says {named}")
    if header.get("iftype") != _SAC_OVER_TIME or header.get("leven") != 1:
        raise file.error("samples in even steps of time were expected")
    # A float32, of which obspy makes whole microseconds. Here it is the shortest decimal
    # number that it may stand for.
    step = float(str(np.float32(header["delta"])))
    values = component.values
    duration = (values.size - 1) * step
    start = float(header.get("b", 0.0))
    end = float(header.get("e", start + duration))
    # Start and end are float32 as well, of about seven digits.
    digits = 1e-6 * (abs(start) + abs(end))
    if not math.isclose(end - start, duration, rel_tol=UNIFORM, abs_tol=digits):
        raise file.error(
            f"DELTA is {step:g} s, but {values.size} samples last from B= {start:g} s to"
            f" E= {end:g} s"
        )
    largest = float(abs(values).max())
    for key, extreme in (("DEPMIN", float(values.min())), ("DEPMAX", float(values.max()))):
        stated = float(header.get(key.lower(), extreme))
        if not math.isclose(stated, extreme, abs_tol=1e-5 * largest):
            raise file.error(f"{key} is {stated:g}, but that of the samples is {extreme:g}")
    return step
