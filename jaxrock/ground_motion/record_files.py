"""Recorded ground motions from PEER's .AT2 files, .csv files and obspy's traces.

Nothing is guessed, corrected or resampled: the unit and the time step are stated by the file
or by the caller, and may not contradict each other; signs are preserved. Any fault is a
`ValueError` of one sentence.
"""

import math
import os
from collections.abc import Mapping, Sized
from importlib.resources import as_file, files
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from ..validation import POSITIVE, as_real, check
from .record import Record
from .record_formats import Component, read_at2, read_csv
from .record_text import Statements
from .record_units import UNITS, parse_unit

StrPath = str | os.PathLike[str]


def read_record(
    path: StrPath,
    *,
    unit: str | None = None,
    column: str | None = None,
    vertical: StrPath | None = None,
    time_step: float | int | None = None,
) -> Record:
    """Read a recorded ground motion from a file.

    An ``.AT2`` file, as the PEER databases have them, holds one component. A ``.csv`` file has
    columns separated by commas below a line with their names, and perhaps lines that begin
    with # above it; a column of times is named ``time``, ``t``, ``time_s``, ``time [ms]`` or
    the like. One column alone needs no name.

    What a file states about its unit and its time step (in its header, in comments such as
    ``# time step 0.01 s``, in names of columns such as ``acc_g`` or ``acc [cm/s^2]``) is used.
    It has to agree with itself and with `unit` and `time_step`, which are needed where the
    file states nothing; a statement that is not understood is an error.

    Parameters
    ----------
    path : str or path
        An ``.AT2`` or ``.csv`` file; neither a pipe nor a device.
    unit : str, optional
        Unit of the accelerations: ``"m/s2"``, ``"cm/s2"``, ``"mm/s2"``, ``"gal"``, ``"g"``,
        ``"%g"`` or ``"mg"``, also spelled ``"m/s^2"``, ``"m/s²"``, ``"cm/sec/sec"`` and so on;
        g is standard gravity, 9.80665 m/s2.
    column : str, optional
        Column of the horizontal acceleration in a .csv file. Needed unless it is the only one.
    vertical : str or path, optional
        Vertical acceleration, positive upward: a column of the .csv file, or a second .AT2
        file.
    time_step : float, optional
        Time from one sample to the next [s].

    Returns
    -------
    Record
        Accelerations of shape (samples,) [m/s2] and the time step [s], from time 0 on.

    Raises
    ------
    ValueError
        With file and line: if the file cannot be read, is of another format or contradicts
        itself or the arguments, if anything is missing or not a finite number, if the time
        step is not uniform, or if there are less than two samples.

    Examples
    --------
    >>> from importlib.resources import files
    >>> import jaxrock as jr
    >>> path = files("jaxrock") / "data" / "ridgecrest_2019_clc.csv"
    >>> record = jr.read_record(str(path), unit="g", column="east_g", time_step=0.01)
    >>> print(f"{record.samples} samples, {record.time_step:.2f} s apart")
    6001 samples, 0.01 s apart
    """
    path = Path(path)
    # What the caller states comes first: errors then say that the file disagrees.
    units = Statements()
    steps = Statements()
    if time_step is not None:
        check("time_step", as_real("time_step", time_step), POSITIVE)
        steps = [(0, f"time_step is {float(time_step)} s", float(time_step))]
    if unit is not None:
        units = [(0, f"unit is {unit!r}", _require_unit(unit))]
    if path.suffix.lower() == ".csv":
        upward = None if vertical is None else str(vertical)
        return _make_record(*read_csv(path, units, steps, column, upward))
    if path.is_dir():
        raise ValueError(
            f"{str(path)!r} is a folder: one file is read, read_suite takes folders"
        )
    if path.suffix.lower() != ".at2":
        read = f".AT2 and .csv files are read, not {path.suffix!r}"
        raise ValueError(
            f"{str(path)!r}: {read}; columns with commas, or one, are a .csv file"
        )
    if column is not None:
        raise ValueError(f"column is for .csv files, {str(path)!r} has only one")
    components = [read_at2(path, units, steps)]
    if vertical is not None:
        if Path(vertical).suffix.lower() != ".at2":
            must = f"vertical must be an .AT2 file, as {str(path)!r} is"
            raise ValueError(f"{must}, got {str(vertical)!r}")
        components.append(read_at2(Path(vertical), units, []))
    return _make_record(*components)


def from_obspy(
    trace: Any, *, unit: str, vertical: Any = None, calibrated: bool | None = None
) -> Record:
    """Take a ground motion from a trace of obspy, or of gmprocess.

    Neither has to be installed: a trace is anything with ``data``, ``stats.delta`` and perhaps
    ``stats.starttime`` and gmprocess's statement of the unit, ``stats.standard["units"]``.
    Counts of an instrument are for obspy's ``remove_response`` first.

    Parameters
    ----------
    trace, vertical : obspy.Trace
        Horizontal and perhaps vertical acceleration, positive upward, both sampled alike.
    unit : str
        Unit of the accelerations, as for `read_record`.
    calibrated : bool, optional
        Whether the data have been multiplied by ``stats.calib`` already, or are to be: obspy
        leaves the factor in place when it applies it. Needed where it is not 1.

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
    if vertical is None:
        return _make_record(_take_component("trace", trace, unit, calibrated))
    components = [
        _take_component(name, each, unit, calibrated)
        for name, each in (("trace", trace), ("vertical", vertical))
    ]
    starts = [getattr(each.stats, "starttime", None) for each in (trace, vertical)]
    if None not in starts and starts[0] != starts[1]:
        raise ValueError(f"vertical starts at {starts[1]}, but trace at {starts[0]}")
    return _make_record(*components)


def example_record(component: str = "north", *, vertical: bool = False) -> Record:
    """Return the Ridgecrest earthquake as recorded at China Lake, California.

    Moment magnitude 7.1, 2019-07-06 03:19:53 UTC, station CI.CLC of the Southern California
    Seismic Network: 60 s of uncorrected acceleration, minus the mean before the event.
    Distributed by the Center for Engineering Strong Motion Data; taken from the demonstration
    data of gmprocess 2.8.0 by the U.S. Geological Survey.

    Parameters
    ----------
    component : {"north", "east"}
        The horizontal component, positive in the direction of its name.
    vertical : bool
        Whether to include the vertical component.

    Returns
    -------
    Record
        6001 samples [m/s2], 0.01 s apart.

    Raises
    ------
    ValueError
        If there is no such component.

    Examples
    --------
    >>> from jaxrock import example_record
    >>> record = example_record()
    >>> print(f"{record.samples} samples, at most {abs(record.acceleration).max():.3f} m/s2")
    6001 samples, at most 5.009 m/s2
    """
    if component not in ("north", "east"):
        raise ValueError(f"component must be 'north' or 'east', got {component!r}")
    column = f"{component}_g"
    upward = "up_g" if vertical else None
    with as_file(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv") as path:
        return read_record(path, unit="g", column=column, vertical=upward, time_step=0.01)


def _require_unit(unit: str) -> float:
    """Convert the argument `unit` to m/s2; a `ValueError` if it is not understood."""
    factor = parse_unit(unit)
    if math.isnan(factor):
        raise ValueError(f"unit must be {UNITS}, got {unit!r}")
    return factor


def _take_component(
    argument: str, trace: Any, unit: str, calibrated: bool | None
) -> Component:
    """Take the accelerations out of a trace, the `argument` of that name, and check them."""
    # By attributes, not by class: neither obspy nor gmprocess needs to be installed.
    stats: Any = getattr(trace, "stats", None)
    if not hasattr(trace, "data") or not hasattr(stats, "delta"):
        hint = f" of {len(trace)}: take one out of it" if isinstance(trace, Sized) else ""
        must = f"{argument} must be one trace, with data and stats.delta"
        raise ValueError(f"{must}, got a {type(trace).__name__}{hint}")
    # gmprocess states the unit; a caller who contradicts it would be off by a factor of 981.
    standard = getattr(stats, "standard", None)
    stated = standard.get("units") if isinstance(standard, Mapping) else None
    factor = _require_unit(unit)
    if stated and not math.isclose(factor, parse_unit(stated)):
        raise ValueError(f"unit is {unit!r}, but {argument} states {stated!r}")
    # obspy leaves the factor where it is when it applies it, so that a trace cannot tell
    # whether it has been applied.
    calibration = getattr(stats, "calib", 1.0)
    if not isinstance(calibration, Real) or not 0 < abs(float(calibration)) < math.inf:
        got = f"got {calibration!r}"
        raise ValueError(f"stats.calib of {argument} must be finite and not 0, {got}")
    if calibration != 1 and calibrated is None:
        states = (
            f"{argument} has a stats.calib of {calibration:g}, which obspy leaves in place"
        )
        raise ValueError(f"calibrated must be given: {states} whether applied or not")
    if not calibrated:
        factor *= float(calibration)
    # Merged traces have gaps as masked samples, whose data are no measurements.
    if gaps := np.ma.count_masked(trace.data):
        raise ValueError(f"{argument} must have no gaps, got {gaps} masked samples")
    data = np.asarray(trace.data)
    if data.ndim != 1 or data.dtype.kind not in "fiu":
        got = f"{data.dtype} of shape {data.shape}"
        raise ValueError(f"{argument} must be a row of real numbers, got {got}")
    if not np.isfinite(data).all():
        at = int(np.argmin(np.isfinite(data)))
        raise ValueError(f"{argument} must be finite, got {data[at]} as sample {at}")
    if not isinstance(stats.delta, Real):
        raise ValueError(
            f"stats.delta of {argument} must be a real number, got {stats.delta!r}"
        )
    check(f"stats.delta of {argument}", stats.delta, POSITIVE)
    return Component(argument, factor, data.astype(float), float(stats.delta))


def _make_record(horizontal: Component, *upward: Component) -> Record:
    """Make the record of one or two components; a `ValueError` if they do not fit together."""
    name, _, values, step = horizontal
    for other in upward:
        if other.values.size != values.size:
            samples = f"{other.name} has {other.values.size} samples"
            raise ValueError(f"{samples}, but {name} has {values.size}")
        if not math.isclose(other.step, step, rel_tol=1e-6):
            raise ValueError(
                f"{other.name} has a step of {other.step} s, but {name} of {step} s"
            )
    # What overflows is inf, which the record refuses.
    with np.errstate(over="ignore"):
        accelerations, *upwards = (each.factor * each.values for each in (horizontal, *upward))
    try:
        return Record(accelerations, step, *upwards)
    # Too few samples, or accelerations too large for the precision of JAX.
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
