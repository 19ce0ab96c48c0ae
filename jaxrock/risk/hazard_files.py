"""Hazard curves from files, whose heads must leave no doubt about measure and units."""

import math
import os
import re
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..oldtables import (
    QUANTITIES,
    Head,
    Table,
    TextFile,
    Unit,
    as_number,
    parse_unit,
    quote_names,
    quote_word,
    read_table,
)
from ..validation import as_text
from .hazard import HAZARD_MEASURES, Hazard, as_hazard_measure, find_fault
from .hazard_notes import agree, find_measures_of_levels, find_statistic, refuse_notes
from .hazard_sites import Curve, Frequency, Levels, has_sites, read_number, read_site

# A rate for a probability, or cm/s for m/s, would give a plausible answer that is wrong by
# orders of magnitude. So every word of a name must be known, and nothing is guessed.
_EXAMPLE = "'pgv [m/s],rate [1/yr]' or 'pga [g],annual rate'"
# Columns of words that say something of their rows.
_QUALIFIERS = (
    r"kind|statistics?|imt|(?:intensity )?measure(?: type)?|quantile|percentile|fractile|branch"
    r"|realization|site|units?"
)
_Column = TypeVar("_Column", Levels, Frequency)


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
        A table of one of these kinds, separated by commas, semicolons, tabs or blanks. Lines that
        begin with # are comments, which must not contradict the columns.

        - A line for each level, rising or falling, below names such as
          ``pgv [m/s],rate [1/yr]``: a level, and a yearly rate of exceedance, a probability of
          exceedance in a number of years (``probability of exceedance in 50 years [%]``) or a
          ``return period [yr]``. Other columns are ignored.
        - OpenQuake's ``hazard_curve-mean-PGA_1.csv`` and the like.
        - Curves of USGS's nshmp-haz, such as ``PGA/curves.csv``. The values are assumed to be
          annual rates, the default of nshmp-haz.
    unit : str, optional
        Unit of the levels, where the file does not state it: ``"cm/s"``, ``"g"`` and so on,
        as in `read_record`. OpenQuake and nshmp-haz have PGA in g and PGV in cm/s.
    measure : {"pgv", "pga"}, optional
        The measure that the curve must have. It chooses a column if there are several, and is
        needed where the file states none: ``level [g]`` may be spectral acceleration.
    site : pair of float, optional
        Longitude and latitude of one of several sites [degrees], to 1e-4.

    Returns
    -------
    Hazard
        Levels in m/s or m/s2; its `statistic` says whether the curve is a mean, a maximum, a
        quantile, one branch of a logic tree, or a part of the hazard. A probability P in T
        years is converted to the rate -ln(1 - P) / T. The lowest levels, where P is printed
        as 1, are left out.

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read, holds no hazard curve or one of another
        measure, seems to be cut, or is not understood.

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
    measure = as_hazard_measure(measure)
    unit = as_text(unit)
    given = None if unit is None else parse_unit(str(unit))
    if given and given.dimension not in ("acceleration", "velocity"):
        raise ValueError(f"unit must be one like 'm/s', 'cm/s', 'm/s2' or 'g', got {unit!r}")
    text = TextFile(Path(path))
    if text.lines[0].lstrip().startswith(("<", "{")):
        raise text.error(
            "a table of a hazard curve was expected, got XML or JSON: let OpenQuake export its"
            " curves as .csv",
            1,
        )
    table = read_table(text)
    if has_sites(table):
        curve = read_site(table, site, measure)
    elif site is not None:
        raise text.error(f"site goes with a table of several sites only, got {site}")
    else:
        curve = _read_columns(table, measure)
    table.refuse_cut()
    measure = _choose_measure(table, curve, measure)
    unit_of_levels = _choose_unit(table, curve.levels, given, measure)
    refuse_notes(table, curve.notes, curve.frequency.kind, unit_of_levels)
    statistic = find_statistic(table, curve.notes, curve.frequency.name)
    levels, rates = _check_points(table, curve)
    try:
        return Hazard(
            unit_of_levels.factor * levels, rates, measure, f"{statistic} {curve.part}".strip()
        )
    except ValueError as error:
        raise text.error(str(error)) from None


def _read_columns(table: Table, measure: str | None) -> Curve:
    """Read a table with a line for each level."""
    if not table.heads:
        row = table.rows[0]
        line = quote_word(table.text.lines[row.line - 1])
        raise table.text.error(f"names of the columns were expected above {line}", row.line)
    frequencies = {
        k: frequency
        for k, head in enumerate(table.heads)
        if (frequency := _parse_frequency(head))
    }
    cells = [*table.names, *(cell for row in table.rows[:1] for cell in row.cells)]
    lists = [cell for cell in cells if _is_list(cell)]
    if lists and not frequencies:
        raise table.text.error(
            f"a field has several numbers, {quote_word(lists[0])}: the first versions of OpenQuake"
            " wrote curves so, without their levels; export them with a later one",
            table.line,
        )
    level, levels = _choose_column(
        table, _find_levels(table, measure), "pgv or pga with its unit"
    )
    expected = "a rate per year, a probability in a number of years, or a return period [yr]"
    often, frequency = _choose_column(table, frequencies, expected)
    points = [
        (row.line, read_number(table, row, level), read_number(table, row, often))
        for row in table.rows
    ]
    notes = [*table.notes]
    for k, head in enumerate(table.heads):
        if k not in (level, often) and re.fullmatch(_QUALIFIERS, head.name, re.I):
            values = {row.cells[k] for row in table.rows}
            if len(values) > 1:
                raise table.text.error(
                    f"column {head.words!r} must be the same in all rows, those of one curve, got"
                    f" {quote_names(sorted(values))}",
                    table.line,
                )
            notes += [(table.rows[0].line, f"{head.name}={value}") for value in values]
    return Curve(levels, frequency, points, notes)


def _choose_column(
    table: Table, columns: dict[int, _Column], expected: str
) -> tuple[int, _Column]:
    """Choose the only column of a kind."""
    if len(columns) != 1:
        raise table.text.error(
            f"one column must be {expected}, as in {_EXAMPLE}, got {len(columns)} of them in"
            f" {quote_names(table.names)}",
            table.line,
        )
    return columns.popitem()


def _find_levels(table: Table, measure: str | None) -> dict[int, Levels]:
    """Find the columns of levels."""
    columns: dict[int, Levels] = {}
    for k, head in enumerate(table.heads):
        for quantity in (*HAZARD_MEASURES, "level"):
            if _match_name(head, quantity) and len(head.units) < 2:
                stated = "" if quantity == "level" else quantity
                source = f"the head states {head.words!r}"
                columns[k] = Levels(head.words, stated, head.unit, source)
    # A column that names its measure is meant, whatever else might be one of levels.
    named = {k: levels for k, levels in columns.items() if levels.measure}
    expected = {k: levels for k, levels in named.items() if levels.measure == measure}
    return expected or named or columns


def _parse_frequency(head: Head) -> Frequency | None:
    """Parse the head of a column that states how often levels are exceeded; None if none."""
    if len(head.units) > 1:
        return None
    # Parsed anew, since a frequency per year is none to the quantities of spectra.
    unit = parse_unit(head.unit.words) if head.unit else Unit("", "none", 1.0)
    if _match_name(head, "rate") and unit[1:] in (("rate", 1.0), ("none", 1.0)):
        return Frequency("rate", head.words)
    # In years, or it may be in anything.
    if _match_name(head, "return period") and (
        unit.dimension == "years" or head.name.endswith("in years")
    ):
        return Frequency("return period", head.words)
    match = _match_name(head, "probability")
    if match is None or unit.dimension not in ("ratio", "none"):
        return None
    # In how many years must be stated once.
    yearly = bool(match["annual"] or match["yearly"])
    years = float(match["years"] or yearly)
    if not years or (match["years"] and yearly):
        return None
    return Frequency("probability", head.words, years, unit.factor)


def _match_name(head: Head, quantity: str) -> re.Match[str] | None:
    """Match all of the name of a column with the names of a quantity."""
    return re.fullmatch(QUANTITIES[quantity].names, head.name, re.I) if head.name else None


def _is_list(cell: str) -> bool:
    """Return whether a cell holds several numbers."""
    words = cell.split()
    return len(words) > 1 and None not in map(as_number, words)


def _choose_measure(table: Table, curve: Curve, measure: str | None) -> str:
    """Choose the measure that the name of levels, a note beside them or the caller states."""
    levels = curve.levels
    stated = find_measures_of_levels(table, curve.notes, levels.measure)
    # A name that says nothing, like level [g], may be of spectral accelerations.
    if levels.measure:
        stated = {levels.measure}
    if len(stated) != 1 and measure is None:
        raise table.text.error(
            "the head does not say which measure the levels are of, so that measure must be"
            f" given, got {levels.name!r}",
            table.line,
        )
    if len(stated) == 1 and measure not in (None, *stated):
        raise table.text.error(
            f"a hazard of {measure} was expected, got one of {stated.pop()}: {levels.name!r}",
            table.line,
        )
    return measure or stated.pop()


def _choose_unit(table: Table, levels: Levels, given: Unit | None, measure: str) -> Unit:
    """Choose the unit of levels that the file or the caller states."""
    unit = levels.unit or given
    if unit is None:
        raise table.text.error(
            f"the head states no unit, so that unit must be given, got {levels.name!r}",
            table.line,
        )
    # A unit of the caller may repeat the one in the head, but not contradict it.
    if given and not agree(unit, given):
        raise table.text.error(f"unit is {given.words!r}, but {levels.source}", table.line)
    if unit.dimension not in QUANTITIES[measure].dimensions:
        raise table.text.error(
            f"{unit.words!r} is not understood as a unit of {measure}, got {levels.name!r}",
            table.line,
        )
    return unit


def _check_points(table: Table, curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Convert what a table states to rates; an error names the first line that is wrong."""
    # Some tables begin with the highest level.
    points = curve.points
    if points and points[0][1] > points[-1][1]:
        points = points[::-1]
    frequency = curve.frequency
    rates = np.array([frequency.convert(value) for _, _, value in points])
    for (line, level, value), rate in zip(points, rates, strict=True):
        if not 0 < level < math.inf:
            raise table.text.error(
                f"a level must be finite and greater than 0, got {level:.6g}", line
            )
        if math.isnan(rate):
            raise table.text.error(
                f"a {frequency.kind} must be {frequency.allowed}, got {value:.6g}", line
            )
    levels = np.array([level for _, level, _ in points])
    fault = find_fault(levels, rates)
    if fault is not None:
        raise table.text.error(fault.reason, points[fault.point][0])
    # Levels that are certain to be exceeded, at a probability of 1.
    possible = np.isfinite(rates)
    count = possible.sum()
    if count < 2:
        raise table.text.error(
            f"at least two levels with finite rates were expected, got {count}"
        )
    return levels[possible], rates[possible]
