"""Reader of files with measurements of free rocking."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..ground_motion import find_time_unit
from ..host import Row, TextTable, is_number, read_text_table

# Names of rotations, and their units in radians, in brackets or behind the name. A unit that
# is guessed wrong would only show as another block: a name that is not understood is refused.
_PEAK = r"(?:peaks?|max(?:imum)?|largest)"
_ROTATION = (
    rf"(?:{_PEAK}|(?:{_PEAK}\s*)?(?:rotations?|(?:(?:rotation|tilt)\s+)?angles?|alpha|theta"
    r"|\u03b1|\u03b8|tilts?)(?:\s+max)?(?:\s+after\s+(?:the\s+)?impacts?)?)"
)
_ANGLES = {
    r"rad(?:ians?)?": 1.0,
    r"m(?:illi)?rad": 1e-3,
    r"(?:deg(?:rees?)?|\u00b0)": math.pi / 180,
}
# Words that only names of rotations have, and such with which they are of something else; the
# same of times.
_OF_ROTATION = rf"peak|rotation|angle|tilt|theta|alpha|\u03b1|\u03b8|^{_PEAK}$"
_IN_ANGLES = rf"(?<![^\W_])(?:{'|'.join(_ANGLES)})[\])\s]*$"
# Rotations that are not the largest ones after an impact.
_NO_PEAK = (
    r"\b(?:min(?:imum)?|smallest|at|before|impact|initial|first|mean|average|rms|critical"
    r"|error|sigma|std|noise)\b|[^\W\d_]0\b"
)
_NO_ROTATION = r"veloc|speed|accel|time|/\s*s"
_NO_TIME = (
    r"duration|interval|period|half|delta|d\s?t\b|differen|step|error|sigma|std"
    r"|peak|rotation|angle|tilt"
)
# Without names times are in s. No block that stands on the earth takes so long between impacts.
_LONGEST = 60.0


class _Columns(NamedTuple):
    """The columns of times and rotations (None for none), and their units [s], [rad]."""

    time: int
    seconds: float
    peak: int | None
    radians: float


def read_impact_times(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the times of impacts, and perhaps the peaks between them, for `fit_free_rocking`.

    Parameters
    ----------
    path : str or path
        A text file, as .csv, with a line for each impact. A line with the names of the columns
        may come first, such as ``impact,time [ms],peak rotation [deg]``. The column of times,
        and the one of the largest rotations between an impact and the next, to either side, are
        found by their names and converted from their units; rotations must state theirs. Other
        columns, such as a counter, are ignored. A rotation is empty or NaN where unknown, and
        what stands in the last line is not used. Without names the time comes first [s], and
        perhaps the rotation after it [rad]. Fields are separated by commas, by tabs, or by what
        a first line ``sep=;`` says; lines that begin with # are comments, unless they name the
        columns.

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
        times, seems to be cut, if the names of the columns are not understood, if a column
        without a name may be a counter, or if the times do not increase.
    """
    table = read_text_table(Path(path))
    table, names = _take_names(table)
    columns = _Columns(0, 1.0, 1, 1.0) if names is None else _find_columns(table, names)
    most = 2 if names is None else len(names[2])
    for number, line, fields in table.rows:
        must = f"{most} fields were expected at most"
        if names is None:
            must = (
                "without names of columns a time and at most one peak rotation were expected"
            )
        table.refuse(len(fields) > most, f"{must}, got {line[:60]!r}", number)
    rows = [_parse_time_and_peak(table, row, columns) for row in table.rows]
    must = "at least two lines, each with the time of an impact, were expected"
    table.refuse(len(rows) < 2, f"{must}, got {len(rows)}")
    times, peaks = np.array(rows).T
    # Checked here as well as in the fit, since here the line of the file is known.
    steps = np.diff(times)
    at = int(np.argmax(steps <= 0)) + 1
    got = f"a time after {times[at - 1]:.10g} s was expected, got {times[at]:.10g} s"
    table.refuse(bool((steps <= 0).any()), got, table.rows[at][0])
    if names is None:
        _refuse_unclear(table, times)
    last = table.rows[-1]
    end = len(last[2]) - 1
    table.refuse_cut(last, end, [row[2][end] for row in table.rows[:-1] if len(row[2]) > end])
    peaks = peaks[:-1]  # after the last impact no other one ends the half-cycle
    return times, None if np.isnan(peaks).all() else peaks


def _take_names(table: TextTable) -> tuple[TextTable, Row | None]:
    """Take the names of the columns out of a table; None if it has none."""
    if not table.rows:
        return table, None
    fields = table.rows[0][2]
    # A word that begins like a number is a mistyped one.
    if not any(map(is_number, fields)) and any(field[:1].isalpha() for field in fields):
        return table._replace(rows=table.rows[1:]), table.rows[0]
    # NumPy writes names behind a #, and # is the name of a counter.
    above = []
    for number, line, words in table.comments:
        names = [words[0].lstrip("# ") or "#", *words[1:]]
        if len(names) == max(len(row[2]) for row in table.rows) and _find_times(names):
            above.append((number, line, names))
    must = "one comment with the names of the columns was expected"
    table.refuse(len(above) > 1, f"{must}, got another one", above[-1][0] if above else 0)
    return table, above[0] if above else None


def _find_times(names: Sequence[str]) -> dict[int, float]:
    """Find the columns of times by their names, and their units [s]."""
    # "time of the impact [ms]" is a time in milliseconds as much as "time [ms]" is.
    plain = [
        re.sub(r"\b(?:of|the)\b|impacts?(?![a-z])", " ", name.replace("_", " "), flags=re.I)
        for name in names
    ]
    found = {k: find_time_unit(" ".join(name.split())) for k, name in enumerate(plain)}
    if all(seconds is None for seconds in found.values()):
        # Named in another language, with a unit in brackets.
        found = {
            k: find_time_unit(f"t [{_find_in_brackets(name)}]")
            for k, name in enumerate(plain)
            if _find_in_brackets(name) and not re.search(_NO_TIME, name, re.I)
        }
        found = {k: s for k, s in found.items() if s is not None and not math.isnan(s)}
    return {k: seconds for k, seconds in found.items() if seconds is not None}


def _find_columns(table: TextTable, head: Row) -> _Columns:
    """Find the columns of times and rotations by their names."""
    number, line, names = head
    got = f"got {line[:60]!r}"
    table.refuse("" in names, f"every column must have a name, or none, {got}", number)
    times = _find_times(names)
    must = "one column must be times, such as 'time [s]' or 'time [ms]'"
    understood = len(times) == 1 and not math.isnan(*times.values())
    table.refuse(not understood, f"{must}, {got}", number)
    ((time, seconds),) = times.items()
    peaks = {}
    unclear = []
    others = []
    for k, name in enumerate(names):
        plain = name.replace("_", " ").strip()
        radians = None if k == time else _read_angle_unit(plain)
        if radians is not None:
            peaks[k] = radians
        elif k != time and _is_rotation(plain):
            (others if _matches(_NO_PEAK, plain) else unclear).append(name)
    # A column of other rotations is ignored only beside one that is clear.
    must = "rotations must be peaks with their unit, 'peak rotation [deg]' or [rad]"
    table.refuse(bool(unclear or (others and not peaks)), f"{must}, {got}", number)
    must = "at most one column must be rotations"
    table.refuse(len(peaks) > 1, f"{must}, got {len(peaks)} in {line[:60]!r}", number)
    return _Columns(time, seconds, *next(iter(peaks.items()), (None, 1.0)))


def _find_in_brackets(name: str) -> str:
    """Find the unit in the brackets at the end of a name; empty if there is none."""
    match = re.fullmatch(r"[^\[\](){}]*\w\s*[\[(]\s*([^\[\](){}]+?)\s*[\])]\s*", name)
    return match[1] if match else ""


def _read_angle_unit(name: str) -> float | None:
    """Tell the unit of a column of peak rotations; None if it is none, or states no unit."""
    # Small degrees would pass for radians: without a unit the name is not enough.
    for unit, radians in _ANGLES.items():
        if re.fullmatch(rf"{_ROTATION}\s*(?:[\[(]\s*{unit}\s*[\])]|\s{unit})", name, re.I):
            return radians
    return None


def _is_rotation(name: str) -> bool:
    """Tell whether a name may be one of rotations, whatever their unit."""
    words = _matches(_OF_ROTATION, name) and not _matches(_NO_ROTATION, name)
    return words or _matches(_IN_ANGLES, name)


def _matches(pattern: str, name: str) -> bool:
    """Tell whether a pattern is found in a name."""
    return re.search(pattern, name, re.I) is not None


def _parse_time_and_peak(table: TextTable, row: Row, columns: _Columns) -> tuple[float, float]:
    """Parse a time and a peak rotation, and convert them to [s] and [rad]; NaN for no peak."""
    number, line, fields = row
    time = fields[columns.time] if columns.time < len(fields) else ""
    known = columns.peak is not None and columns.peak < len(fields) and fields[columns.peak]
    peak = known or "nan"
    got = f"got {line[:60]!r}"
    must = "the time of an impact was expected, and perhaps the peak rotation after it"
    table.refuse(not is_number(time) or not is_number(peak), f"{must}, {got}", number)
    # In radians: degrees without their unit are mostly beyond a right angle, and refused.
    pair = columns.seconds * float(time), columns.radians * float(peak)
    table.refuse(not math.isfinite(pair[0]), f"a time must be finite, {got}", number)
    must = "a peak rotation must be between -pi/2 and pi/2 rad and not 0, or empty if unknown"
    right = math.isnan(pair[1]) or 0 < abs(pair[1]) < math.pi / 2
    table.refuse(not right, f"{must}, {got}", number)
    return pair


def _refuse_unclear(table: TextTable, times: np.ndarray) -> None:
    """Raise a `ValueError` if columns without names may be something else than they should."""
    must = "names of the columns were expected, such as 'impact,time [s]' or 'time [ms]'"
    line = table.rows[0][0]
    counts = times[0] in (0, 1) and (np.diff(times) == 1).all()
    seconds = [float(row[2][1]) for row in table.rows if len(row[2]) > 1 and row[2][1]]
    increase = len(seconds) >= max(2, len(times) - 1) and (np.diff(seconds) > 0).all()
    unclear = "since the first column may be a counter and the second one times"
    table.refuse(bool(counts and increase), f"{must}, {unclear}", line)
    long = float(np.median(np.diff(times)))
    unclear = f"since times without names are in s, and these are {long:g} s apart"
    table.refuse(long > _LONGEST, f"{must}, {unclear}", line)
