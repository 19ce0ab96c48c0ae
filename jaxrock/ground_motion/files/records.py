"""Recorded ground motions from files, one at a time, and the formats of the files.

Nothing is guessed, corrected or resampled: unit and time step are stated by a field of the file, by
brackets in the head of a column, or by the caller, and may not contradict each other.

A new network is a module beside this one that describes its header, and an entry in `FORMATS`.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ...tables import NamedFile, TextFile, quote_names
from ..record import Record
from .at2 import read_at2
from .components import Caller, Component, NotAcceleration, make_caller, make_record
from .cosmos import COSMOS_TITLE, read_cosmos
from .csmip import CSMIP_TITLE, read_csmip
from .esm import ESM_TITLE, read_esm
from .geonet import GEONET_TITLE, read_geonet
from .knet import KNET_SUFFIXES, KNET_TITLE, read_knet
from .obspy_traces import read_traces
from .sample_tables import read_samples
from .smc import SMC_TITLE, read_smc

StrPath = str | os.PathLike[str]
TABLE_SUFFIXES = (".csv", ".tsv")
TRACE_SUFFIXES = (".mseed", ".miniseed", ".msd", ".sac")


class Format(NamedTuple):
    """A format of text files.

    Its name, the ends of its files' names, a pattern of its first line, and a reader of what begins
    at a line: it returns the accelerations there, and the index of the line after it.
    """

    name: str
    suffixes: tuple[str, ...]
    title: str
    read: Callable[[TextFile, Caller, int], tuple[list[Component], int]]


FORMATS = (
    Format("ESM", (".asc",), ESM_TITLE, read_esm),
    Format("COSMOS", (".v1c", ".v2c"), COSMOS_TITLE, read_cosmos),
    Format("GeoNet", (".v1a", ".v2a"), GEONET_TITLE, read_geonet),
    Format("CSMIP", (".v1", ".v2", ".raw"), CSMIP_TITLE, read_csmip),
    Format("SMC", (".smc",), SMC_TITLE, read_smc),
    Format("K-NET", KNET_SUFFIXES, KNET_TITLE, read_knet),
    Format("AT2", (".at2",), "", read_at2),
)


def list_suffixes() -> tuple[str, ...]:
    """List the ends of names, in lower case, of the files in a folder that are read."""
    return sum((known.suffixes for known in FORMATS), TABLE_SUFFIXES + TRACE_SUFFIXES)


def read_components(path: Path, caller: Caller, *named: str) -> list[Component]:
    """Read all components of a file; `named` are the columns of a table that a caller names."""
    if path.suffix.lower() in TABLE_SUFFIXES:
        return read_samples(TextFile(path), caller, *named)
    file = NamedFile(path)
    content = path.read_bytes()
    # UTF-16 has zeros too, and a spreadsheet is refused as a text.
    is_binary = b"\0" in content and content[:2] not in (b"\xff\xfe", b"\xfe\xff", b"PK")
    if path.suffix.lower() in TRACE_SUFFIXES or is_binary:
        return read_traces(file, content, caller)
    text = TextFile(path, content)
    fitting = [f for f in FORMATS if re.match(f.title, text.lines[0], re.I)]
    # An .AT2 file begins in any way.
    known = next((f for f in fitting if f.title or path.suffix.lower() in f.suffixes), None)
    if known is None:
        names = ", ".join([".csv", "miniSEED", "SAC", *(known.name for known in FORMATS)])
        raise text.error(
            f"a file of {names} was expected. Of numbers alone, delete the lines above them and"
            " use jr.Record(np.loadtxt(path), time_step, unit=...); columns belong in a .csv file;"
            " other formats may be read by obspy or gmprocess, for jr.ground_motion.from_obspy"
        )
    components: list[Component] = []
    at = 0
    while at < len(text.lines):
        channels, at = known.read(text, caller, at)
        components += channels
    if not components:
        raise NotAcceleration(str(text.error("the file holds no accelerations")))
    return components


def read_record(
    path: StrPath,
    *,
    unit: str | None = None,
    column: str | None = None,
    vertical: StrPath | None = None,
    time_step: float | int | None = None,
) -> Record:
    """Read a recorded ground motion from a file.

    Unit and time step come from a field of the format, from brackets in the head of a column, or
    from `unit` and `time_step`; they must agree where they are stated twice. Nothing is read out
    of comments, titles or names of files.

    A ``.csv`` or ``.tsv`` file has columns below heads such as ``time [s],acceleration [g]``. The
    acceleration is a column named ``acceleration``, ``acc`` or ``a``, alone or with an axis (x, y,
    z; 1, 2, 3; h1, h2, v; ns, ew, ud; north, east, up; an azimuth), or an axis alone beside a unit
    of acceleration, as in ``east [g]``. Times, ``time [s]`` or ``t [ms]``, have equal steps.

    Files of networks are recognized by their first lines: ESM and ITACA, COSMOS, CSMIP, GeoNet
    (V1A, V2A), SMC, K-NET and KiK-net, and ``.AT2`` of the PEER databases; and where obspy is
    installed (``pip install "jaxrock[records]"``) miniSEED and SAC. The number of samples
    that such a file states must agree with its samples.

    Parameters
    ----------
    path : str or path
        A file.
    unit : str, optional
        Unit of the accelerations: ``"m/s2"``, ``"cm/s2"``, ``"mm/s2"``, ``"nm/s2"``,
        ``"gal"``, ``"g"``, ``"%g"`` or ``"mg"``, also spelled ``"m/s^2"``, ``"m/s²"``,
        ``"cm/sec/sec"`` and so on; g is standard gravity, 9.80665 m/s2.
    column : str, optional
        Column of a .csv file, with its unit as it is printed, or channel of another file, with
        the horizontal acceleration. Needed unless it is the only one.
    vertical : str or path, optional
        Vertical acceleration, positive upward: a column of the .csv file, a channel of
        another file or ``"up"`` for the one that points there, or a second file. A component
        that is horizontal or points downward by its name or its header is refused.
    time_step : float, optional
        Time from one sample to the next [s].

    Returns
    -------
    Record
        Accelerations of shape (samples,) [m/s2] and the time step [s], from time 0 on. A warning
        says if the PGA is above 20 g.

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
    >>> record = jr.read_record(str(path), column="east [g]")
    >>> print(f"{record.samples} samples, {record.time_step:.2f} s apart")
    6001 samples, 0.01 s apart
    """
    given = {"path": path, "column": column or "", "vertical": vertical or ""}
    for name, value in given.items():
        if not isinstance(value, str | os.PathLike):
            raise ValueError(f"{name} must name one file or one column, got {value!r:.60}")
    path = Path(path)
    caller = make_caller(unit, time_step)
    if path.is_dir():
        raise ValueError(f"{str(path)!r} is a folder, which read_suite takes: give one file")
    named = [str(name) for name in (column, vertical) if name not in (None, "up")]
    apart = Path(vertical) if vertical is not None and Path(vertical).is_file() else None
    components = read_components(path, caller, *named[: len(named) - bool(apart)])
    horizontal = _choose(path, components, "column", column, ("level", ""))
    upward = []
    if apart:
        components = read_components(apart, caller)
        # A file of one component need not say where it points: the caller does.
        directions = ("up", "down", "") if len(components) == 1 else ("up", "down")
        upward = [_choose(apart, components, "vertical", None, directions)]
    elif vertical is not None:
        others = [component for component in components if component is not horizontal]
        upward = [_choose(path, others, "vertical", str(vertical), ())]
    return make_record(horizontal, *upward)


def _choose(
    path: Path,
    components: list[Component],
    argument: str,
    name: str | None,
    directions: tuple[str, ...],
) -> Component:
    """Choose the component of a name, or the only one that points in some directions."""
    word = "" if name is None else name.lower()
    fitting = [c for c in components if c.direction in directions]
    if word:
        fitting = [c for c in components if word == c.channel.lower()]
        fitting = fitting or [c for c in components if word == c.direction]
    if len(fitting) == 1:
        return fitting[0]
    names = quote_names(c.channel or c.direction for c in components)
    given = f"is {name!r}" if word else "must be given"
    if word and argument == "vertical":
        given += ", which is no file"
    raise NamedFile(path).error(f"{argument} {given}; its components are {names}")
