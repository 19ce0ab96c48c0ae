"""Traces of obspy and of gmprocess."""

import math
from collections.abc import Mapping, Sized
from numbers import Real
from typing import Any

import numpy as np

from ...validation import POSITIVE, check
from ..record import Record
from ..units import convert_unit, require_unit
from .components import Component, make_record


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
        hint = f" of {len(trace)}: take one out of it" if isinstance(trace, Sized) else ""
        raise ValueError(
            f"{argument} must be one trace, with data and stats.delta, got a"
            f" {type(trace).__name__}{hint}"
        )
    # gmprocess states the unit; a caller who contradicts it would be off by a factor of 981.
    standard = getattr(stats, "standard", None)
    stated = standard.get("units") if isinstance(standard, Mapping) else None
    factor = require_unit(unit)
    if stated and not math.isclose(factor, convert_unit(stated)):
        raise ValueError(f"unit is {unit!r}, but {argument} states {stated!r}")
    # obspy leaves the factor where it is when it applies it: a trace does not show if it has
    # been applied.
    calibration = getattr(stats, "calib", 1.0)
    if not isinstance(calibration, Real) or not 0 < abs(float(calibration)) < math.inf:
        raise ValueError(
            f"stats.calib of {argument} must be finite and not 0, got {calibration!r}"
        )
    if calibration != 1 and calibrated is None:
        raise ValueError(
            f"calibrated must be given: {argument} has a stats.calib of {calibration:g}, and"
            " does not state whether this factor is already in its data"
        )
    if not calibrated:
        factor *= float(calibration)
    # Merged traces have gaps as masked samples, whose data are no measurements.
    if gaps := np.ma.count_masked(trace.data):
        raise ValueError(f"{argument} must have no gaps, got {gaps} masked samples")
    data = np.asarray(trace.data)
    if data.ndim != 1 or data.dtype.kind not in "fiu":
        raise ValueError(
            f"{argument} must be a row of real numbers, got {data.dtype} of shape {data.shape}"
        )
    finite = np.isfinite(data)
    if not finite.all():
        first = int(np.argmin(finite))
        raise ValueError(f"{argument} must be finite, got {data[first]} as sample {first}")
    if not isinstance(stats.delta, Real):
        raise ValueError(
            f"stats.delta of {argument} must be a real number, got {stats.delta!r}"
        )
    check(f"stats.delta of {argument}", stats.delta, POSITIVE)
    return Component(argument, factor, data.astype(float), float(stats.delta))
