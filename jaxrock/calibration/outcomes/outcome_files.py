"""Tables of tests, or of objects in earthquakes, that overturned or stood, with their motions."""

import functools
import itertools
import math
import os
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from ...ground_motion import Record, Suite, read_record
from ...host import Printed
from ...tables import Column, Contents, read_table
from ...validation import POSITIVE, Booleans, Domain

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
    """

    suite: Suite
    overturned: Booleans
    groups: tuple[str, ...] | None = eqx.field(static=True)

    def __str__(self) -> str:
        count = len(self.suite)
        overturned = int(np.asarray(self.overturned).sum())
        grouping = f" in {len(set(self.groups))} groups" if self.groups else ""
        return (
            f"{count} test{'s' * (count > 1)}{grouping}: {overturned} overturned,"
            f" {count - overturned} stood\n{self.suite}"
        )


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
        not independent of each other; either all tests have a group or none has. A test may
        have a ``name``. By default it is the name of the file without its ending, followed by a
        number if that name is taken.

    Returns
    -------
    Outcomes
        The suite of the motions, what overturned, and groups. A file that
        several tests have in common is read once.

    Raises
    ------
    ValueError
        With file and line, if the table cannot be read, a column states no unit or another
        one, or its name is one letter away from one of these; with a line for each row in which
        a value is missing, not understood or out of range; for the first motion that cannot be
        read.

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
    try:
        suite = Suite(records, _make_names(values["name"].tolist(), values["file"].tolist()))
    except (OSError, ValueError) as error:
        raise contents.table.text.error(str(error)) from None
    overturned = jax.device_put(values["overturned"])
    return Outcomes(suite, overturned, tuple(groups.tolist()) if groups[0] else None)


def _make_names(names: Sequence[str], files: Sequence[str]) -> list[str]:
    """Make a name for each test that has none, by its file, with a number if it is taken."""
    made: list[str] = []
    for name, file in zip(names, files, strict=True):
        stem = Path(file).stem
        numbered = (f"{stem} {number}" for number in itertools.count(2))
        taken = {*names, *made}
        free = (label for label in itertools.chain([stem], numbered) if label not in taken)
        made.append(name or next(free))
    return made


def _read_records(contents: Contents, folder: Path) -> list[Record]:
    """Read the motions of tests, as they are scaled, each source once."""
    names = ("file", "unit", "time step", "column", "scale")
    rows = zip(*(contents.values[name].tolist() for name in names), strict=True)
    read = functools.cache(read_record)
    records = []
    for row, (file, unit, step, column, scale) in zip(contents.table.rows, rows, strict=True):
        step = None if math.isnan(step) else step
        try:
            record = read(
                folder / file, unit=unit or None, time_step=step, column=column or None
            )
        except (OSError, ValueError) as error:
            raise contents.table.text.error(str(error), row.line) from None
        records.append(record.scaled(1.0 if math.isnan(scale) else scale))
    return records
