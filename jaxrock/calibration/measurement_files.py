"""Reader of files with measurements of free rocking."""

import math
import os
import re
from pathlib import Path

import numpy as np

from ..ground_motion import find_time_unit
from ..host import is_number, read_numbered_lines

# Names of rotations, and their units in radians, in brackets or behind the name. A unit that
# is guessed wrong would only show as another block: a name that is not understood is refused.
_ROTATION = (
    r"(?:(?:peak|max(?:imum)?|largest)\s*)?(?:rotations?|angles?|alpha|theta|tilts?|peaks?)"
)
_ANGLES = {
    r"rad(?:ians?)?": 1.0,
    r"m(?:illi)?rad": 1e-3,
    r"deg(?:rees?)?|\u00b0": math.pi / 180,
}


def read_impact_times(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the times of impacts, and perhaps the peaks between them, for `fit_free_rocking`.

    Parameters
    ----------
    path : str or path
        A text file, as .csv, with a line for each impact: its time [s], and perhaps after a
        comma the largest rotation between it and the next [rad], to either side, empty or NaN
        where unknown. What stands in the last line after the time is not used. A line with the
        names of the columns may come first, such as ``time [ms],peak rotation [deg]``; other
        units of theirs are converted. Lines that begin with # are comments.

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
        times, if the names of the columns are not understood, or if the times do not increase.
    """
    path = Path(path)
    lines = [
        (number, line, _split_fields(path, number, line))
        for number, line in read_numbered_lines(path)
    ]
    # Without names of columns seconds and radians, as `fit_free_rocking` takes them.
    units = 1.0, 1.0
    if lines and _are_names(lines[0][2]):
        units = _read_units(path, *lines.pop(0))
    rows = [_parse_time_and_peak(path, *line, units) for line in lines]
    if len(rows) < 2:
        must = "at least two lines, each with the time of an impact, were expected"
        raise ValueError(f"{str(path)!r}: {must}, got {len(rows)}")
    times, peaks = np.array(rows).T
    # Checked here as well as in the fit, since here the line of the file is known.
    steps = np.diff(times)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0)) + 1
        got = f"a time after {times[at - 1]:.10g} s was expected, got {times[at]:.10g} s"
        raise ValueError(f"{str(path)!r}, line {lines[at][0]}: {got}")
    peaks = peaks[:-1]  # after the last impact no other one ends the half-cycle
    return times, None if np.isnan(peaks).all() else peaks


def _split_fields(path: Path, number: int, line: str) -> list[str]:
    """Split a line at its commas, and strip spaces and quotes."""
    fields = [field.strip().strip('"').strip() for field in line.split(",")]
    must = ""
    # A semicolon comes with decimal commas, at which the numbers would be cut in two.
    if ";" in line:
        must = "columns were expected to be separated by commas and decimals by points"
    elif len(fields) > 2:
        must = "a time and at most one peak rotation were expected"
    if must:
        raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
    return fields


def _are_names(fields: list[str]) -> bool:
    """Tell whether words name columns; a word that begins like a number is a mistyped one."""
    return not is_number(fields[0]) and fields[0][:1].isalpha()


def _read_units(path: Path, number: int, line: str, names: list[str]) -> tuple[float, float]:
    """Tell the units of the columns [s], [rad], from their names."""
    time, peak = (name.replace("_", " ") for name in (*names, "")[:2])
    # "time of the impact [ms]" is a time in milliseconds as much as "time [ms]" is.
    time = re.sub(r"\b(?:of|the)\b|impacts?(?![a-z])", " ", time, flags=re.I)
    seconds = find_time_unit(" ".join(time.split()))
    if seconds is None and (unit := _find_in_brackets(time)):
        seconds = find_time_unit(f"t [{unit}]")  # named in another language
    radians = _read_angle_unit(peak.strip()) if peak else 1.0
    must = ""
    if seconds is None or math.isnan(seconds):
        must = "the first column must be times, such as 'time [s]' or 'time [ms]'"
    elif radians is None:
        must = "the second column must be rotations, such as 'peak rotation [rad]' or 'peak [deg]'"
    if must or seconds is None or radians is None:
        raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
    return seconds, radians


def _find_in_brackets(name: str) -> str:
    """Find the unit in brackets at the end of a name; empty if there is none."""
    match = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", name)
    return match[1] if match else ""


def _read_angle_unit(name: str) -> float | None:
    """Tell the unit of a column of rotations; None if it is none, or in an unknown one."""
    inside = _find_in_brackets(name)
    for unit, radians in _ANGLES.items():
        # Within brackets the unit stands alone; behind the name it needs a name in front,
        # since a column called "deg" may be anything.
        pattern, text = (
            (unit, inside) if inside else (rf"{_ROTATION}(?:\s+max)?\s+(?:{unit})", name)
        )
        if re.fullmatch(pattern, text, re.I):
            return radians
    return 1.0 if re.fullmatch(rf"{_ROTATION}(?:\s+max)?", name, re.I) else None


def _parse_time_and_peak(
    path: Path, number: int, line: str, fields: list[str], units: tuple[float, float]
) -> tuple[float, float]:
    """Parse a time and a peak rotation, and convert them to [s] and [rad]; NaN for no peak."""
    time = fields[0]
    peak = "nan" if fields[1:] in ([], [""]) else fields[1]
    must = "the time of an impact was expected, and perhaps after a comma the peak rotation"
    if is_number(time) and is_number(peak):
        # In radians: degrees without their unit are mostly beyond a right angle, and refused.
        pair = units[0] * float(time), units[1] * float(peak)
        must = (
            "a peak rotation must be between -pi/2 and pi/2 rad and not 0, or empty if unknown"
        )
        if not math.isfinite(pair[0]):
            must = "a time must be finite"
        elif math.isnan(pair[1]) or 0 < abs(pair[1]) < math.pi / 2:
            return pair
    raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
