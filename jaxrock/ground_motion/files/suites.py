"""Suites from folders and lists of files."""

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ...host import show_progress
from ...oldtables import NamedFile, TextFile, quote_names
from ..record import Record
from ..suite import Suite
from .at2 import find_peer_direction, read_peer
from .claims import Claims, make_claims
from .components import Component, make_record, require_upward
from .directions import find_word_direction, is_same_station
from .formats import TABLE_SUFFIXES, list_suffixes, read_components
from .knet import leave_out_boreholes
from .records import StrPath
from .sample_tables import SampleTable, is_search_report

# Files of a folder that hold no records: the usual index of them, and README files.
_INDEX = "index.csv"
_README = ("readme", "_readme")
# Velocities, displacements and spectra beside accelerations, as COSMOS and ESM name them. ESM's
# names have the station in front, whose code may be one of these words.
_NO_ACCELERATIONS = r".*\.(?:vel|dis)\.[^.]+|(?!.*\.acc\.).*\.(?:vel|dis|sa|sd)\.(?:.*\.)?asc"


class _Motion(NamedTuple):
    """A record of a suite; without `upward` its vertical component is in another file."""

    name: str
    path: Path
    horizontal: Component
    upward: tuple[Component, ...] | None


def read_suite(  # noqa: C901
    source: StrPath | Iterable[StrPath],
    *,
    unit: str | None = None,
    time_step: float | int | None = None,
    vertical: bool = False,
) -> Suite:
    """Read the records of a folder, or of several files, as one suite.

    Every horizontal component becomes a record: one or two columns of a ``.csv`` file, each
    horizontal channel of a file with several channels, and each file with one component.
    Vertical components are recognized by the header of a file, and by names of columns and
    files that end in up, ud, dwn, ver, v, z or the like. If some columns of a table state a
    unit of acceleration, or are named accelerations, the other columns are left out.

    In a folder, files with the ending of a known format are read in the order of their names.
    These are left out: folders within it, hidden files, pipes and devices, README files, a
    table ``index.csv``, the report of a search that PEER puts beside records, and velocities,
    displacements and spectra, which are recognized by names such as ``....VEL.MP.ASC`` of
    ESM. Files of KiK-net's sensors in a borehole (``.EW1``, ``.NS1``, ``.UD1``) are left out
    with a warning if the folder has files of the station at the surface.

    Parameters
    ----------
    source : str or path, or several of them
        A folder, or files; see `read_record` for their formats.
    unit, time_step : optional
        As in `read_record`, the same for all files; needed where the files do not state them.
    vertical : bool
        Whether each record has the vertical component that was recorded with it. It is in
        the same file, or in another one of the folder whose name differs only in the part
        for the component, as ``STA-UP.AT2`` and ``STA090.AT2`` do.

    Returns
    -------
    Suite
        Named by the files, and by the columns or channels where a file has several.

    Raises
    ------
    ValueError
        With one line for each file that cannot be read, or if there is none. Among the
        reasons are a name and a header that disagree about the direction of a component, and
        a vertical component that points downward.

    Examples
    --------
    >>> from importlib.resources import files
    >>> import jaxrock as jr
    >>> path = str(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv")
    >>> suite = jr.read_suite([path], unit="g", time_step=0.01)
    >>> print(suite.names)
    ('ridgecrest_2019_clc east', 'ridgecrest_2019_clc north')
    """
    claims = make_claims(unit, time_step)
    paths, of_folder = _list_files(source)
    paths = leave_out_boreholes(paths)
    # All faults are collected: who repairs a folder of files wants to see them at once.
    faults = []
    motions: list[_Motion] = []
    verticals: dict[Path, Component] = {}
    for path in show_progress(paths, "reading records"):
        try:
            if path.suffix.lower() in TABLE_SUFFIXES:
                components = _read_table(path, claims, vertical, of_folder)
            elif path.suffix.lower() == ".at2":
                components = _read_at2(path, paths, claims, vertical)
            else:
                components = read_components(path, claims, paths)
            if len(components) == 1 and components[0].direction in ("up", "down"):
                verticals[path] = components[0]
            elif components:
                motions += _make_motions(path, components, vertical)
        except ValueError as error:
            faults.append(str(error))
    records: dict[str, Record] = {}
    for motion in motions:
        try:
            if motion.name in records:
                first = next(other.path for other in motions if other.name == motion.name)
                raise NamedFile(motion.path).error(
                    f"another record is named {motion.name!r} as well, from {str(first)!r}"
                )
            records[motion.name] = _make_record(motion, verticals)
        except ValueError as error:
            faults.append(str(error))
    if faults:
        # Two components of one file may have the same fault.
        lines = [*dict.fromkeys(faults)]
        if of_folder and not records and len(lines) > 1:
            folder = str(paths[0].parent)
            lines.insert(
                0, f"{folder!r}: none of the {len(paths)} files is a record to be read"
            )
        raise ValueError("\n".join(lines))
    if not records:
        raise ValueError(
            f"a suite needs at least one horizontal component, got {len(paths)} files"
        )
    count = f"{len(records)} record{'s' * (len(records) > 1)}"
    where = f" of the folder {paths[0].resolve().parent.name!r}" if of_folder else ""
    return Suite([*records.values()], [*records], source=f"{count}{where}")


def _list_files(source: StrPath | Iterable[StrPath]) -> tuple[list[Path], bool]:
    """List the files of a suite, and tell whether they are of a folder."""
    if isinstance(source, str | os.PathLike):
        folder = Path(source)
        if not folder.is_dir():
            if folder.exists():
                return [folder], False
            raise ValueError(f"{str(folder)!r}: there is no such folder or file")
        paths = [
            path
            for path in sorted(folder.iterdir(), key=lambda path: path.name)
            if path.name.lower().endswith(list_suffixes())
            # Hidden files are left behind by editors, archives and macOS.
            and not path.name.lower().startswith((".", *_README))
            and path.name.lower() != _INDEX
            and not re.fullmatch(_NO_ACCELERATIONS, path.name.lower())
            # A link to nowhere is named when it is read.
            and (path.is_file() or not path.exists())
        ]
        if not paths:
            ends = ", ".join(list_suffixes())
            raise ValueError(f"{str(folder)!r}: the folder has no file of a record: {ends}")
        return paths, True
    if not isinstance(source, Iterable):
        raise ValueError(f"source must be a folder or a list of files, got {source!r:.60}")
    paths = [Path(path) for path in source]
    if not paths:
        raise ValueError("a suite needs at least one file, got none")
    return paths, False


def _read_table(
    path: Path, claims: Claims, vertical: bool, of_folder: bool
) -> list[Component]:
    """Read the horizontal columns of a table, and the vertical one if it is wanted."""
    text = TextFile(path)
    if of_folder and is_search_report(text):
        return []
    table = SampleTable(text)
    heads = table.table.heads
    level = [k for k in table.accelerations if table.directions[k] == "level"]
    upright = [k for k in table.accelerations if table.directions[k] in ("up", "down")]
    if not level and table.is_vertical and not vertical:
        return []
    if not level and not table.is_vertical:
        names = quote_names(table.table.names)
        raise text.error(f"no column is a horizontal acceleration among {names}")
    if len(level) > 2:
        names = quote_names(heads[k].words for k in level)
        raise text.error(f"at most two horizontal columns were expected: {names}")
    columns = [*level, *upright] if vertical else level
    components = table.read_components(dict.fromkeys(columns, "column"), claims)
    return [
        component._replace(
            channel=heads[k].name or heads[k].words, direction=table.directions[k] or ""
        )
        for k, component in zip(columns, components, strict=True)
    ]


def _read_at2(
    path: Path, paths: list[Path], claims: Claims, vertical: bool
) -> list[Component]:
    """Read an .AT2 file, unless it is a vertical component that is not wanted."""
    text = TextFile(path)
    # Before the values, which cost time and may be at fault where nobody wants them.
    if find_peer_direction(text, paths) in ("up", "down") and not vertical:
        return []
    return read_peer(text, claims, paths)


def _make_motions(path: Path, components: list[Component], vertical: bool) -> list[_Motion]:
    """Make a record of each horizontal component of a file."""
    if len(components) == 1:
        # The names of K-NET's files differ only in the suffix.
        name = path.name if find_word_direction(path.suffix[1:]) else path.stem
        return [_Motion(name, path, components[0], None if vertical else ())]
    file = NamedFile(path)
    unknown = [component.channel for component in components if not component.direction]
    if unknown:
        raise file.error(
            f"the file does not say where {quote_names(unknown)} points; read_record takes its"
            " channels one by one"
        )
    level = [component for component in components if component.direction == "level"]
    upright = tuple(component for component in components if component.direction != "level")
    if not level:
        raise file.error("no component is horizontal")
    if vertical and len(upright) != 1:
        raise file.error(f"one vertical component was expected, got {len(upright)}")
    return [
        _Motion(
            f"{path.stem} {component.channel}" if len(level) > 1 else path.stem,
            path,
            component,
            upright if vertical else (),
        )
        for component in level
    ]


def _make_record(motion: _Motion, verticals: dict[Path, Component]) -> Record:
    """Make a record, with a vertical component from another file if need be."""
    upward = motion.upward
    if upward is None:
        file = NamedFile(motion.path)
        paths = [path for path in verticals if is_same_station(motion.path, path)]
        if not paths:
            raise file.error("no file is its vertical component by the name")
        if len(paths) > 1:
            names = quote_names(path.name for path in paths)
            raise file.error(f"several files may be its vertical component: {names}")
        upward = (verticals[paths[0]],)
    return make_record(motion.horizontal, *map(require_upward, upward))
