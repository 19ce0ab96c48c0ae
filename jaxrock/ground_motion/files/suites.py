"""Suites from folders and lists of files, and the one that comes with the library."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from ...host import show_progress
from ..record import Record
from ..suite import Suite
from .directions import find_column_direction, find_vertical_file, is_vertical
from .records import StrPath, read_record
from .tables import list_acceleration_columns
from .units import find_units_in_name

_SUFFIXES = (".at2", ".csv")
# In a folder, the usual name of a table of the records.
_INDEX = "index.csv"
# What a record is read from: its name, file, column and vertical component.
_Part = tuple[str, Path, str | None, StrPath | None]


def read_suite(
    source: StrPath | Iterable[StrPath],
    *,
    unit: str | None = None,
    time_step: float | int | None = None,
    vertical: bool = False,
) -> Suite:
    """Read the records of a folder, or of several files, as one suite.

    Every horizontal component is a record of its own: one column or two of a ``.csv`` file,
    each ``.AT2`` file. Columns named up, ud, z, vertical or the like, and .AT2 files whose
    names end so, are vertical components; where some columns state a unit, the others are left
    out. Of a folder, its .AT2 and .csv files are read in the order of their names, but not
    hidden ones, those in folders within it, nor a table ``index.csv``.

    Parameters
    ----------
    source : str or path, or several of them
        A folder, or files; see `read_record` for their formats.
    unit, time_step : optional
        As in `read_record`, where the files do not state them: the same for all.
    vertical : bool
        Whether each record has the vertical component that was recorded with it.

    Returns
    -------
    Suite
        Named by the files, and by the columns where a file has several.

    Raises
    ------
    ValueError
        With one line for each file that cannot be read, or if there is none.

    Examples
    --------
    >>>     >>> import jaxrock as jr
    >>> path = str(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv")
    >>> suite = jr.read_suite([path], unit="g", time_step=0.01)
    >>> print(suite.names)
    ('ridgecrest_2019_clc east', 'ridgecrest_2019_clc north')
    """
    paths = _list_files(source)
    # All faults are collected: who repairs a folder of files wants to see each of them at
    # once.
    faults = []
    parts: list[_Part] = []
    for path in paths:
        try:
            parts += _find_components(path, paths, vertical)
        except ValueError as error:
            faults.append(str(error))
    records: dict[str, Record] = {}
    for name, path, column, upward in show_progress(parts, "reading records"):
        try:
            if name in records:
                raise ValueError(f"{str(path)!r}: another record is named {name!r} as well")
            records[name] = read_record(
                path, unit=unit, column=column, vertical=upward, time_step=time_step
            )
        except ValueError as error:
            faults.append(str(error))
    if faults:
        # Two components of one file may have the same fault.
        raise ValueError("\n".join(dict.fromkeys(faults)))
    if not records:
        raise ValueError(
            f"a suite needs at least one horizontal component, got {len(paths)} files"
        )
    return Suite([*records.values()], [*records])


def _list_files(source: StrPath | Iterable[StrPath]) -> list[Path]:
    """List the files of a suite; a `ValueError` if there is none."""
    if isinstance(source, str | os.PathLike):
        folder = Path(source)
        if not folder.is_dir():
            if folder.exists():
                return [folder]
            raise ValueError(f"{str(folder)!r}: there is no such folder or file")
        paths = [
            path
            for path in sorted(folder.iterdir(), key=lambda path: path.name)
            if path.suffix.lower() in _SUFFIXES
            and path.name.lower() != _INDEX
            # Hidden files are left behind by editors and archives.
            and not path.name.startswith(".")
            and not path.is_dir()
        ]
        if not paths:
            raise ValueError(
                f"{str(folder)!r}: the folder has no .AT2 or .csv file of a record"
            )
        return paths
    if not isinstance(source, Iterable):
        raise ValueError(f"source must be a folder or a list of files, got {source!r:.60}")
    paths = [Path(path) for path in source]
    if not paths:
        raise ValueError("a suite needs at least one file, got none")
    return paths


def _find_components(path: Path, paths: list[Path], vertical: bool) -> Iterator[_Part]:
    """Find the horizontal components in a file, each with its vertical one if wanted."""
    if path.suffix.lower() == ".at2":
        if not is_vertical(path):
            yield path.stem, path, None, find_vertical_file(path, paths) if vertical else None
        return
    if path.suffix.lower() != ".csv":
        raise ValueError(f"{str(path)!r}: .AT2 and .csv files are read, not {path.suffix!r}")
    # Where some columns state a unit of acceleration, the others hold something else.
    names = list_acceleration_columns(path)
    names = [name for name in names if find_units_in_name(name)] or names
    plain = {name: _strip_unit(name) for name in names}
    rises = []
    level = []
    for name, words in plain.items():
        direction = find_column_direction(words)
        if direction == "up":
            rises.append(name)
        elif direction == "level":
            level.append(name)
    if not level:
        raise ValueError(f"{str(path)!r}: no column is a horizontal acceleration")
    if len(level) > 2:
        listed = ", ".join(map(repr, level[:6]))
        raise ValueError(
            f"{str(path)!r}: at most two horizontal columns were expected: {listed}"
        )
    if vertical and len(rises) != 1:
        raise ValueError(f"{str(path)!r}: one vertical column was expected, got {len(rises)}")
    for name in level:
        of_several = f"{path.stem} {plain[name] or name}" if len(level) > 1 else path.stem
        yield of_several, path, name, rises[0] if vertical else None


def _strip_unit(name: str) -> str:
    """Strip the unit that it states from the name of a column."""
    # So that a word of the unit is not taken for a direction, and the record has a short name.
    stated = find_units_in_name(name)
    if stated:
        at = name.rfind(stated[-1][0])
        name = f"{name[:at].rstrip('_ [(')} {name[at + len(stated[-1][0]) :].lstrip('_ ])')}"
    return name.strip("_ ")
