"""Hazard curves from files: what the head of a table states of levels and rates."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..tables import (
    Column,
    Head,
    Table,
    TextFile,
    Unit,
    as_number,
    parse_unit,
    quote_names,
    quote_word,
    read_columns,
)
from ..validation import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, check
from .hazard import HAZARD_MEASURES, Hazard, as_hazard_measure
from .hazard_sites import CONVENTIONS, Curve, has_sites, read_site

# Names of columns of levels, and the measure that each states.
_MEASURES = {"pga": "pga", "ag": "pga", "pgv": "pgv", "vg": "pgv", "level": ""}
_LEVELS = {
    "pga": Column("acceleration", POSITIVE, required=True),
    "pgv": Column("velocity", POSITIVE, required=True),
}
_FREQUENCIES = {
    "rate": Column("rate", NON_NEGATIVE, required=True),
    "return period": Column("years", POSITIVE, required=True),
    "probability": Column("ratio", UNIT_INTERVAL, required=True),
}
_PROBABILITY = re.compile(r"(probability|poe)( of exceedance)? in ([\d.]+) (\w+)")
_EXPECTED = (
    "a line with columns such as 'pga [g]' or 'pgv [m/s]', and 'rate [1/yr]', 'return period"
    " [yr]' or 'probability in 50 years [%]',"
)


def read_hazard(
    path: str | os.PathLike[str],
    *,
    unit: str | None = None,
    measure: str | None = None,
    site: tuple[float | int, float | int] | None = None,
    statistic: str | None = None,
) -> Hazard:
    r"""Read a hazard curve from a text file, as .csv.

    Parameters
    ----------
    path : str or path
        A table of one of these kinds, separated by commas, semicolons or tabs. Lines that begin
        with # are comments.

        - A line for each level, rising or falling. A column has the levels, ``pga [g]`` (also
          ``ag``), ``pgv [m/s]`` (also ``vg``) or ``level [g]``; another one has the ``rate
          [1/yr]`` of exceedance, the ``return period [yr]`` (also ``TR``), or the ``probability
          in 50 years [%]`` (of any number of years; also ``probability of exceedance in`` or
          ``poe in``). Other columns are ignored.
        - OpenQuake's ``hazard_curve-mean-PGA_1.csv`` and the like, of engine 3.
        - Curves of USGS's nshmp-haz, such as ``PGA/curves.csv``; `measure` and `unit` have to be
          given. The values are assumed to be annual rates, the default of nshmp-haz.
    unit : str, optional
        Unit of the levels, where the head does not state it: ``"cm/s"``, ``"g"`` and so on,
        as in `read_record`. OpenQuake and nshmp-haz have PGA in g and PGV in cm/s.
    measure : {"pgv", "pga"}, optional
        The measure that the curve must have. It chooses a column if there are several, and is
        needed where the file states none: ``level [g]`` may be spectral acceleration.
    site : pair of float, optional
        Longitude and latitude of one of several sites [degrees], to 1e-4.
    statistic : str, optional
        Which curve of a logic tree it is, such as ``"mean"``, where the file does not state it;
        OpenQuake's does.

    Returns
    -------
    Hazard
        Levels in m/s or m/s2. A probability P in T years is converted to the rate
        -ln(1 - P) / T. The lowest levels, where P is printed as 1, are left out.

    Raises
    ------
    ValueError
        With the file, if it cannot be read, holds no hazard curve or one of another measure, or
        is not understood; if it states something else than an argument; or if neither states
        the measure or the unit.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "hazard.csv"
    ...     _ = path.write_text("PGA [g],return period [yr]\n0.1,100\n1,10000\n")
    ...     print(jr.risk.read_hazard(path))
    hazard of pga from 0.01 1/yr at 0.1 g to 0.0001 1/yr at 1 g
    """
    measure = as_hazard_measure(measure)
    given = None if unit is None else parse_unit(unit)
    if given and given.dimension not in ("acceleration", "velocity"):
        raise ValueError(f"unit must be one like 'm/s', 'cm/s', 'm/s2' or 'g', got {unit!r}")
    text = TextFile(Path(path))
    table = Table(text, lambda heads: has_sites(heads) or _has_levels(heads), _EXPECTED)
    if has_sites(table.heads):
        curve = read_site(table, site, measure, given, statistic)
    elif site is not None:
        raise text.error(f"site goes with a table of several sites only, got {site}")
    else:
        curve = _read_levels(table, measure, given, statistic or "")
    try:
        levels, rates = _convert(curve)
        return Hazard(levels, rates, curve.measure, curve.statistic, curve.unit)
    except ValueError as error:
        raise text.error(str(error)) from None


def _convert(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Convert a curve to rising levels and their rates [1/yr]."""
    rates = curve.values
    if curve.kind == "return period":
        rates = 1 / rates
    elif curve.kind == "probability":
        check("probability", rates, UNIT_INTERVAL)
        with np.errstate(divide="ignore"):
            rates = -np.log1p(-rates) / curve.years
    # Some tables begin with the highest level.
    order = -1 if curve.levels[0] > curve.levels[-1] else 1
    rates = rates[::order]
    # The lowest levels may be certain to be exceeded, at no finite rate.
    first = int(np.argmax(rates < np.inf))
    return curve.levels[::order][first:], rates[first:]


def _has_levels(heads: Sequence[Head]) -> bool:
    """Return whether these are the heads of a table with a line for each level."""
    names = [head.name.lower() for head in heads]
    return any(map(_find_frequency, names)) and not _MEASURES.keys().isdisjoint(names)


def _find_frequency(name: str) -> tuple[str, float] | None:
    """Find what a column has that states how often levels are exceeded, and in how many years."""
    match = _PROBABILITY.fullmatch(name)
    if match and parse_unit(match[4]).dimension == "years":
        years = as_number(match[3])
        return ("probability", years) if years else None
    kind = "return period" if name == "tr" else name
    return (kind, 1.0) if kind in _FREQUENCIES and kind != "probability" else None


def _read_levels(
    table: Table, measure: str | None, unit: Unit | None, statistic: str
) -> Curve:
    """Read a table with a line for each level."""
    names = [head.name.lower() for head in table.heads]
    allowed = ("", *(HAZARD_MEASURES if measure is None else (measure,)))
    levels = [k for k, name in enumerate(names) if _MEASURES.get(name) in allowed]
    level = _choose_column(table, levels, f"levels of {measure or 'pga or pgv'}")
    often = [k for k, name in enumerate(names) if _find_frequency(name)]
    frequency = _choose_column(table, often, "rates, return periods or probabilities")
    head = table.heads[level]
    label = quote_word(head.label)
    measure = measure or _MEASURES[names[level]]
    if not measure:
        raise table.error(f"measure must be given, 'pga' or 'pgv', since {label} states none")
    stated = head.unit or unit
    if not stated:
        example = CONVENTIONS[measure]
        raise table.error(
            f"unit must be given, such as {example!r}, since {label} states none"
        )
    if head.unit and unit and head.unit[1:] != unit[1:]:
        raise table.error(f"unit is {unit.spelling!r}, but the head states {label}")
    table.heads[level] = head._replace(unit=stated)
    kind, years = _find_frequency(names[frequency]) or ("", 0.0)
    if kind == "probability" and not table.heads[frequency].unit:
        raise table.error(f"write {names[frequency]!r} with [%], or [-] for a fraction")
    columns = {names[level]: _LEVELS[measure], names[frequency]: _FREQUENCIES[kind]}
    values = read_columns(table, columns).values
    rows = (values[names[level]], kind, values[names[frequency]], years)
    return Curve(measure, statistic, *rows, stated.spelling)


def _choose_column(table: Table, columns: Sequence[int], what: str) -> int:
    """Choose the only column of a kind."""
    if len(columns) != 1:
        heads = quote_names(head.label for head in table.heads)
        raise table.error(f"one column of {what} was expected, got {len(columns)} in {heads}")
    return columns[0]
