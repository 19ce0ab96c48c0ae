"""Suites from folders and lists of files, and the one that comes with the library."""

import os
import re
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from importlib.resources import files
from pathlib import Path

from ..host import show_progress
from .record import Record
from .record_files import StrPath, read_record
from .record_formats import list_acceleration_columns
from .record_units import find_units_in_name
from .suite import Suite

_SUFFIXES = (".at2", ".csv")
# In a folder, the usual name of a table of the records.
_INDEX = "index.csv"
# Words of names of columns, and the ends of names of .AT2 files, after the conventions of data
# centres: the last letter of a channel of three, as in HNZ, is its direction.
_UPWARD = r"up(?:ward|down)?|ud|ve?r?t(?:ical)?|ver|v|u|a?z|accz|[a-z]{2}z"
_DOWNWARD = r"do?w?n(?:ward)?"
_NO_ACCELERATION = r"samples?|index|number|id|v(?:el)?[xyz]"
_AT2_UPWARD = r"up|ud|ve?rt|ver|vertical|v|(?<=-)v1|z|[a-z][hnlg]z"
_AT2_DOWNWARD = r"dn|down|dwn"
# The code of a location may follow that of the channel.
_LOCATION = r"(?:[-_. ]\d\d)?$"
# In the NGA databases such an end may follow the code of a station with nothing between.
_NGA_NAME = r"RSN\d+_"

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
    >>> from importlib.resources import files
    >>> import jaxrock as jr
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


def example_suite(*, vertical: bool = False) -> Suite:
    """Return twenty horizontal components of eight earthquakes, magnitudes 5.9 to 7.8.

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
    # Unpacked into files, so that the records are read as a user's are.
    archive = files("jaxrock") / "data" / "example_suite.zip"
    with tempfile.TemporaryDirectory() as folder:
        with archive.open("rb") as stream, zipfile.ZipFile(stream) as packed:
            packed.extractall(folder)
        return read_suite(folder, vertical=vertical)


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
        if not _is_vertical(path):
            yield path.stem, path, None, _find_vertical_file(path, paths) if vertical else None
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
        if _has_word(_UPWARD, words):
            rises.append(name)
        elif not _has_word(f"{_DOWNWARD}|{_NO_ACCELERATION}", words):
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


def _has_word(pattern: str, words: str) -> bool:
    """Tell whether a whole word of a name, which may be in camelCase, matches a pattern."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words)
    return any(re.fullmatch(pattern, word, re.I) for word in re.findall(r"[^\W\d_]+", apart))


def _strip_unit(name: str) -> str:
    """Strip the unit that it states from the name of a column."""
    # So that a word of the unit is not taken for a direction, and the record has a short name.
    stated = find_units_in_name(name)
    if stated:
        at = name.rfind(stated[-1][0])
        name = f"{name[:at].rstrip('_ [(')} {name[at + len(stated[-1][0]) :].lstrip('_ ])')}"
    return name.strip("_ ")


def _find_vertical_end(path: Path) -> tuple[str, bool]:
    """Find the end of a name that marks a vertical component; tell whether it points down."""
    # Elsewhere a separator has to stand before the end, or a number before the longer ones:
    # the last letters of a word, as in "setup", say nothing.
    apart = r"[-_. ]*"
    if not re.match(_NGA_NAME, path.stem, re.I):
        apart = r"(?:[-_. ]+|(?<=\d)(?=ud|up|dwn))"
    for pattern, downward in ((_AT2_UPWARD, False), (_AT2_DOWNWARD, True)):
        if match := re.search(f"{apart}(?:{pattern}){_LOCATION}", path.stem, re.I):
            return match[0], downward
    return "", False


def _is_vertical(path: Path) -> bool:
    """Tell whether the name of a file says that its component is vertical."""
    return _find_vertical_end(path)[0] != ""


def _find_vertical_file(path: Path, paths: list[Path]) -> Path:
    """Find the vertical component beside a horizontal one, .AT2 files, by their names."""
    found: dict[str, Path] = {}
    for other in paths:
        if (
            other.suffix.lower() == ".at2"
            and _is_vertical(other)
            and other.parent == path.parent
        ):
            stem = other.stem.removesuffix(_find_vertical_end(other)[0])
            # Both names begin alike. In the horizontal one a separator, an angle or, in the
            # NGA databases, a direction comes next: another letter is of another station.
            rest = path.stem.removeprefix(stem) if path.stem.startswith(stem) else "?"
            if re.match(r"[-_. ]|\d{3}$|$|(?:[ns]|[ew]|ns|ew|[hlt]\d?)$", rest, re.I):
                found[stem] = other
    if not found:
        raise ValueError(f"{str(path)!r}: no file is its vertical component by the name")
    # The longest common beginning: "A-STA" may stand beside "A-STA-2".
    nearest = found[max(found, key=len)]
    if _find_vertical_end(nearest)[1]:
        points = f"{str(nearest)!r} points downward by its name"
        raise ValueError(f"{points}, but a vertical component must be positive upward")
    return nearest
