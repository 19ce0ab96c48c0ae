"""Tables of tests, or of objects in earthquakes, that overturned or stood, with their motions."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from ...ground_motion import Record, Suite, read_record
from ...host import Printed, show_progress
from ...tables import Column, Contents, read_table
from ...validation import POSITIVE, Booleans, Domain, Reals

_COLUMNS = {
    "file": Column(required=True),
    "overturned": Column("flag", required=True, synonyms=("outcome",)),
    "unit": Column(),
    "time step": Column("time", POSITIVE),
    "column": Column(),
    "scale": Column(
        "ratio",
        Domain("finite and not 0", lambda x: (abs(x) > 0) & (abs(x) < math.inf), 1.0),
        synonyms=("scale factor",),
    ),
    "group": Column(synonyms=("earthquake", "event")),
    "peak rotation": Column("angle", synonyms=("max rotation", "maximum rotation")),
    "name": Column(synonyms=("test",)),
}


class Outcomes(Printed, eqx.Module):
    """Motions, and whether a block overturned under them; see `read_tests`.

    Attributes
    ----------
    suite : Suite
        The motion of each test, as it was scaled.
    overturned : Array, shape (tests,)
        Whether the block overturned.
    groups : tuple of str, optional
        The group of each test, such as the earthquake.
    peak_rotations : Array, shape (tests,), optional
        Largest measured rotation [rad]; NaN where none was measured or the block overturned.
    """

    suite: Suite
    overturned: Booleans
    groups: tuple[str, ...] | None = eqx.field(static=True)
    peak_rotations: Reals | None

    def __str__(self) -> str:
        count = len(self.suite)
        overturned = int(np.asarray(self.overturned).sum())
        of_groups = ""
        if self.groups is not None:
            groups = len(set(self.groups))
            of_groups = f" in {groups} group{'s' * (groups > 1)}"
        lines = [
            f"{count} test{'s' * (count > 1)}{of_groups}: {overturned} overturned,"
            f" {count - overturned} stood",
            str(self.suite),
        ]
        if self.peak_rotations is not None:
            measured = np.isfinite(np.asarray(self.peak_rotations)).sum()
            lines.append(f"peak rotations of {measured} tests")
        return "\n".join(lines)


class _Source(NamedTuple):
    """A motion of a file, and what the table states of it: its unit, step [s] and column."""

    path: Path
    unit: str | None
    time_step: float | None
    column: str | None


def read_tests(path: str | os.PathLike[str]) -> Outcomes:
    r"""Read a table of tests in which a block overturned or stood, and their motions.

    They may be tests on a shaking table, or observations of objects in earthquakes.

    Parameters
    ----------
    path : str or path
        A file with columns separated by commas, semicolons or tabs, in any order, below a
        line with their names, such as ``file,unit,overturned``. Titles may stand above that
        line. Lines that begin with # are comments, and rows of empty cells are left out.
        Decimals stand behind a point, or behind a comma in all numbers of a table with
        semicolons or tabs. Unknown columns are ignored.

        Each test has a ``file`` with its motion, absolute or relative to the folder of the
        table. The column ``overturned`` has yes, true, 1 or overturned, or else no, false, 0
        or stood. Where the files do not state them, a ``unit`` of acceleration and a ``time
        step [s]`` are needed, and where they have several components a ``column``, as in
        `read_record`.

        A ``scale`` is a factor on the motion, 1 if it is missing; if it is negative, the
        motion is reversed. Tests of the same ``group``, also ``earthquake`` or ``event``, are
        not independent of each other; either all tests have a group or none has. A ``peak
        rotation``, in rad, mrad or deg, is empty where it was not measured; that of a test
        that overturned is left out, since a block that falls has no peak. A test may have a
        ``name``. By default it is the name of the file without its ending, followed by a
        number if that name is taken.

    Returns
    -------
    Outcomes
        The suite of the motions, what overturned, groups and peak rotations. A file that
        several tests have in common is read once.

    Raises
    ------
    ValueError
        With file and line, if the table cannot be read, a column states no unit or another
        one, or its name is one letter away from one of these; with a line for each row in which
        a value is missing, not understood or out of range, or a motion cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder)
    ...     _ = (path / "run.csv").write_text("time [s],acc [g]\n0,0\n0.01,0.3\n0.02,0\n")
    ...     rows = "run.csv,1,stood\nrun.csv,2.5,overturned\n"
    ...     _ = (path / "tests.csv").write_text(f"file,scale,overturned\n{rows}")
    ...     print(jr.calibration.read_tests(path / "tests.csv"))
    2 tests: 1 overturned, 1 stood
    suite of 2 records of 3 samples, 0.01 s apart
    """
    contents = read_table(path, _COLUMNS)
    values = contents.values
    groups = values["group"]
    contents.require(
        (groups != "") | (groups == "").all(),
        "a group was expected, since other tests have one",
    )
    records = _read_records(contents, Path(path).parent)
    overturned = values["overturned"]
    # A block that falls has no peak, whatever was noted.
    peaks = np.where(overturned, np.nan, values["peak rotation"])
    # A rotation of more than a right angle was measured in another unit than stated.
    contents.require(
        np.isnan(peaks) | ((peaks >= 0) & (peaks < math.pi / 2)),
        "a peak rotation of at least 0 and less than pi / 2 rad was expected",
    )
    try:
        suite = Suite(records, _make_names(values["name"].tolist(), values["file"].tolist()))
    except ValueError as error:
        raise contents.table.text.error(str(error)) from None
    return Outcomes(
        suite,
        jax.device_put(overturned),
        tuple(groups.tolist()) if groups[0] else None,
        None if np.isnan(peaks).all() else jax.device_put(peaks),
    )


def _make_names(names: Sequence[str], files: Sequence[str]) -> list[str]:
    """Make a name for each test that has none, by its file, with a number if it is taken."""
    made: list[str] = []
    for name, file in zip(names, files, strict=True):
        stem = Path(file).stem
        number = 1
        while not name:
            words = stem if number == 1 else f"{stem} {number}"
            name = "" if words in (*names, *made) else words
            number += 1
        made.append(name)
    return made


def _read_records(contents: Contents, folder: Path) -> list[Record]:
    """Read the motions of tests, each source once; all that cannot be read are one error."""
    columns = (
        contents.values[name].tolist() for name in ("file", "unit", "time step", "column")
    )
    sources = [
        _Source(
            folder / file, unit or None, None if math.isnan(step) else step, column or None
        )
        for file, unit, step, column in zip(*columns, strict=True)
    ]
    records: dict[_Source, Record] = {}
    faults: list[str] = []
    for source in show_progress([*dict.fromkeys(sources)], "reading motions"):
        path, unit, time_step, column = source
        try:
            records[source] = read_record(path, unit=unit, time_step=time_step, column=column)
        except ValueError as error:
            line = contents.table.rows[sources.index(source)].line
            faults.append(str(contents.table.text.error(str(error), line)))
    if faults:
        raise ValueError("\n".join(faults))
    scales = contents.values["scale"].tolist()
    return [
        records[source].scaled(1.0 if math.isnan(scale) else scale)
        for source, scale in zip(sources, scales, strict=True)
    ]
