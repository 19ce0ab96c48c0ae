"""Reading recorded ground motions: PEER's .AT2 files, .csv files and obspy traces.

Nothing is guessed, corrected or resampled: the unit and the time step are stated by the file or
by the caller and never contradict each other, signs are kept, and what is not as it should be
is a `ValueError` of one sentence.
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
from .record_at2 import read_at2
from .record_csv import read_csv
from .record_header import unit_factor
from .record_text import factor_of, in_si, read_text

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

    An ``.AT2`` file, as the PEER databases give them, holds one component. Its header says
    the number of values, the time step and as a rule the unit, g.

    A ``.csv`` file has columns separated by commas, below one line with their names; lines
    that begin with # may stand before it. The time step comes from a column of times (named
    ``time``, ``t``, ``time_s``, ``time [ms]`` or the like), from a line like
    ``# time step 0.01 s``, or from `time_step`. Only the columns that are asked for are read.

    What a file says about its unit and its time step (in its header, in comments, in the names
    of its columns such as ``acc_g`` or ``acc [cm/s^2]``) is used, and has to agree with itself
    and with `unit` and `time_step`. What it says in other units than these is an error.

    Parameters
    ----------
    path : str or path
        The file, ``.AT2`` or ``.csv``; a regular file, neither a pipe nor a device.
    unit : str, optional
        Unit of the accelerations: ``"m/s2"``, ``"cm/s2"``, ``"mm/s2"``, ``"gal"``, ``"g"``,
        ``"%g"`` or ``"mg"``, also spelled ``"m/s^2"``, ``"m/s²"``, ``"cm/sec/sec"`` and so on.
        It must be given unless the file states it. g is standard gravity, 9.80665 m/s2.
    column : str, optional
        Name of the column of horizontal acceleration, in a .csv file. It must be given where
        there is more than one that it could be.
    vertical : str or path, optional
        The vertical acceleration, positive upward: the name of its column in a .csv file, or
        a second .AT2 file.
    time_step : float, optional
        Time from one sample to the next [s]. It must be given if the file does not state it;
        if it does, they must agree.

    Returns
    -------
    Record
        Accelerations of shape (samples,) in m/s2 and the time step in s, from time 0 on.

    Raises
    ------
    ValueError
        If the file cannot be read, is neither of the two formats or contradicts itself or the
        arguments, if
        anything in it is missing or not a finite number, if the time step is not uniform, or
        if there are less than two samples. It names the file and the line.

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
    if time_step is not None:
        check("time_step", as_real("time_step", time_step), POSITIVE)
        time_step = float(time_step)
    if unit is not None:
        factor_of(unit)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        horizontal, upward, step = read_csv(read_text(path), unit, column, vertical, time_step)
    elif suffix == ".at2":
        if column is not None:
            raise ValueError(f"column is for .csv files, {str(path)!r} has only one")
        horizontal, step = read_at2(read_text(path), unit, time_step)
        upward = None
        if vertical is not None:
            upward = _read_other_at2(Path(vertical), unit, path, horizontal.size, step)
    else:
        raise ValueError(f"{str(path)!r}: .AT2 and .csv files are read, not {path.suffix!r}")
    return _record(repr(str(path)), horizontal, step, upward)


def from_obspy(trace: Any, *, unit: str, vertical: Any = None) -> Record:
    """Take a ground motion from a trace of obspy, or of gmprocess.

    Neither has to be installed: a trace is anything with ``data``, ``stats.delta`` and perhaps
    ``stats.starttime`` and the unit as gmprocess states it, ``stats.standard["units"]``. It
    must be acceleration already; counts of an instrument are for obspy's ``remove_response``.

    Parameters
    ----------
    trace : obspy.Trace
        Horizontal acceleration, shape (samples,).
    unit : str
        Unit of the accelerations, as for `read_record`.
    vertical : obspy.Trace, optional
        Vertical acceleration, positive upward: as long, as dense and from the same time on.

    Returns
    -------
    Record
        As from `read_record`.

    Raises
    ------
    ValueError
        If it is not one trace, has gaps or anything but finite real numbers, is shorter than
        two samples, or has no valid time step; if the traces do not match; if the unit is not
        known or not that of a trace.
    """
    horizontal, step = _trace("trace", trace, unit)
    if vertical is None:
        return _record("trace", horizontal, step)
    upward, other_step = _trace("vertical", vertical, unit)
    _same_sampling("vertical", "trace", (upward.size, other_step), (horizontal.size, step))
    starts = [getattr(each.stats, "starttime", None) for each in (trace, vertical)]
    if None not in starts and starts[0] != starts[1]:
        raise ValueError(f"vertical starts at {starts[1]}, but trace at {starts[0]}")
    return _record("trace", horizontal, step, upward)


def example_record(component: str = "north", *, vertical: bool = False) -> Record:
    """A real ground motion: the Ridgecrest earthquake at China Lake, California.

    Moment magnitude 7.1, 2019-07-06 03:19:53 UTC, station CI.CLC of the Southern California
    Seismic Network: 60 s of uncorrected acceleration, 100 samples per second, of which only
    the mean before was removed. Distributed by the Center for Engineering Strong Motion
    Data; taken from the demonstration data of gmprocess 2.8.0 by the U.S. Geological Survey.

    Parameters
    ----------
    component : {"north", "east"}
        The horizontal component, positive to where its name says.
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


def _read_other_at2(
    path: Path, unit: str | None, first: Path, points: int, step: float
) -> np.ndarray:
    if path.suffix.lower() != ".at2":
        raise ValueError(f"vertical must be an .AT2 file, as {str(first)!r} is, got {str(path)!r}")
    values, other_step = read_at2(read_text(path), unit)
    names = repr(str(path)), repr(str(first))
    _same_sampling(*names, (values.size, other_step), (points, step))
    return values


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
    if stated and not math.isclose(factor, unit_factor(stated) or math.nan):
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


def _same_sampling(
    name: str, first: str, sampling: tuple[int, float], expected: tuple[int, float]
) -> None:
    if sampling[0] != expected[0]:
        raise ValueError(f"{name} has {sampling[0]} samples, but {first} has {expected[0]}")
    if not math.isclose(sampling[1], expected[1], rel_tol=1e-6):
        raise ValueError(f"{name} has a step of {sampling[1]} s, but {first} of {expected[1]} s")


def _record(
    name: str, horizontal: np.ndarray, step: float, upward: np.ndarray | None = None
) -> Record:
    try:
        return Record(horizontal, step, upward)
    except ValueError as error:  # too few samples, or too large for the precision
        raise ValueError(f"{name}: {error}") from error
