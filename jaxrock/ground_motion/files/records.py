"""Recorded ground motions from files, one at a time.

Nothing is guessed, corrected or resampled: the unit and the time step are stated by the file
or by the caller, and may not contradict each other; signs are preserved. Any fault is a
`ValueError` of one sentence.
"""

import os
from pathlib import Path

from ...oldtables import NamedFile, TextFile, quote_names
from ...validation import as_text, describe
from ..record import Record
from .claims import Claims, make_claims
from .components import Component, make_record, require_upward
from .formats import TABLE_SUFFIXES, read_components
from .sample_tables import SampleTable

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

    An ``.AT2`` file of the PEER databases holds one component. A ``.csv`` or ``.tsv`` file
    has columns below a line with their names, separated by commas, semicolons, tabs, bars or
    blanks; titles and lines that begin with # may stand above the names, units below them. A
    column of times is named ``time``, ``t``, ``time_s``, ``time [ms]`` or the like. Steps
    must be equal within 0.1 %, or consistent with one step after rounding to the printed
    digits. A single column needs no name.

    Files of networks are recognized by their first lines, not by their names: ESM and ITACA,
    COSMOS, CSMIP and RENADIC, GeoNet (V1A, V2A), SMC, K-NET and KiK-net, SCEC's Broadband
    Platform, numbers alone; and where obspy is installed (``pip install "jaxrock[records]"``)
    miniSEED and SAC. The number of samples, the duration and the peak that such a file states
    must agree with its samples. Velocities and displacements in it are ignored.

    The unit and the time step are taken from the file where it states them: in its header, in
    titles and comments such as
    ``# time step 0.01 s``, in names of columns such as ``acc_g`` or ``acc
    [cm/s^2]``. These statements must agree with each other and with `unit` and `time_step`,
    which are needed where the file states nothing. A statement that is not understood is an
    error, and so is a column of another quantity, such as ``LVDT1 [mm]`` or spectral
    accelerations.

    Parameters
    ----------
    path : str or path
        A file; neither a pipe nor a device.
    unit : str, optional
        Unit of the accelerations: ``"m/s2"``, ``"cm/s2"``, ``"mm/s2"``, ``"nm/s2"``,
        ``"gal"``, ``"g"``, ``"%g"`` or ``"mg"``, also spelled ``"m/s^2"``, ``"m/s²"``,
        ``"cm/sec/sec"`` and so on; g is standard gravity, 9.80665 m/s2.
    column : str, optional
        Column of a .csv file, or channel of another file, with the horizontal acceleration.
        Needed unless it is the only one. ``"up"`` or ``"down"`` takes a vertical component as
        if it were horizontal, for example to reverse its sign.
    vertical : str or path, optional
        Vertical acceleration, positive upward: a column of the .csv file, a channel of
        another file or ``"up"`` for the one that points there, or a second file. A component
        that is horizontal or points downward by its name or its header is refused.
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
        step is not uniform, if the last number is truncated, or if there are less than two
        samples.

    Examples
    --------
    >>> from importlib.resources import files
    >>> import jaxrock as jr
    >>> path = files("jaxrock") / "data" / "ridgecrest_2019_clc.csv"
    >>> record = jr.read_record(str(path), unit="g", column="east_g", time_step=0.01)
    >>> print(f"{record.samples} samples, {record.time_step:.2f} s apart")
    6001 samples, 0.01 s apart
    """
    column = as_text(column)
    vertical = as_text(vertical)
    if column is not None and not isinstance(column, str):
        raise ValueError(f"column must be the name of a column, got {describe(column)}")
    for name, value in (("path", path), ("vertical", "" if vertical is None else vertical)):
        if not isinstance(value, str | os.PathLike):
            raise ValueError(f"{name} must name one file or one column, got {value!r:.60}")
    path = Path(path)
    claims = make_claims(unit, time_step)
    if path.suffix.lower() in TABLE_SUFFIXES:
        upward = None if vertical is None else str(vertical)
        return _read_table_record(TextFile(path), claims, column, upward)
    if path.is_dir():
        raise ValueError(f"{str(path)!r} is a folder, which read_suite takes: give one file")
    beside = [path] if vertical is None else [path, Path(vertical)]
    components = read_components(path, claims, beside)
    horizontal = _choose_horizontal(path, components, column)
    if vertical is None:
        return make_record(horizontal)
    upward = _find_channel(components, str(vertical))
    if upward is None:
        if not Path(vertical).suffix and not Path(vertical).exists():
            raise ValueError(
                "vertical must be a component of the file, or another file, got"
                f" {str(vertical)!r} for {str(path)!r}"
            )
        components = read_components(Path(vertical), claims._replace(steps=()), beside)
        upward = _choose_vertical(Path(vertical), components)
    return make_record(horizontal, require_upward(upward))


def _read_table_record(
    text: TextFile, claims: Claims, column: str | None, vertical: str | None
) -> Record:
    """Read a horizontal column of a table, and perhaps a vertical one."""
    table = SampleTable(text)
    upward = None if vertical is None else table.find_column("vertical", vertical)
    if column is None:
        level = table.choose_horizontal(upward)
    else:
        level = table.find_column("column", column)
    if level == upward:
        name = table.table.names[level]
        raise text.error(f"column and vertical are the same, {name!r}", table.table.line)
    columns = {level: "column"} | ({} if upward is None else {upward: "vertical"})
    horizontal, *uprights = table.read_components(columns, claims)
    return make_record(horizontal, *map(require_upward, uprights))


def _find_channel(components: list[Component], name: str) -> Component | None:
    """Find the component whose channel, or vertical direction, has a name; None if none has."""
    word = name.lower()
    named = [component for component in components if component.channel.lower() == word != ""]
    if not named and word in ("up", "down"):
        named = [component for component in components if component.direction == word]
    return named[0] if len(named) == 1 else None


def _choose_horizontal(
    path: Path, components: list[Component], column: str | None
) -> Component:
    """Choose the component of a name, or the only horizontal one."""
    file = NamedFile(path)
    level = [component for component in components if component.direction in ("level", "")]
    # A vertical one as well, if its name is given: it can be turned then.
    allowed = level if level and column is None else components
    names = quote_names(component.channel or component.direction for component in allowed)
    if column is not None:
        first = components[0]
        if not first.channel and first.direction in ("", "level"):
            raise ValueError(f"column is for .csv files, {str(path)!r} has only one")
        if named := _find_channel(components, column):
            return named
        raise file.error(f"column is {column!r}, but there are {names}")
    if not level:
        raise file.error(f"no component is horizontal; column names a vertical one: {names}")
    if len(level) > 1:
        raise file.error(f"column must be given, the horizontal component: {names}")
    return level[0]


def _choose_vertical(path: Path, components: list[Component]) -> Component:
    """Choose the vertical component of another file; a `ValueError` if that is not clear."""
    upright = [component for component in components if component.direction in ("up", "down")]
    # A file of one component need not say where it points: the caller does.
    if len(components) == 1 and not components[0].direction:
        upright = components
    if len(upright) != 1:
        raise NamedFile(path).error(f"one vertical component was expected, got {len(upright)}")
    return upright[0]
