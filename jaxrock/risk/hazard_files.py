"""Hazard curves from files, whose heads must leave no doubt about measure and units."""

import os
from pathlib import Path

import numpy as np

from ..host import TextTable, is_number, read_text_table
from .hazard import Hazard, as_hazard_measure
from .hazard_columns import (
    Frequency,
    Levels,
    Points,
    choose_columns,
    find_contradiction,
    find_factor,
)
from .hazard_sites import has_sites, read_site

_ORDER = "levels must increase from each to the next, or all fall"


def read_hazard(
    path: str | os.PathLike[str],
    *,
    unit: str | None = None,
    measure: str | None = None,
    site: tuple[float | int, float | int] | None = None,
) -> Hazard:
    r"""Read a hazard curve from a text file, as .csv.

    Parameters
    ----------
    path : str or path
        A table of one of these kinds. Its fields are separated by commas, by tabs, or by what
        a first line ``sep=;`` says; lines that begin with # are comments.

        - A line for each level, below one with the names of the columns, such as
          ``pgv [m/s],rate [1/yr]``. One column is the level of the intensity measure; another
          one a yearly rate of exceedance, a probability of exceedance in a number of years
          (``probability of exceedance in 50 years [%]``), or a ``return period [yr]``. Other
          columns are ignored. Levels may rise or fall. A comment must not name a probability
          above rates, nor spectral acceleration above levels without a measure in their name.
        - A hazard curve of OpenQuake, such as ``hazard_curve-mean-PGA_1.csv``: a line for each
          site, columns ``poe-0.005`` and so on, measure and years in the comment above.
        - Curves of USGS's nshmp-haz, such as ``PGA/curves.csv``: a line for each site, columns
          ``name,lon,lat,0.005`` and so on. The values are taken for annual rates, which
          nshmp-haz writes unless told otherwise.
    unit : str, optional
        Of the levels, where the file does not state it: ``"m/s"``, ``"cm/s"`` and so on, or
        a unit of acceleration as in `read_record`. OpenQuake and nshmp-haz have PGA in g and
        PGV in cm/s.
    measure : {"pgv", "pga"}, optional
        Which measure is expected: the curve must not be of another one. Of a table with a
        column for each, it chooses one. Needed where neither the name of the levels nor a
        comment says the measure: ``level [g]`` may be spectral acceleration.
    site : pair of float, optional
        Longitude and latitude of one of several sites [degrees], to 1e-4.

    Returns
    -------
    Hazard
        Levels in m/s or m/s2. Of a probability P in T years the rate is -ln(1 - P) / T. The
        lowest levels, where P is printed as 1, have no finite rate and are left out.

    Raises
    ------
    ValueError
        With the file, and the line where there is one, if the file cannot be read, holds no
        hazard curve, is about another measure, seems to be cut, or if its head is not
        understood.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "hazard.csv"
    ...     _ = path.write_text("PGA [g],annual rate\n0.1,1e-2\n1,1e-4\n")
    ...     print(jr.read_hazard(path))
    hazard of pga from 0.01 1/yr at 0.9807 to 0.0001 1/yr at 9.807
    """
    path = Path(path)
    measure = as_hazard_measure(measure)
    table = read_text_table(path)
    # NumPy writes names behind a #.
    if table.rows and all(map(is_number, table.rows[0][2])):
        above = [row for row in table.comments if row[0] < table.rows[0][0]][-1:]
        comments = [row for row in table.comments if row not in above]
        table = table._replace(rows=above + table.rows, comments=comments)
    table.refuse(not table.rows, "a table of levels and rates was expected, got no lines")
    number, line, names = table.rows[0]
    must = "a line with the names of the columns was expected"
    table.refuse(all(map(is_number, names)), f"{must}, got {line[:60]!r}", number)
    try:
        if has_sites(names):
            points = read_site(table, site, measure)
        else:
            table.refuse(site is not None, "site goes with a table of several sites only")
            points = _read_rows(table, *choose_columns(names, measure))
        for at, line, _ in table.comments:
            other = find_contradiction(points.level, points.frequency, line)
            table.refuse(bool(other), f"a comment names {other}, got {line[:60]!r}", at)
        said = [line for _, line, _ in table.comments]
        factor, found = find_factor(points.level, unit, measure, said)
    except ValueError as error:
        # One that says the line by itself, or that is about the names.
        known = str(error).startswith(repr(str(path)))
        table.refuse(not known, str(error), number)
        raise
    levels, rates = _check_points(table, points)
    try:
        return Hazard(factor * levels, rates, found)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}: {error}") from None


def _read_rows(
    table: TextTable, of_levels: tuple[int, Levels], of_rates: tuple[int, Frequency]
) -> Points:
    """Read the columns of levels and of how often they are exceeded, by their numbers."""
    level, found = of_levels
    often, frequency = of_rates
    (_, _, names), *rows = table.rows
    must = "at least two lines of a level and a rate below their names were expected"
    table.refuse(len(rows) < 2, f"{must}, got {len(rows)}")
    for number, line, fields in rows:
        must = f"{len(names)} fields were expected, as many as names"
        table.refuse(len(fields) != len(names), f"{must}, got {line[:60]!r}", number)
        must = "a level and a rate were expected"
        wrong = not is_number(fields[level]) or not is_number(fields[often])
        table.refuse(wrong, f"{must}, got {line[:60]!r}", number)
    for k in (level, often):
        table.refuse_cut(rows[-1], k, [fields[k] for _, _, fields in rows[:-1]])
    columns = [[float(fields[k]) for _, _, fields in rows] for k in (level, often)]
    lines = [number for number, _, _ in rows]
    return Points(found, frequency, lines, *map(np.array, columns))


def _check_points(table: TextTable, points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Convert what a table states to rates; an error names the first line that is wrong."""
    # Some tables begin with the highest level.
    order = -1 if (np.diff(points.levels) < 0).all() else 1
    levels = points.levels[::order]
    values = points.values[::order]
    lines = points.lines[::order]
    rates = np.array([points.frequency.convert(float(value)) for value in values])
    # A probability of 1 has a rate of inf.
    must = f"a {points.frequency.kind} must be {points.frequency.allowed}"
    for wrong, reason in (
        (~((levels > 0) & (levels < np.inf)), "a level must be finite and greater than 0"),
        (np.isnan(rates), must),
        (np.append(False, levels[1:] <= levels[:-1]), _ORDER),
        (np.append(False, rates[1:] > rates[:-1]), "rates must not rise with the level"),
    ):
        at = int(np.argmax(wrong))
        got = f"{levels[at]:.6g} and {values[at]:.6g}"
        if reason == _ORDER:
            got = f"{levels[at - 1]:.6g} and then {levels[at]:.6g}"
        table.refuse(bool(wrong[at]), f"{reason}, got {got}", lines[at])
    certain = np.isinf(rates)
    return levels[~certain], rates[~certain]
