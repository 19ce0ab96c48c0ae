"""Measurements of free rocking, read from files."""

import math
import os
from pathlib import Path

import numpy as np

from ..host import is_number, numbered_lines


def read_impact_times(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the times of impacts, and perhaps the peaks between them, for `fit_free_rocking`.

    Parameters
    ----------
    path : str or path
        A text file, as .csv, with a line for each impact: its time [s], and perhaps after a
        comma the largest rotation between it and the next [rad], to either side, empty or NaN
        where unknown. What stands in the last line after the time is not used. A line with the
        names of the columns may come first; lines that begin with # are comments.

    Returns
    -------
    impact_times : ndarray, shape (n,)
        Increasing [s].
    peak_rotations : ndarray, shape (n - 1,), or None
        With NaN where unknown [rad]; None if none is known.

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read, holds anything else or less than two
        times, or if the times do not increase.
    """
    path = Path(path)
    lines = [(number, line, _fields(path, number, line)) for number, line in numbered_lines(path)]
    if lines and _are_names(lines[0][2]):
        del lines[0]
    rows = [_time_and_peak(path, *line) for line in lines]
    if len(rows) < 2:
        must = "at least two lines, each with the time of an impact, were expected"
        raise ValueError(f"{str(path)!r}: {must}, got {len(rows)}")
    times, peaks = np.array(rows).T
    steps = np.diff(times)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0)) + 1
        got = f"a time after {times[at - 1]:.10g} s was expected, got {times[at]:.10g} s"
        raise ValueError(f"{str(path)!r}, line {lines[at][0]}: {got}")
    peaks = peaks[:-1]
    return times, None if np.isnan(peaks).all() else peaks


def _fields(path: Path, number: int, line: str) -> list[str]:
    fields = [field.strip().strip('"').strip() for field in line.split(",")]
    must = ""
    if ";" in line:
        must = "columns were expected to be separated by commas and decimals by points"
    elif len(fields) > 2:
        must = "a time and at most one peak rotation were expected"
    if must:
        raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
    return fields


def _are_names(fields: list[str]) -> bool:
    """Whether these are names of columns; what begins like a number is a mistyped one."""
    return not is_number(fields[0]) and fields[0][:1].isalpha()


def _time_and_peak(path: Path, number: int, line: str, fields: list[str]) -> tuple[float, float]:
    time, peak = fields[0], "nan" if fields[1:] in ([], [""]) else fields[1]
    must = "the time of an impact was expected, and perhaps after a comma the peak rotation"
    if is_number(time) and is_number(peak):
        pair = float(time), float(peak)
        must = "a peak rotation must be between -pi/2 and pi/2 rad and not 0, or empty if unknown"
        if not math.isfinite(pair[0]):
            must = "a time must be finite"
        elif math.isnan(pair[1]) or 0 < abs(pair[1]) < math.pi / 2:
            return pair
    raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
