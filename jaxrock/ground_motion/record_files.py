"""Recorded ground motions from PEER's .AT2 files, .csv files and obspy's traces.

Nothing is guessed, corrected or resampled: the unit and the time step are stated by the file or
by the caller, and may not contradict each other; signs are preserved. What is wrong is a
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
from .record_formats import read_at2, read_csv, read_text
from .record_units import factor_of, in_si, unit_factor

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

    An ``.AT2`` file, as the PEER databases have them, holds one component. Its header states the
    number of values, the time step and usually the unit, g. A ``.csv`` file has columns separated
    by commas below a line with their names, and perhaps lines that begin with # above it.
    Its time step comes from a column of times (named ``time``, ``t``, ``time_s``, ``time [ms]`` or
    the like), from a line like ``# time step 0.01 s``, or from `time_step`.

    What a file states about its unit and its time step (in its header, in comments, in names of
    columns such as ``acc_g`` or ``acc [cm/s^2]``) is used. It has to agree with itself and with
    `unit` and `time_step`; a statement that is not understood is an error.

    Parameters
    ----------
    path : str or path
        An ``.AT2`` or ``.csv`` file; neither a pipe nor a device.
    unit : str, optional
        Unit of the accelerations: ``"m/s2"``, ``"cm/s2"``, ``"mm/s2"``, ``"gal"``, ``"g"``,
        ``"%g"`` or ``"mg"``, also spelled ``"m/s^2"``, ``"m/s²"``, ``"cm/sec/sec"`` and so on; g
        is standard gravity, 9.80665 m/s2. Needed unless the file states it.
    column : str, optional
        Column of the horizontal acceleration in a .csv file. Needed unless it is the only one.
    vertical : str or path, optional
        The vertical acceleration, positive upward: its column in a .csv file, or a second .AT2
        file.
    time_step : float, optional
        Time from one sample to the next [s]. Needed unless the file states it.

    Returns
    -------
    Record
        Accelerations of shape (samples,) [m/s2] and the time step [s], from time 0 on.

    Raises
    ------
    ValueError
        With file and line: if the file cannot be read, is of another format or contradicts itself
        or the arguments, if anything is missing or not a finite number, if the time step is not
        uniform, or if there are less than two samples.

    Examples
    --------
    >>> from importlib.resources import files
    >>> import jaxrock as jr
    >>> path = files("jaxrock") / "data" / "ridgecrest_2019_clc.csv"
    >>> record = jr.read_record(str(path), unit="g", column="east_g", time_step=0.01)
    >>> print(f"{record.samples} samples, {record.time_step:.2f} s apart")
    6001 samples, 0.01 s apart
    """
    path, suffix = Path(path), Path(path).suffix.lower()
    if time_step is not None:
        check("time_step", as_real("time_step", time_step), POSITIVE)
        time_step = float(time_step)
    if unit is not None:
        factor_of(unit)
    upward = None
    if suffix == ".csv":
        name = None if vertical is None else str(vertical)
        horizontal, upward, step = read_csv(read_text(path), unit, column, name, time_step)
    elif suffix == ".at2":
        if column is not None:
            raise ValueError(f"column is for .csv files, {str(path)!r} has only one")
        horizontal, step = read_at2(read_text(path), unit, time_step)
        if vertical is not None:
            first, second = repr(str(path)), repr(str(vertical))
            if Path(vertical).suffix.lower() != ".at2":
                raise ValueError(f"vertical must be an .AT2 file, as {first} is, got {second}")
            upward, upward_step = read_at2(read_text(Path(vertical)), unit)
            _check_same_sampling(second, first, upward, upward_step, horizontal, step)
    else:
        raise ValueError(f"{str(path)!r}: .AT2 and .csv files are read, not {path.suffix!r}")
    return _record(repr(str(path)), horizontal, step, upward)


def from_obspy(trace: Any, *, unit: str, vertical: Any = None) -> Record:
    """Take a ground motion from a trace of obspy, or of gmprocess.

    Neither has to be installed: a trace is anything with ``data``, ``stats.delta`` and perhaps
    ``stats.starttime`` and gmprocess's statement of the unit, ``stats.standard["units"]``. It must
    be an acceleration already; counts of an instrument are for obspy's ``remove_response``.

    Parameters
    ----------
    trace : obspy.Trace
        Horizontal acceleration, shape (samples,).
    unit : str
        Unit of the accelerations, as for `read_record`.
    vertical : obspy.Trace, optional
        Vertical acceleration, positive upward, with the same sampling and start.

    Returns
    -------
    Record
        As from `read_record`.

    Raises
    ------
    ValueError
        If it is not one trace, has gaps, values other than finite real numbers, less than two
        samples or no valid time step; if the traces differ in sampling or start; if the unit is
        unknown or not that of a trace.
    """
    horizontal, step = _trace("trace", trace, unit)
    if vertical is None:
        return _record("trace", horizontal, step)
    upward, upward_step = _trace("vertical", vertical, unit)
    _check_same_sampling("vertical", "trace", upward, upward_step, horizontal, step)
    starts = [getattr(each.stats, "starttime", None) for each in (trace, vertical)]
    if None not in starts and starts[0] != starts[1]:
        raise ValueError(f"vertical starts at {starts[1]}, but trace at {starts[0]}")
    return _record("trace", horizontal, step, upward)


def example_record(component: str = "north", *, vertical: bool = False) -> Record:
    """The Ridgecrest earthquake as recorded at China Lake, California.

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
    with as_file(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv") as path:
        return read_record(
            path,
            unit="g",
            column=f"{component}_g",
            vertical="up_g" if vertical else None,
            time_step=0.01,
        )


def _trace(argument: str, trace: Any, unit: str) -> tuple[np.ndarray, float]:
    """The accelerations [m/s2] and the time step [s] of a trace."""
    stats: Any = getattr(trace, "stats", None)
    if not hasattr(trace, "data") or not hasattr(stats, "delta"):
        kind = type(trace).__name__
        hint = f" of {len(trace)}: take one out of it" if isinstance(trace, Sized) else ""
        raise ValueError(
            f"{argument} must be one trace, with data and stats.delta, got a {kind}{hint}"
        )
    standard = getattr(stats, "standard", None)  # of gmprocess
    stated = standard.get("units") if isinstance(standard, Mapping) else None
    factor = factor_of(unit)
    if stated and not math.isclose(factor, unit_factor(stated)):
        raise ValueError(f"unit is {unit!r}, but {argument} states {stated!r}")
    data = trace.data
    if np.ma.is_masked(data):
        count = np.ma.count_masked(data)
        raise ValueError(f"{argument} must have no gaps, got {count} masked samples")
    data = np.asarray(data)
    if data.ndim != 1 or data.dtype.kind not in "fiu":
        raise ValueError(
            f"{argument} must be a row of real numbers, got {data.dtype} of shape {data.shape}"
        )
    finite = np.isfinite(data)
    if not finite.all():
        at = int(np.argmin(finite))
        raise ValueError(f"{argument} must be finite, got {data[at]} as sample {at}")
    name = f"stats.delta of {argument}"
    if not isinstance(stats.delta, Real):
        raise ValueError(f"{name} must be a real number, got {stats.delta!r}")
    check(name, stats.delta, POSITIVE)
    return in_si(factor, data.astype(float)), float(stats.delta)


def _check_same_sampling(
    name: str, other: str, values: np.ndarray, step: float, expected: np.ndarray, its_step: float
) -> None:
    if values.size != expected.size:
        raise ValueError(f"{name} has {values.size} samples, but {other} has {expected.size}")
    if not math.isclose(step, its_step, rel_tol=1e-6):
        raise ValueError(f"{name} has a step of {step} s, but {other} of {its_step} s")


def _record(
    name: str, horizontal: np.ndarray, step: float, upward: np.ndarray | None = None
) -> Record:
    try:
        return Record(horizontal, step, upward)
    except ValueError as error:  # too few samples, or too large for the precision
        raise ValueError(f"{name}: {error}") from error
