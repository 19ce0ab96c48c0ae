"""Reader of files with measurements of free rocking."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..oldtables import (
    QUANTITIES,
    Head,
    Row,
    Table,
    find_quantity,
    parse_unit,
    quote_word,
    read_head,
    read_table,
)

# Rotations that are not the largest ones after an impact.
_NO_PEAK = (
    r"\b(?:min(?:imum)?|smallest|at|before|impact|initial|first|mean|average|rms|critical"
    r"|error|sigma|std|noise)\b|[^\W\d_]0\b"
)
# Names of something else, though a word or the unit is one of a rotation, or of a time.
_NO_ROTATION = r"veloc|speed|accel|time|/\s*s"
_NO_TIME = (
    r"duration|between|uplift|interval|period|half|delta|d\s?t\b|differen|step|error|sigma|std"
    r"|peak|rotation|angle|tilt"
)
# Without names times are in s. No block that stands on the earth takes so long between impacts.
_LONGEST = 60.0
# Of fewer times nothing can be told.
_FEW = 8
_EXPECTED = "names of the columns were expected, such as 'impact,time [s]' or 'time [ms]'"


# Columns without names.
_UNNAMED = (read_head("time [s]"), read_head("rotation [rad]"))


def read_impact_times(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the times of impacts, and perhaps the peaks between them, for `fit_free_rocking`.

    Parameters
    ----------
    path : str or path
        A text file, as .csv, with a line for each impact. A line with the names of the
        columns may come first, such as ``impact,time [ms],peak rotation [deg]``. The column
        of times, and the column of the largest rotations between an impact and the next, to
        either side, are recognized by their names and converted from their units; rotations
        must state their unit. Other columns, such as a counter, are ignored. A rotation is
        empty or NaN where unknown; the rotation in the last line is not used. Without names
        the first column is the time [s], and an optional second one the rotation [rad].
        Fields are separated by commas, semicolons, tabs or blanks. The decimal separator is a
        point, or a comma in all numbers. Lines that begin with # are comments, unless they
        name the columns; titles may stand above the names, and units below them.

    Returns
    -------
    impact_times : ndarray, shape (n,)
        Increasing [s].
    peak_rotations : ndarray, shape (n - 1,), or None
        With NaN where unknown [rad]; None if none is known.

    Raises
    ------
    ValueError
        With file and line: if the file cannot be read, has other contents, has fewer than two
        times of impacts or seems to be cut; if the names of the columns are not understood; if
        a column without a name may be a counter; or if the times do not increase.
    """
    table = read_table(Path(path))
    heads, line = _find_heads(table)
    time, peak = _find_columns(table, heads or _UNNAMED, line)
    rows = [row for row in table.rows if any(row.cells)]
    if len(rows) < 2:
        reason = "at least two lines, each with the time of an impact, were expected"
        raise table.text.error(f"{reason}, got {len(rows)}")
    pairs = [_read_impact(table, row, heads, time, peak) for row in rows]
    times, peaks = np.array(pairs).T
    # Checked here as well as in the fit, since here the line of the file is known.
    for k, step in enumerate(np.diff(times), 1):
        if step <= 0:
            reason = f"a time after {times[k - 1]:.10g} s was expected, got {times[k]:.10g} s"
            raise table.text.error(reason, rows[k].line)
    if times.size > _FEW and np.ptp(np.diff(times)) < 1e-3 * (times[1] - times[0]):
        reason = (
            "times of impacts were expected, whose distances shrink, got evenly spaced times"
        )
        raise table.text.error(f"{reason}, {times[1] - times[0]:.6g} s apart", rows[0].line)
    if not heads:
        _refuse_unclear(table, rows, times)
    table.refuse_cut()
    # After the last impact no other one ends the half-cycle.
    peaks = peaks[:-1]
    return times, None if np.isnan(peaks).all() else peaks


def _list_comments(table: Table) -> list[tuple[int, str]]:
    """List the comments of a table, with the numbers of their lines."""
    numbered = enumerate(table.text.lines, 1)
    return [(n, line) for n, line in numbered if line.lstrip().startswith("#")]


def _find_heads(table: Table) -> tuple[Sequence[Head], int]:
    """Find the heads of the columns, above them or in a comment, and their line."""
    comments = _list_comments(table)
    # A table of one column without a name has one of its own.
    if table.names not in ([], ["column 1"]) and table.line not in dict(comments):
        return table.heads, table.line
    candidates = []
    width = max((len(row.cells) for row in table.rows), default=0)
    for line, words in comments:
        # NumPy writes names behind a #.
        above = tuple(map(read_head, words.lstrip("# ").split(table.separator)))
        is_known = line == table.line and any(head.quantity for head in above)
        if len(above) == width and (is_known or _find_times(above)):
            candidates.append((above, line))
    if len(candidates) > 1:
        reason = "one comment with the names of the columns was expected, got another one"
        raise table.text.error(reason, candidates[-1][1])
    return candidates[0] if candidates else ((), 0)


def _find_times(heads: Sequence[Head]) -> list[int]:
    """Find the columns of times: by their names, or else by their units."""
    times = [k for k, head in enumerate(heads) if head.quantity == "time"]
    named = [k for k in times if find_quantity(heads[k].name) == "time"]
    # In another language a name says nothing.
    return named or [k for k in times if not re.search(_NO_TIME, heads[k].name, re.I)]


def _find_columns(table: Table, heads: Sequence[Head], line: int) -> tuple[int, int | None]:
    """Find the columns of times and of peaks, None for none, by their heads."""
    printed = quote_word(table.text.lines[line - 1])
    times = _find_times(heads)
    if len(times) != 1 or math.isnan(heads[times[0]].factor):
        reason = "one column must be times, such as 'time [s]' or 'time [ms]'"
        raise table.text.error(f"{reason}, got {printed}", line)
    rotations = [k for k, head in enumerate(heads) if _is_rotation(head)]
    peaks = [
        k
        for k in rotations
        if heads[k].unit
        and find_quantity(heads[k].name) == "peak rotation"
        and not math.isnan(heads[k].factor)
    ]
    # A column of other rotations is ignored only beside one that is clear.
    unclear = [
        k
        for k in rotations
        if k not in peaks and not (peaks and re.search(_NO_PEAK, heads[k].name, re.I))
    ]
    if unclear:
        reason = "rotations must be peaks with their unit, 'peak rotation [deg]' or [rad]"
        raise table.text.error(f"{reason}, got {printed}", line)
    if len(peaks) > 1:
        reason = "at most one column must be rotations"
        raise table.text.error(f"{reason}, got {len(peaks)} in {printed}", line)
    for k in (*times, *peaks) if line else ():
        _refuse_other_unit(table, heads[k])
    return times[0], peaks[0] if peaks else None


def _refuse_other_unit(table: Table, head: Head) -> None:
    """Raise a `ValueError` if a comment states another unit of such a quantity than its head."""
    dimension = QUANTITIES[head.quantity].dimensions[0] if head.quantity else ""
    for line, words in _list_comments(table):
        for word in re.findall(r"\bin\s+([^\W\d_]+|\u00b0)", words):
            unit = parse_unit(word)
            if unit.dimension == dimension and not math.isclose(unit.factor, head.factor):
                raise table.text.error(
                    f"a comment states the unit {word!r}, but the column is {head.words!r}",
                    line,
                )


def _is_rotation(head: Head) -> bool:
    """Return whether a column may be one of rotations, whatever its unit."""
    if head.unit and head.unit.dimension == "angle":
        return True
    is_named = "rotation" in head.quantity or re.match(r"peak", head.name, re.I)
    return bool(is_named) and not re.search(_NO_ROTATION, head.words, re.I)


def _read_impact(
    table: Table, row: Row, heads: Sequence[Head], time: int, peak: int | None
) -> tuple[float, float]:
    """Read a time [s] and a peak rotation [rad], NaN for none."""
    printed = quote_word(table.text.lines[row.line - 1])
    if not heads and len(row.cells) > 2:
        reason = "without names of columns a time and at most one peak rotation were expected"
        raise table.text.error(f"{reason}, got {printed}", row.line)
    heads = heads or _UNNAMED
    seconds = table.parse_number(row, time)
    has_peak = peak is not None and any(row.cells[peak : peak + 1])
    rotation = table.parse_number(row, peak or 0) if has_peak else math.nan
    if seconds is None or rotation is None:
        reason = "the time of an impact was expected, and perhaps the peak rotation after it"
        raise table.text.error(f"{reason}, got {printed}", row.line)
    if not math.isfinite(seconds):
        raise table.text.error(f"a time must be finite, got {printed}", row.line)
    # In radians: degrees without their unit are mostly beyond a right angle, and refused.
    rotation *= heads[peak or 0].factor
    if not math.isnan(rotation) and not 0 < abs(rotation) < math.pi / 2:
        reason = "a peak rotation must be between -pi/2 and pi/2 rad and not 0, or empty if"
        raise table.text.error(f"{reason} unknown, got {printed}", row.line)
    return heads[time].factor * seconds, rotation


def _refuse_unclear(table: Table, rows: Sequence[Row], times: np.ndarray) -> None:
    """Raise a `ValueError` if columns without names may be something else than they should."""
    titles = [note for note in table.notes if not note[1].lstrip().startswith("#")]
    if titles:
        line, words = titles[-1]
        raise table.text.error(f"{_EXPECTED}, got {quote_word(words)}", line)
    for line, words in _list_comments(table):
        for word in re.findall(r"[^\W\d_]+|\u00b0(?!\s?C)", words):
            unit = parse_unit(word)
            # NS is a direction, and us are people.
            if unit.dimension in ("time", "angle") and 1e-3 <= unit.factor < 1:
                reason = f"since {word!r} may be the unit of one that has no name"
                raise table.text.error(f"{_EXPECTED}, {reason}", line)
    second = [table.parse_number(row, 1) for row in rows]
    seconds = [number for number in second if number is not None]
    counts = times[0] in (0, 1) and (np.diff(times) == 1).all()
    increase = len(seconds) >= max(2, len(times) - 1) and (np.diff(seconds) > 0).all()
    if counts and increase:
        reason = "since the first column may be a counter and the second one times"
        raise table.text.error(f"{_EXPECTED}, {reason}", rows[0].line)
    long = float(np.median(np.diff(times)))
    if long > _LONGEST:
        reason = f"since times without names are in s, and these are {long:g} s apart"
        raise table.text.error(f"{_EXPECTED}, {reason}", rows[0].line)
