"""Recorded ground motions from PEER's .AT2 files, .csv files and obspy's traces.

Nothing is guessed, corrected or resampled: the unit and the time step are stated by the file
or by the caller, and may not contradict each other; signs are preserved. Any fault is a
`ValueError` of one sentence.
"""

import os
from pathlib import Path

from ...validation import POSITIVE, as_real, check
from ..record import Record
from .components import Component, make_record, require_unit, require_upward
from .formats import read_components
from .tables import read_csv
from .text import Statements, quote_names

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
        units = [(0, f"unit is {unit!r}", require_unit(unit))]
    if path.suffix.lower() == ".csv":
        upward = None if vertical is None else str(vertical)
        return make_record(*read_csv(path, units, steps, column, upward))
    if path.is_dir():
        raise ValueError(
            f"{str(path)!r} is a folder: one file is read, read_suite takes folders"
        )
    components = read_components(path, units, steps)
    horizontal = _choose_horizontal(path, components, column)
    if vertical is None:
        return make_record(horizontal)
    upward = _find_channel(components, str(vertical))
    if upward is None:
        if not Path(vertical).suffix and not Path(vertical).exists():
            must = "vertical must be a component of the file, or another file"
            raise ValueError(f"{must}, got {str(vertical)!r} for {str(path)!r}")
        others = read_components(Path(vertical), units, [])
        upward = _choose_vertical(Path(vertical), others)
    return make_record(horizontal, require_upward(upward))


def _find_channel(components: list[Component], name: str) -> Component | None:
    """Find a component by the name of its channel, or the one that points "up"."""
    found = [each for each in components if name.lower() in (each.channel.lower(), "up")]
    found = [each for each in found if name.lower() != "up" or each.direction == "up"]
    return found[0] if len(found) == 1 and found[0].channel else None


def _choose_horizontal(
    path: Path, components: list[Component], column: str | None
) -> Component:
    """Choose the component of a name, or the only one; a `ValueError` if that is not clear."""
    channels = quote_names(each.channel for each in components)
    if column is None:
        level = [each for each in components if each.direction in ("level", "")]
        if len(level) == 1:
            return level[0]
        if not level:
            raise ValueError(
                f"{str(path)!r}: no component is horizontal, vertical is {channels}"
            )
        channels = quote_names(each.channel for each in level)
        raise ValueError(
            f"{str(path)!r}: column must be given, the horizontal component: {channels}"
        )
    if len(components) == 1 and not components[0].channel:
        raise ValueError(f"column is for .csv files, {str(path)!r} has only one")
    found = _find_channel(components, column)
    if found is None:
        raise ValueError(f"{str(path)!r}: column is {column!r}, but there are {channels}")
    if found.direction in ("up", "down"):
        raise ValueError(f"{str(path)!r}: column is {column!r}, which is vertical")
    return found


def _choose_vertical(path: Path, components: list[Component]) -> Component:
    """Choose the vertical component of another file; a `ValueError` if that is not clear."""
    rises = [each for each in components if each.direction in ("up", "down")]
    # A file of one component need not say where it points: the caller does.
    found = rises or [each for each in components if not each.direction]
    if len(found) == 1 and (rises or len(components) == 1):
        return found[0]
    raise ValueError(f"{str(path)!r}: one vertical component was expected, got {len(found)}")
