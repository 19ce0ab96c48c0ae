"""Suites from folders and lists of files, and the one that comes with the library."""

import re
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path

from ..host import with_progress
from .record import Record
from .record_files import StrPath, read_record
from .record_formats import columns_of
from .record_units import units_in_name
from .suite import Suite

_SUFFIXES = (".at2", ".csv")
_INDEX = "index.csv"  # in a folder, the usual name of a table of the records
_UPWARD = r"(?:^|[^a-z])(?:up|ud|vert(?:ical)?|ver|[a-z]{2}z|z)(?:[^a-z]|$)"
_DOWNWARD = r"(?:^|[^a-z])(?:dn|down|dwn)(?:[^a-z]|$)"
_AT2_COMPONENT = r"(?:[-_. ](?:up|ud|dn|down|dwn|vert?|vertical|v|z)|[-_. ]?[a-z]{2}z)$"

_Part = tuple[str, Path, str | None, StrPath | None]  # name, file, column, vertical


def read_suite(
    source: StrPath | Sequence[StrPath],
    *,
    unit: str | None = None,
    time_step: float | int | None = None,
    vertical: bool = False,
) -> Suite:
    """Read the records of a folder, or of several files, as one suite.

    Every horizontal component is a record of its own: each column of accelerations of a ``.csv``
    file, each ``.AT2`` file. Columns named up, ud, z, vertical or the like, and .AT2 files
    whose names end so, are vertical components. Of a folder, its .AT2 and .csv files are
    read in the order of their names, but not those in folders within it, nor a table
    ``index.csv``.

    Parameters
    ----------
    source : str or path, or a sequence of them
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
    >>> from importlib.resources import files
    >>> import jaxrock as jr
    >>> path = str(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv")
    >>> suite = jr.read_suite([path], unit="g", time_step=0.01)
    >>> print(suite.names)
    ('ridgecrest_2019_clc east', 'ridgecrest_2019_clc north')
    """
    paths, faults = _paths(source), []
    parts: list[_Part] = []
    for path in paths:
        try:
            parts += _components(path, paths, vertical)
        except ValueError as error:
            faults.append(str(error))
    records: dict[str, Record] = {}
    for name, path, column, upward in with_progress(parts, "reading records"):
        try:
            if name in records:
                raise ValueError(f"{str(path)!r}: another record is named {name!r} as well")
            records[name] = read_record(
                path, unit=unit, column=column, vertical=upward, time_step=time_step
            )
        except ValueError as error:
            faults.append(str(error))
    if faults:
        raise ValueError("\n".join(dict.fromkeys(faults)))
    if not records:
        raise ValueError(f"a suite needs at least one horizontal component, got {len(paths)} files")
    return Suite([*records.values()], [*records])


def example_suite(*, vertical: bool = False) -> Suite:
    """Twenty horizontal components of eight earthquakes, magnitudes 5.9 to 7.8.

    Ten stations of the California Strong Motion Instrumentation Program, the U.S. Geological
    Survey, the Southern California Seismic Network and GeoNet, New Zealand, with peak ground
    velocities of 0.04 to 1.0 m/s. All are free: in the public domain, CC0, or CC BY 3.0 NZ,
    which asks for the attribution "GeoNet programme and its sponsors EQC, GNS Science, LINZ".
    Station, source, processing and licence of each are in the head of its file and in
    ``index.csv`` of ``example_suite.zip`` in the folder ``data`` of the package.

    Parameters
    ----------
    vertical : bool
        Whether to include the vertical components.

    Returns
    -------
    Suite
        2,000 to 9,000 samples [m/s2], 0.005 to 0.02 s apart.

    Examples
    --------
    >>> from jaxrock import example_suite
    >>> print(example_suite())
    suite of 20 records of 2,000 to 9,000 samples, 0.005 to 0.02 s apart
    """
    archive = files("jaxrock") / "data" / "example_suite.zip"
    with tempfile.TemporaryDirectory() as folder:
        with archive.open("rb") as stream, zipfile.ZipFile(stream) as packed:
            packed.extractall(folder)
        return read_suite(folder, vertical=vertical)


def _paths(source: StrPath | Sequence[StrPath]) -> list[Path]:
    """The files of a suite; a `ValueError` if there is none."""
    if not isinstance(source, Sequence) or isinstance(source, str):
        folder = Path(source)
        if not folder.is_dir():
            if folder.exists():
                return [folder]
            raise ValueError(f"{str(folder)!r}: there is no such folder or file")
        paths = [
            path
            for path in sorted(folder.iterdir())
            if path.suffix.lower() in _SUFFIXES and path.name.lower() != _INDEX and path.is_file()
        ]
        if not paths:
            raise ValueError(f"{str(folder)!r}: the folder has no .AT2 or .csv file of a record")
        return paths
    if not source:
        raise ValueError("a suite needs at least one file, got none")
    return [Path(path) for path in source]


def _components(path: Path, paths: Sequence[Path], vertical: bool) -> Iterator[_Part]:
    """The horizontal components of a file."""
    if path.suffix.lower() == ".at2":
        if _stem(path) != path.stem:  # a vertical one
            return
        upward = None
        if vertical:
            rises = [p for p in paths if _stem(p) != p.stem and path.stem.startswith(_stem(p))]
            if len(rises) != 1:
                found = f"{len(rises)} files are" if rises else "no file is"
                raise ValueError(f"{str(path)!r}: {found} its vertical component by the name")
            upward = rises[0]
        yield path.stem, path, None, upward
        return
    if path.suffix.lower() != ".csv":
        raise ValueError(f"{str(path)!r}: .AT2 and .csv files are read, not {path.suffix!r}")
    names = columns_of(path)
    plain = {name: re.sub(r"[_\s\[(]+$", "", _without_unit(name)) for name in names}
    rises = [name for name in names if re.search(_UPWARD, plain[name], re.I)]
    level = [name for name in names if name not in rises]
    level = [name for name in level if not re.search(_DOWNWARD, plain[name], re.I)]
    if not level:
        raise ValueError(f"{str(path)!r}: no column is a horizontal acceleration")
    if vertical and len(rises) != 1:
        raise ValueError(f"{str(path)!r}: one vertical column was expected, got {len(rises)}")
    for name in level:
        of_several = f"{path.stem} {plain[name] or name}" if len(level) > 1 else path.stem
        yield of_several, path, name, rises[0] if vertical else None


def _without_unit(name: str) -> str:
    """The name of a column up to the unit that it states."""
    stated = units_in_name(name)
    return name[: name.rfind(stated[-1][0])] if stated else name


def _stem(path: Path) -> str:
    """The name of an .AT2 file, without the word for a vertical component if it ends with one."""
    if path.suffix.lower() != ".at2":
        return path.stem
    return re.sub(_AT2_COMPONENT, "", path.stem, flags=re.I)
