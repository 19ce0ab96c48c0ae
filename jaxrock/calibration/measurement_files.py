"""Reader of files with measurements of free rocking."""

import math
import os

import numpy as np

from ..tables import Column, read_table
from ..validation import Domain

_COLUMNS = {
    "time": Column("time", required=True, synonyms=("t", "impact time")),
    # Degrees in a column of radians are mostly beyond a right angle.
    "peak rotation": Column(
        "angle",
        Domain(
            "between -pi/2 and pi/2 rad and not 0",
            lambda x: (abs(x) > 0) & (abs(x) < math.pi / 2),
            1.0,
        ),
        synonyms=("peak", "max rotation", "maximum rotation"),
    ),
}


def read_impact_times(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the times of impacts, and perhaps the peaks between them, for `fit_free_rocking`.

    Parameters
    ----------
    path : str or path
        A text file, as .csv, with a line for each impact, below a line with the names of the
        columns and their units in brackets, such as ``impact,time [ms],peak rotation [deg]``.
        The column ``time``, also ``t`` or ``impact time``, is needed. The largest rotations
        between an impact and the next, to either side, are in a column ``peak rotation``, also
        ``peak``, ``max rotation`` or ``maximum rotation``: empty or NaN where unknown; the one
        in the last line is not used. Other columns, such as a counter, are ignored. Cells are
        separated by commas, semicolons or tabs. Decimals stand behind a point, or behind a
        comma in all numbers of a table with semicolons or tabs. Lines that begin with # are
        comments; titles may stand above the names.

    Returns
    -------
    impact_times : ndarray, shape (n,)
        Increasing [s].
    peak_rotations : ndarray, shape (n - 1,), or None
        With NaN where unknown [rad]; None if none is known.

    Raises
    ------
    ValueError
        With file and line: if the file cannot be read, if it has no column of times or states
        no unit, or if a value is not allowed or times do not increase.
    """
    contents = read_table(path, _COLUMNS)
    times = contents.values["time"]
    # The fit checks this too, but only here the line of the file is known.
    contents.require(
        np.diff(times, prepend=-math.inf) > 0, "times must increase, got one that does not"
    )
    # After the last impact no other one ends the half-cycle.
    peaks = contents.values["peak rotation"][:-1]
    return times, None if np.isnan(peaks).all() else peaks
