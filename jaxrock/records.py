"""Reading recorded ground motions: PEER's .AT2 files, .csv files and obspy traces.

Nothing is guessed, corrected or resampled: the unit is stated by the file or by the caller,
signs are kept, and what is not as it should be is a `ValueError` of one sentence.
"""

import csv
import math
import os
import re
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .arguments import POSITIVE, as_real, check
from .motion import Record

StrPath = str | os.PathLike[str]

# Standard gravity, the unit g of records: not the gravity that acts on the block.
_UNITS = {"m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 0.001, "gal": 0.01, "g": 9.80665}

# Steps may differ by this fraction, since times are often printed with few digits.
_UNIFORM = 1e-3

_HEADER_LINES = 20  # of an .AT2 file, four as a rule
_POINTS_AND_STEP = (
    re.compile(r"\bNPTS\s*=\s*(?P<points>[^\s,]+)[\s,]+DT\s*=\s*(?P<step>[^\s,]+?)(?:SEC|[\s,]|$)"),
    re.compile(r"^\s*(?P<points>[^\s,]+)[\s,]+(?P<step>[^\s,]+)[\s,]+NPTS[\s,]+DT\b"),
)
_STATED_UNIT = re.compile(
    r"\bUNITS?(?:\s+(?:OF|IN|ARE)\b|\s*[:=(\[])[\s:=(\[]*([^\s,;)\]]+)", re.IGNORECASE
)
_QUANTITY = re.compile(r"\b(ACCELERATION|VELOCITY|DISPLACEMENT)(\s+TIME\b)?", re.IGNORECASE)

# Fortran writes 1e-100 as 1.0-100, and leaves no space before a minus sign that fills its field.
_EXPONENT = re.compile(r"(?<=[\d.])(?:[dD]|(?=[-+]\d{3}(?![\d.])))")
_GLUED = re.compile(r"(?<=[\d.])(?=[-+])")

_SECONDS = r"s(?:ec|ecs|econds?)?"
_TIME = re.compile(
    rf"t(?:ime)?(?:[\s_]*[\[(]\s*{_SECONDS}\s*[\])]|[\s_]+{_SECONDS}|\s*/\s*{_SECONDS})?",
    re.IGNORECASE,
)


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
    the number of values, the time step and as a rule the unit, which has to be g.

    A ``.csv`` file has columns separated by commas, below one line with their names; lines
    that begin with # may stand before it. The time step comes from a column of times in
    seconds (named ``time``, ``t``, ``time_s``, ``time [s]`` or the like), or from `time_step`.
    Only the columns that are asked for are read.

    Parameters
    ----------
    path : str or path
        The file, ``.AT2`` or ``.csv``.
    unit : str, optional
        Unit of the accelerations: ``"m/s2"``, ``"cm/s2"``, ``"mm/s2"``, ``"gal"`` or ``"g"``,
        also spelled ``"m/s^2"``, ``"m/s²"`` and so on. It must be given unless the header of
        an ``.AT2`` file states it. g is standard gravity, 9.80665 m/s2.
    column : str, optional
        Name of the column of horizontal acceleration, in a .csv file. It must be given where
        there is more than one that it could be.
    vertical : str or path, optional
        The vertical acceleration, positive upward: the name of its column in a .csv file, or
        a second .AT2 file.
    time_step : float, optional
        Time from one sample to the next [s]. It must be given for a .csv file without a
        column of times; if the file says it too, they must agree.

    Returns
    -------
    Record
        Accelerations of shape (samples,) in m/s2 and the time step in s, from time 0 on.

    Raises
    ------
    ValueError
        If the file cannot be read, is neither of the two formats or contradicts itself, if
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
    factor = _factor("g" if unit is None else unit)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        horizontal, upward, step = _read_csv(_read(path), unit, column, vertical, time_step)
    elif suffix == ".at2":
        if column is not None:
            raise ValueError(f"column is for .csv files, {str(path)!r} has only one")
        horizontal, step = _read_at2(_read(path), unit, time_step)
        upward = None
        if vertical is not None:
            upward = _read_other_at2(Path(vertical), unit, path, horizontal.size, step)
    else:
        raise ValueError(f"{str(path)!r}: .AT2 and .csv files are read, not {path.suffix!r}")
    return _record(repr(str(path)), factor, horizontal, step, upward)


def from_obspy(trace: Any, *, unit: str, vertical: Any = None) -> Record:
    """Take a ground motion from a trace of obspy, or of gmprocess.

    Neither has to be installed: a trace is anything with ``data``, ``stats.delta`` and
    perhaps ``stats.starttime``. It must be acceleration already; counts of an instrument
    are for obspy's ``remove_response``.

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
        If a trace has gaps or anything but finite real numbers, is shorter than two samples,
        or has no valid time step; if the traces do not match; if the unit is not known.
    """
    factor = _factor(unit)
    horizontal, step = _trace("trace", trace)
    if vertical is None:
        return _record("trace", factor, horizontal, step)
    upward, other_step = _trace("vertical", vertical)
    _same_sampling("vertical", "trace", (upward.size, other_step), (horizontal.size, step))
    starts = [getattr(each.stats, "starttime", None) for each in (trace, vertical)]
    if None not in starts and starts[0] != starts[1]:
        raise ValueError(f"vertical starts at {starts[1]}, but trace at {starts[0]}")
    return _record("trace", factor, horizontal, step, upward)


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
    >>> from jaxrock.records import example_record
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


class _Text(NamedTuple):
    """The lines of a file, which are counted from 1 on."""

    path: Path
    lines: list[str]

    def fault(self, reason: str, line: int | None = None) -> ValueError:
        where = repr(str(self.path)) + ("" if line is None else f", line {line}")
        return ValueError(f"{where}: {reason}")

    def number(self, word: str, line: int, name: str = "a value") -> float:
        try:
            value = float(word.replace("_", "?"))  # Python's 1_000 is no number elsewhere
        except ValueError:
            got = _short(word) if word.strip() else "an empty field"
            raise self.fault(f"{name} must be a number, got {got}", line) from None
        if not math.isfinite(value):
            raise self.fault(f"{name} must be finite, got {_short(word)}", line)
        return value


def _read(path: Path) -> _Text:
    text = _Text(path, [])
    try:
        content = path.read_bytes()
    except OSError as error:
        raise text.fault(f"the file cannot be read: {error.strerror or error}") from error
    content = content.rstrip(b"\x1a\r\n\t ")  # old files end as under DOS, with a Ctrl-Z
    if not content:
        raise text.fault("the file is empty")
    if re.search(rb"[\x00-\x08\x0e-\x1f]", content):
        raise text.fault("a text file was expected, this one is binary")
    try:
        decoded = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        decoded = content.decode("latin-1")  # names of stations; numbers are the same in both
    return text._replace(lines=re.split("\r\n|\r|\n", decoded))


def _read_at2(
    text: _Text, unit: str | None, time_step: float | None = None
) -> tuple[np.ndarray, float]:
    last, points, step = _points_and_step(text)
    _check_unit(text, last, unit)
    values = []
    for number, line in enumerate(text.lines[last:], last + 1):
        for word in _GLUED.sub(" ", _EXPONENT.sub("E", line)).split():
            values.append(text.number(word, number))
    if len(values) != points:
        raise text.fault(f"NPTS is {points}, but {len(values)} values follow", last)
    return np.array(values), _agreed(text, time_step, step)


def _points_and_step(text: _Text) -> tuple[int, int, float]:
    """The last line of the header, and what it says."""
    for number, line in enumerate(text.lines[:_HEADER_LINES], 1):
        for pattern in _POINTS_AND_STEP:
            if match := pattern.search(line.upper()):
                points = text.number(match["points"], number, "NPTS")
                if points < 2 or points % 1:
                    raise text.fault(
                        f"NPTS must be a whole number from 2 on, got {match['points']}", number
                    )
                step = text.number(match["step"], number, "DT")
                if step <= 0:
                    raise text.fault(f"DT must be greater than 0, got {match['step']}", number)
                return number, int(points), step
    raise text.fault(
        "an .AT2 file was expected, with 'NPTS= ..., DT= ...' or '... NPTS, DT' within its first"
        f" {_HEADER_LINES} lines"
    )


def _check_unit(text: _Text, last: int, unit: str | None) -> None:
    """Whether the header, down to line `last`, is about acceleration in the right unit."""
    stated = None
    mentioned = {}
    for number, line in enumerate(text.lines[:last], 1):
        if stated is None and (match := _STATED_UNIT.search(line)):
            stated = match[1].rstrip(".")
            if _spelled(stated) != "g":
                raise text.fault(f"acceleration in units of g was expected, not {stated}", number)
        for quantity, time_series in _QUANTITY.findall(line):
            mentioned.setdefault(quantity.lower(), number)
            if time_series and quantity.lower() != "acceleration":
                raise text.fault(f"acceleration was expected, not {quantity.lower()}", number)
    if mentioned and "acceleration" not in mentioned:
        quantity, number = mentioned.popitem()
        raise text.fault(f"acceleration was expected, not {quantity}", number)
    if stated is None and unit is None:
        raise text.fault(f"the header states no unit, so that unit must be given: {_ALLOWED}")
    if stated is not None and unit is not None and _spelled(unit) != "g":
        raise text.fault(f"unit is {unit!r}, but the header states {stated}")


def _read_other_at2(
    path: Path, unit: str | None, first: Path, points: int, step: float
) -> np.ndarray:
    if path.suffix.lower() != ".at2":
        raise ValueError(f"vertical must be an .AT2 file, as {str(first)!r} is, got {str(path)!r}")
    values, other_step = _read_at2(_read(path), unit)
    names = repr(str(path)), repr(str(first))
    _same_sampling(*names, (values.size, other_step), (points, step))
    return values


def _read_csv(
    text: _Text,
    unit: str | None,
    column: str | None,
    vertical: StrPath | None,
    time_step: float | None,
) -> tuple[np.ndarray, np.ndarray | None, float]:
    if unit is None:
        raise text.fault(f"unit must be given for a .csv file: {_ALLOWED}")
    top, names = _names(text)
    times = [name for name in names if _TIME.fullmatch(name)]
    if len(times) > 1:
        raise text.fault(f"one column of times was expected, got {_listed(times)}", top)
    if vertical is not None:
        vertical = str(vertical)
    others = [name for name in names if name not in (*times, vertical)]
    if column is None:
        if len(others) != 1:
            raise text.fault(
                "column must be given, the name of the horizontal acceleration:"
                f" {_listed(others) or 'no column is left for it'}",
                top,
            )
        column = others[0]
    if column == vertical:
        raise text.fault(f"column and vertical are the same, {column!r}", top)
    for argument, name in (("column", column), ("vertical", vertical)):
        if name is None:
            continue
        if name in times:
            raise text.fault(f"{argument} is {name!r}, which is taken for the times", top)
        if names.count(name) != 1:
            raise text.fault(
                f"{argument} is {name!r}, but there are {names.count(name)} such columns among"
                f" {_listed(names)}",
                top,
            )
    wanted = [name for name in (column, vertical, *times) if name is not None]
    values = _columns(text, top, names, wanted)
    if times:
        step = _uniform_step(text, top, times[0], values[-1])
    elif time_step is None:
        raise text.fault(
            f"time_step must be given, since no column of times is among {_listed(names)}", top
        )
    else:
        step = time_step
    upward = None if vertical is None else values[1]
    return values[0], upward, _agreed(text, time_step, step)


def _names(text: _Text) -> tuple[int, list[str]]:
    """The line with the names of the columns."""
    for number, line in enumerate(text.lines, 1):
        if line.strip() and not line.lstrip().startswith("#"):
            names = [name.strip() for name in _fields(line)]
            if all(map(_is_number, names)):
                raise text.fault(f"names of the columns were expected, got {_short(line)}", number)
            return number, names
    raise text.fault("a line with the names of the columns was expected, all are comments")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _columns(text: _Text, top: int, names: list[str], wanted: list[str]) -> np.ndarray:
    """The `wanted` columns below line `top`, shape (wanted, samples)."""
    indices = [names.index(name) for name in wanted]
    rows = []
    for number, line in enumerate(text.lines[top:], top + 1):
        fields = _fields(line)
        if len(fields) != len(names):
            raise text.fault(
                f"{len(names)} fields separated by commas were expected, got {len(fields)}", number
            )
        rows.append([text.number(fields[i], number, f"column {names[i]!r}") for i in indices])
    if len(rows) < 2:
        raise text.fault(f"at least two samples were expected, got {len(rows)}")
    return np.array(rows).T


def _fields(line: str) -> list[str]:
    return next(csv.reader([line], skipinitialspace=True), []) if '"' in line else line.split(",")


def _uniform_step(text: _Text, top: int, name: str, times: np.ndarray) -> float:
    steps = np.diff(times)
    usual = float(np.median(steps))
    for faulty, reason in (
        (steps <= 0, "must increase"),
        (abs(steps - usual) > _UNIFORM * usual, f"must have a uniform step, mostly {usual:.6g} s"),
    ):
        if faulty.any():
            at = int(np.argmax(faulty))
            raise text.fault(
                f"column {name!r} {reason}, got {times[at]} and then {times[at + 1]}",
                top + at + 2,
            )
    return float(times[-1] - times[0]) / steps.size


def _agreed(text: _Text, given: float | None, step: float) -> float:
    if given is None:
        return step
    if abs(given - step) > _UNIFORM * step:
        raise text.fault(f"time_step is {given} s, but the file has {step:.6g} s")
    return given


def _trace(argument: str, trace: Any) -> tuple[np.ndarray, float]:
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
    step = float(trace.stats.delta)
    check(f"stats.delta of {argument}", step, POSITIVE)
    return data.astype(float), step


def _same_sampling(
    name: str, first: str, sampling: tuple[int, float], expected: tuple[int, float]
) -> None:
    if sampling[0] != expected[0]:
        raise ValueError(f"{name} has {sampling[0]} samples, but {first} has {expected[0]}")
    if not math.isclose(sampling[1], expected[1], rel_tol=1e-6):
        raise ValueError(f"{name} has a step of {sampling[1]} s, but {first} of {expected[1]} s")


def _record(
    name: str,
    factor: float,
    horizontal: np.ndarray,
    step: float,
    upward: np.ndarray | None = None,
) -> Record:
    try:
        with np.errstate(over="ignore"):
            return Record(factor * horizontal, step, None if upward is None else factor * upward)
    except ValueError as error:  # too few samples, or too large for the precision
        raise ValueError(f"{name}: {error}") from error


def _spelled(unit: str) -> str:
    """The plain spelling of a unit."""
    unit = re.sub(r"\s", "", str(unit)).lower().replace("sec", "s").replace("²", "2")
    return re.sub(r"\*\*|\^", "", unit).replace("/s/s", "/s2")


def _factor(unit: str) -> float:
    """What a unit is in m/s2."""
    if _spelled(unit) not in _UNITS:
        raise ValueError(f"unit must be {_ALLOWED}, got {unit!r}")
    return _UNITS[_spelled(unit)]


def _listed(names: list[str]) -> str:
    return ", ".join([_short(name) for name in names[:12]]) + (", ..." if names[12:] else "")


def _short(word: str) -> str:
    """In quotes, cut if it is no word but half a file."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")


_ALLOWED = f"one of {_listed(list(_UNITS))}"
