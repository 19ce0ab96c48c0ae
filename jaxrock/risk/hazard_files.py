"""Hazard curves from files, whose heads must leave no doubt about measure and units."""

import math
import os
import re
from pathlib import Path

import numpy as np

from ..tables import QUANTITIES, Head, Table, TextFile, as_number, parse_unit, quote_names
from ..tables import quote_word, read_table
from .hazard import HAZARD_MEASURES, Hazard, as_hazard_measure, find_fault
from .hazard_sites import Curve, Frequency, has_sites, read_number, read_site

# A rate for a probability, or cm/s for m/s, would give a plausible answer that is wrong by
# orders of magnitude. So every word of a name must be known, and nothing is guessed: a column
# with a word that is no part of the name of a quantity is none, and the message says what was
# expected.
_EXAMPLE = "'pgv [m/s],rate [1/yr]' or 'pga [g],annual rate'"
_IN_COMMENT = {
    "pga": r"pga|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+acceleration",
    "pgv": r"pgv|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+velocity",
}
# Words of other measures in the same units.
_OTHER_MEASURES = "|".join(QUANTITIES[key].words for key in ("spectral acceleration", "intensity"))


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
    measure = as_hazard_measure(measure)
    if unit is not None and parse_unit(str(unit)).dimension not in ("acceleration", "velocity"):
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
    _refuse_comments(table, curve)
    measure = _choose_measure(table, curve.head, measure)
    factor = _choose_unit(table, curve, unit, measure)
    levels, rates = _check_points(table, curve)
    try:
        return Hazard(factor * levels, rates, measure, curve.statistic)
    except ValueError as error:
        raise text.error(str(error)) from None


def _read_columns(table: Table, measure: str | None) -> Curve:
    """Read a table with a line for each level."""
    row = table.rows[0] if table.rows else None
    lists = [cell for cell in [*table.names, *(row.cells if row else [])] if _is_list(cell)]
    if lists:
        raise table.text.error(
            f"several numbers in one field, {quote_word(lists[0])}, are no levels and rates;"
            " OpenQuake before its version 2 wrote curves so, without their levels: export them"
            " with a later one",
            table.line,
        )
    if row and not table.heads:
        raise table.text.error(
            "a line with the names of the columns was expected, got"
            f" {quote_word(table.text.lines[row.line - 1])}",
            row.line,
        )
    levels = _choose_levels(table, measure)
    column, frequency = _choose_frequency(table)
    if len(table.rows) < 2:
        raise table.text.error(
            "at least two lines of a level and a rate below their names were expected, got"
            f" {len(table.rows)}"
        )
    points: list[tuple[int, float, float]] = []
    for row in table.rows:
        if len(row.cells) != len(table.heads):
            raise table.error_of_width(row)
        level = read_number(table, row, levels)
        points.append((row.line, level, read_number(table, row, column)))
    head = table.heads[levels]
    return Curve(head, frequency, points, f"the head states {head.words!r}")


def _choose_levels(table: Table, measure: str | None) -> int:
    """Choose the column of levels."""
    levels = {
        k: head.quantity
        for k, head in enumerate(table.heads)
        if head.quantity in ("pga", "pgv", "level")
        and _match_name(head, head.quantity)
        and len(head.units) < 2
    }
    # A column that names its measure is meant, whatever else might be one of levels.
    named = [k for k, quantity in levels.items() if quantity != "level"]
    chosen = [k for k in named if levels[k] == measure] or named or [*levels]
    if len(chosen) != 1:
        raise table.text.error(
            f"one column must be pgv or pga with its unit, as in {_EXAMPLE}, got {len(chosen)} of"
            f" them in {quote_names(table.names)}",
            table.line,
        )
    return chosen[0]


def _choose_frequency(table: Table) -> tuple[int, Frequency]:
    """Choose the column that says how often levels are exceeded."""
    columns = [(k, _parse_frequency(head)) for k, head in enumerate(table.heads)]
    known = [(k, frequency) for k, frequency in columns if frequency is not None]
    if len(known) != 1:
        raise table.text.error(
            f"one column must be a rate of exceedance per year, as in {_EXAMPLE}, or a probability"
            " of exceedance in a number of years, or a return period [yr], got"
            f" {len(known)} of them in {quote_names(table.names)}",
            table.line,
        )
    return known[0]


def _parse_frequency(head: Head) -> Frequency | None:
    """Parse the head of a column that states how often levels are exceeded; None if none."""
    if len(head.units) > 1:
        return None
    # Frequencies may be those of spectra to the head, but none per year.
    unit = parse_unit(head.units[0].words) if head.units else None
    dimension = unit.dimension if unit else None
    factor = unit.factor if unit else 1.0
    if _match_name(head, "rate") and dimension in ("rate", None):
        return Frequency("rate", factor=factor)
    # In years, or it may be in anything.
    if _match_name(head, "return period") and (
        dimension == "years" or re.search(r"\bin years$", head.name, re.I)
    ):
        return Frequency("return period")
    match = _match_name(head, "probability")
    if match is None or dimension not in ("ratio", None):
        return None
    # In how many years must be said, and only once.
    spans = [match["years"], (match["annual"] or match["yearly"]) and "1"]
    years = [float(span) for span in spans if span]
    if len(years) != 1 or not years[0]:
        return None
    return Frequency("probability", years[0], factor)


def _match_name(head: Head, quantity: str) -> re.Match[str] | None:
    """Match all of the name of a column with the names of a quantity."""
    return re.fullmatch(QUANTITIES[quantity].names, head.name, re.I) if head.name else None


def _is_list(cell: str) -> bool:
    """Return whether a cell holds several numbers."""
    words = cell.split()
    return len(words) > 1 and all(as_number(word) is not None for word in words)


def _refuse_comments(table: Table, curve: Curve) -> None:
    """Refuse comments that name something else than the columns hold."""
    for line, comment in table.notes:
        words = re.findall(r"[^\W\d_]+", comment)
        # Below a name that is clear the comment may be about other columns.
        if curve.head.quantity == "level" and _match_any(_OTHER_MEASURES, words):
            other = "another measure than pga or pgv"
        elif curve.frequency.kind == "rate" and _match_any(
            QUANTITIES["probability"].words, words
        ):
            other = "a probability above a column of rates"
        else:
            continue
        raise table.text.error(f"a comment names {other}, got {quote_word(comment)}", line)


def _match_any(pattern: str, words: list[str]) -> bool:
    """Return whether a word matches a pattern, in upper or lower case."""
    return any(re.fullmatch(pattern, word, re.I) for word in words)


def _choose_measure(table: Table, head: Head, measure: str | None) -> str:
    """Choose the measure that the name of levels, a comment above it or the caller states."""
    # A name that says nothing, like level [g], may be of spectral accelerations.
    stated = {head.quantity} & {*HAZARD_MEASURES} or {
        key
        for _, comment in table.notes
        for key, pattern in _IN_COMMENT.items()
        if re.search(pattern, comment, re.I)
    }
    if len(stated) != 1 and measure is None:
        raise table.text.error(
            "the head does not say which measure the levels are of, so that measure must be"
            f" given, got {head.words!r}",
            table.line,
        )
    if len(stated) == 1 and measure not in (None, *stated):
        raise table.text.error(
            f"a hazard of {measure} was expected, got one of {stated.pop()}: {head.words!r}",
            table.line,
        )
    return measure or stated.pop()


def _choose_unit(table: Table, curve: Curve, unit: str | None, measure: str) -> float:
    """Choose the unit of levels that their name or the caller states; its value in SI."""
    head = curve.head
    chosen = head.unit
    if unit is not None:
        # A unit of the caller may repeat the one in the head, but not contradict it.
        given = parse_unit(str(unit))
        if chosen and not (
            chosen.dimension == given.dimension and math.isclose(chosen.factor, given.factor)
        ):
            raise table.text.error(f"unit is {unit!r}, but {curve.reason}", table.line)
        chosen = given
    if chosen is None:
        raise table.text.error(
            f"the head states no unit, so that unit must be given, got {head.words!r}",
            table.line,
        )
    if chosen.dimension not in QUANTITIES[measure].dimensions:
        raise table.text.error(
            f"{chosen.words!r} is not understood as a unit of {measure}, got {head.words!r}",
            table.line,
        )
    return chosen.factor


def _check_points(table: Table, curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Convert what a table states to rates; an error names the first line that is wrong."""
    # Some tables begin with the highest level.
    order = -1 if curve.points[0][1] > curve.points[-1][1] else 1
    points = curve.points[::order]
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
    return levels[possible], rates[possible]
