"""Suites from folders and lists of files."""

import os
from collections.abc import Iterable
from pathlib import Path

from ...host import show_progress
from ...tables import NamedFile, quote_names, read_head
from ..record import Record
from ..suite import Suite
from .components import Component, NotAcceleration, make_caller, make_record
from .knet import KNET_SUFFIXES
from .records import StrPath, list_suffixes, read_components

_BOREHOLE = (".ns1", ".ew1", ".ud1")


def read_suite(
    source: StrPath | Iterable[StrPath],
    *,
    unit: str | None = None,
    time_step: float | int | None = None,
    vertical: bool = False,
) -> Suite:
    """Read the records of a folder, or of several files, as one suite.

    Every horizontal component becomes a record: one or two columns of a ``.csv`` file, each
    horizontal channel of a file with several channels, and each file with one component. A
    component is vertical by a field of its file, by the axis in the head of its column, or, of an
    ``.AT2`` file, by the end of its title, or else by the end of its name: ``-UP``, ``-DWN``,
    ``-UD``, ``-V``, ``UP``, ``DWN``, ``UD`` or ``Z``.

    In a folder, files with the ending of a known format are read in the order of their names,
    hidden files apart. Files that state to be no accelerations, tables without a column of
    accelerations, and KiK-net's sensors in a borehole beside those at the surface are left out.
    The `Suite.source` names what was left out.

    Parameters
    ----------
    source : str or path, or several of them
        A folder, or files; see `read_record` for their formats.
    unit, time_step : optional
        As in `read_record`, the same for all files; needed where the files do not state them.
    vertical : bool
        Whether each record has the vertical component of the same file. Where that is in a
        file of its own, take `read_record` with its ``vertical``.

    Returns
    -------
    Suite
        Named by the files, and by the columns or channels where a file has several.

    Raises
    ------
    ValueError
        With one line for each file that cannot be read, or if there is none. Among the
        reasons are two columns that do not differ by their axes alone, and a vertical component
        that points downward.

    Examples
    --------
    >>> from importlib.resources import files
    >>> import jaxrock as jr
    >>> path = str(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv")
    >>> suite = jr.read_suite([path])
    >>> print(suite.names)
    ('ridgecrest_2019_clc east', 'ridgecrest_2019_clc north')
    """
    caller = make_caller(unit, time_step)
    paths, of_folder = _list_files(source)
    components: dict[Path, list[Component]] = {}
    # All faults are collected: who repairs a folder of files wants to see them at once.
    faults: list[str] = []
    left_out: list[str] = []
    for path in show_progress(paths, "reading records"):
        try:
            components[path] = read_components(path, caller)
        except (OSError, ValueError) as error:
            is_other = of_folder and isinstance(error, NotAcceleration)
            (left_out if is_other else faults).append(path.name if is_other else str(error))
    for path in [path for path in components if path.suffix.lower() in _BOREHOLE]:
        if path.with_suffix(f"{path.suffix[:-1]}2") in components:
            left_out.append(path.name)
            del components[path]
    named: list[tuple[str, Record]] = []
    for path, channels in components.items():
        try:
            named += [
                (name, make_record(level, *_find_vertical(path, channels, vertical)))
                for name, level in _name_records(path, channels)
            ]
        except ValueError as error:
            faults.append(str(error))
        upright = [c.channel for c in channels if c.direction in ("up", "down")]
        left_out += [] if vertical else [f"{path.name} {name}".rstrip() for name in upright]
    if faults:
        # Two components of one file may have the same fault.
        raise ValueError("\n".join(dict.fromkeys(faults)))
    source = f"{len(named)} record{'s' * (len(named) != 1)}"
    source += f" of the folder {paths[0].resolve().parent.name!r}" if of_folder else ""
    source += f"; left out: {quote_names(left_out)}" if left_out else ""
    if not named:
        files = quote_names(map(str, paths)) or "no file"
        raise ValueError(
            f"a suite needs at least one horizontal component, got {source}, of {files}"
        )
    names, records = zip(*named, strict=True)
    return Suite(records, names, source=source)


def _list_files(source: StrPath | Iterable[StrPath]) -> tuple[list[Path], bool]:
    """List the files of a suite, and return whether they are of a folder."""
    if isinstance(source, str | os.PathLike):
        folder = Path(source)
        if not folder.is_dir():
            return [folder], False
        # Hidden files are left behind by editors, archives and macOS. A link to nowhere is named
        # when it is read.
        paths = [
            path
            for path in sorted(folder.iterdir(), key=lambda path: path.name)
            if path.name.lower().endswith(list_suffixes())
            and not path.name.startswith(".")
            and (path.is_file() or not path.exists())
        ]
        if not paths:
            ends = ", ".join(list_suffixes())
            raise ValueError(f"{str(folder)!r}: the folder has no file of a record: {ends}")
        return paths, True
    if not isinstance(source, Iterable):
        raise ValueError(f"source must be a folder or a list of files, got {source!r:.60}")
    return [Path(path) for path in source], False


def _name_records(path: Path, channels: list[Component]) -> list[tuple[str, Component]]:
    """Name the horizontal components of a file."""
    unknown = [c.channel for c in channels if not c.direction]
    if unknown and len(channels) > 1:
        raise NamedFile(path).error(
            f"the file does not say where {quote_names(unknown)} points; read_record takes its"
            " channels one by one"
        )
    level = [c for c in channels if c.direction in ("level", "")]
    if len(level) > 1:
        # A column is named without its unit.
        return [(f"{path.stem} {read_head(c.channel).name}", c) for c in level]
    # The names of K-NET's files differ only in the suffix.
    is_knet = path.suffix.lower() in KNET_SUFFIXES
    return [(path.name if is_knet else path.stem, c) for c in level]


def _find_vertical(path: Path, channels: list[Component], wanted: bool) -> list[Component]:
    """Find the only vertical component of a file."""
    found = [c for c in channels if c.direction in ("up", "down")]
    if wanted and len(found) != 1:
        raise NamedFile(path).error(
            f"one vertical component was expected, got {len(found)}: read_record takes any file"
            " as vertical="
        )
    return found if wanted else []
