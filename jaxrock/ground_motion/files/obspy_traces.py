"""Traces of obspy and of gmprocess, and the files that obspy reads."""

import io
import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...host import import_optional
from ...tables import NamedFile
from ..record import Record
from ..units import convert_unit, require_unit
from .components import Caller, Component, find_direction, make_record

# Fraction of a step by which channels of one file may start apart.
_TOGETHER = 0.01


def from_obspy(
    trace: Any, *, unit: str, vertical: Any = None, calibrated: bool | None = None
) -> Record:
    """Make a record from a trace of obspy or of gmprocess.

    Neither has to be installed: a trace is anything with ``data``, ``stats.delta`` and
    perhaps ``stats.starttime`` and gmprocess's statement of the unit,
    ``stats.standard["units"]``. Instrument counts must be converted first, by obspy's
    ``remove_response``.

    Parameters
    ----------
    trace, vertical : obspy.Trace
        Horizontal and perhaps vertical acceleration, positive upward, both sampled alike.
    unit : str
        Unit of the accelerations, as for `read_record`.
    calibrated : bool, optional
        Whether the data have already been multiplied by ``stats.calib``; if False, they are
        multiplied here. Needed where this factor is not 1, since obspy does not reset it when
        it applies it.

    Returns
    -------
    Record

    Raises
    ------
    ValueError
        If a calibration factor other than 1 may or may not have been applied; if it is not one
        trace, has gaps, values other than finite real numbers, less than two samples or no
        valid time step; if the traces differ in sampling or start; if the unit is unknown or
        not the one that a trace states.
    """
    horizontal = take_component("trace", trace, unit, calibrated)
    if vertical is None:
        return make_record(horizontal)
    upward = take_component("vertical", vertical, unit, calibrated)
    starts = [getattr(stats, "starttime", None) for stats in (trace.stats, vertical.stats)]
    if None not in starts and starts[0] != starts[1]:
        raise ValueError(f"vertical starts at {starts[1]}, but trace at {starts[0]}")
    return make_record(horizontal, upward)


def take_component(argument: str, trace: Any, unit: str, calibrated: bool | None) -> Component:
    """Take the accelerations out of a trace, the `argument` of that name, and check them."""
    # By attributes, not by class: neither obspy nor gmprocess needs to be installed.
    stats: Any = getattr(trace, "stats", None)
    if not hasattr(trace, "data") or not hasattr(stats, "delta"):
        raise ValueError(
            f"{argument} must be one trace, with data and stats.delta, got a"
            f" {type(trace).__name__}"
        )
    # gmprocess states the unit; a caller who contradicts it would be off by a factor of 981.
    standard = getattr(stats, "standard", None)
    stated = standard.get("units") if isinstance(standard, Mapping) else None
    factor = require_unit(unit)
    if stated and not math.isclose(factor, convert_unit(stated)):
        raise ValueError(f"unit is {unit!r}, but {argument} states {stated!r}")
    # obspy leaves the factor where it is when it applies it: a trace does not show if it has
    # been applied.
    calibration = float(getattr(stats, "calib", 1.0))
    if calibration != 1 and calibrated is None:
        raise ValueError(
            f"calibrated must be given, to from_obspy: {argument} has a stats.calib of"
            f" {calibration:g}, and does not state whether this factor is already in its data"
        )
    if not calibrated:
        factor *= calibration
    # Merged traces have gaps as masked samples, whose data are no measurements.
    data = np.asarray(trace.data)
    if np.ma.is_masked(trace.data) or data.ndim != 1 or data.dtype.kind not in "fiu":
        raise ValueError(
            f"{argument} must be a row of real numbers without gaps, got {data.dtype} of shape"
            f" {data.shape}"
        )
    return Component(argument, factor * data.astype(float), float(stats.delta))


def read_traces(file: NamedFile, content: bytes, caller: Caller) -> list[Component]:
    """Read the content of a file by obspy, a component of each channel."""
    if caller.unit is None:
        raise file.error("obspy's files state no unit that can be relied on: give unit")
    obspy: Any = import_optional("obspy", "records")
    with warnings.catch_warnings():
        # obspy warns of what it leaves out.
        warnings.simplefilter("error", UserWarning)
        # The content instead of the name, in which obspy would expand signs such as *. Its
        # readers pass on whatever goes wrong in them.
        try:
            traces = [*obspy.read(io.BytesIO(content))]
        except Exception as error:
            raise file.error(f"obspy does not read it: {error!r:.200}") from error
    channels = [trace.stats.channel for trace in traces]
    ids = [trace.id for trace in traces]
    components = []
    for trace in traces:
        if trace.data.dtype.kind != "f":
            raise file.error(
                "the samples are counts of an instrument: remove the response in obspy, and use"
                " jaxrock.ground_motion.from_obspy"
            )
        late = abs(trace.stats.starttime - traces[0].stats.starttime)
        if ids.count(trace.id) > 1 or late > _TOGETHER * trace.stats.delta:
            raise file.error(
                f"{trace.id} is in pieces, or starts {late:g} s apart from {ids[0]}"
            )
        named = trace.stats.channel
        channel = named if channels.count(named) == 1 else trace.id
        component = take_component(
            f"{str(file.path)!r} {channel}".rstrip(), trace, caller.unit, None
        )
        caller.choose_step(file, component.step)
        components.append(component._replace(channel=channel, direction=find_direction(named)))
    return components
