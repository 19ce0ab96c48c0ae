"""Hazard curves from files: what the head of a table states of levels and rates.

OpenQuake's engine 3 has a line for each site, names the columns of levels ``poe-0.005``, and states
measure, years and kind of curve in its first line (https://github.com/gem/oq-engine,
openquake/calculators/export/hazard.py).
"""

import os
import re
from collections.abc import Sequence

import numpy as np

from ..tables import (
    Column,
    Head,
    Row,
    Table,
    TextFile,
    Unit,
    as_number,
    parse_unit,
    quote_names,
    quote_word,
    read_columns,
)
from ..validation import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL
from .hazard import HAZARD_MEASURES, Hazard, as_hazard_measure

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
# OpenQuake has these units, which no field of its files states.
_CONVENTIONS = {"pga": "g", "pgv": "cm/s"}
_FIELD = re.compile(r"(kind|investigation_time|imt)='?([^',;\"]*)")
_PREFIX = "poe-"
_ABOUT_SITES = ("custom site id", "lon", "lat", "depth", "vs30")
# Measure, statistic, unit of the levels, levels in SI, and their rates [1/yr].
_Curve = tuple[str, str, Unit, np.ndarray, np.ndarray]


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
    unit : str, optional
        Unit of the levels, where the head does not state it: ``"cm/s"``, ``"g"`` and so on,
        as in `read_record`. OpenQuake has PGA in g and PGV in cm/s.
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
        -ln(1 - P) / T. The lowest levels, where P is printed as 1, are left out, and so are
        the highest ones, where the rate is printed as 0.

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
    text = TextFile(path)
    table = Table(text, lambda heads: _has_sites(heads) or _has_levels(heads), _EXPECTED)
    if _has_sites(table.heads):
        curve = _read_site(table, measure, given, statistic, site)
    elif site is not None:
        raise text.error(f"site goes with a table of several sites only, got {site}")
    else:
        curve = _read_levels(table, measure, given, statistic or "")
    measure, statistic, stated, levels, rates = curve
    # Some tables begin with the highest level.
    if levels[0] > levels[-1]:
        levels, rates = levels[::-1], rates[::-1]
    # The lowest levels may be certain to be exceeded, at no finite rate, and the rates of the
    # highest ones are printed as 0: what is known ends before.
    (known,) = np.nonzero((rates > 0) & (rates < np.inf))
    kept = slice(known[0], known[-1] + 1) if known.size else slice(None)
    try:
        return Hazard(levels[kept], rates[kept], measure, statistic, stated.spelling)
    except ValueError as error:
        raise text.error(str(error)) from None


def _list_names(heads: Sequence[Head]) -> list[str]:
    """List the names of columns; some versions of OpenQuake write their type behind a colon."""
    return [head.name.lower().partition(":")[0] for head in heads]


def _has_sites(heads: Sequence[Head]) -> bool:
    """Return whether these are the heads of a table with a line for each site."""
    return {"lon", "lat"} <= {*_list_names(heads)}


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
    return (kind, 1.0) if kind in ("rate", "return period") else None


def _read_levels(
    table: Table, measure: str | None, unit: Unit | None, statistic: str
) -> _Curve:
    """Read a table with a line for each level."""
    names = [head.name.lower() for head in table.heads]
    allowed = ("", *(HAZARD_MEASURES if measure is None else (measure,)))
    levels = [k for k, name in enumerate(names) if _MEASURES.get(name) in allowed]
    frequencies = [k for k, name in enumerate(names) if _find_frequency(name)]
    if len(levels) != 1 or len(frequencies) != 1:
        heads = quote_names(head.label for head in table.heads)
        expected = f"one column of levels of {measure or 'pga or pgv'}, and one of rates,"
        raise table.error(f"{expected} return periods or probabilities, got {heads}")
    level, frequency = levels[0], frequencies[0]
    head = table.heads[level]
    label = quote_word(head.label)
    measure = measure or _MEASURES[names[level]]
    if not measure:
        raise table.error(f"measure must be given, 'pga' or 'pgv', since {label} states none")
    stated = head.unit or unit
    if not stated or (unit and stated[1:] != unit[1:]):
        got = f"got {unit.spelling!r}" if unit else "got none"
        example = f"such as {_CONVENTIONS[measure]!r}"
        raise table.error(f"unit must be given for {label}, {example}, {got}")
    table.heads[level] = head._replace(unit=stated)
    kind, years = _find_frequency(names[frequency]) or ("", 0.0)
    if kind == "probability" and not table.heads[frequency].unit:
        raise table.error(f"write {names[frequency]!r} with [%], or [-] for a fraction")
    columns = {names[level]: _LEVELS[measure], names[frequency]: _FREQUENCIES[kind]}
    in_si, values = read_columns(table, columns).values.values()
    if kind == "probability":
        values = _convert_probability(values, years)
    elif kind == "return period":
        values = 1 / values
    return measure, statistic, stated, in_si, values


def _convert_probability(probability: np.ndarray, years: float) -> np.ndarray:
    """Convert the probability in a number of years to a rate [1/yr]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return -np.log1p(-probability) / years


def _read_site(
    table: Table,
    measure: str | None,
    unit: Unit | None,
    statistic: str | None,
    site: tuple[float | int, float | int] | None,
) -> _Curve:
    """Read the curve of a site from a table of OpenQuake."""
    text = table.text
    names = _list_names(table.heads)
    columns = [k for k, name in enumerate(names) if name not in _ABOUT_SITES]
    levels = [as_number(names[k].partition(_PREFIX)[2]) for k in columns]
    if not levels or None in levels:
        raise table.error(f"columns of levels were expected, such as {_PREFIX}0.1")
    fields = dict(_FIELD.findall(text.lines[0].lower()))
    years = as_number(fields.get("investigation_time", "")) or 0.0
    stated = fields.get("imt", ""), fields.get("kind", "")
    if stated[0] not in _CONVENTIONS or stated[1] == "std" or not years > 0:
        raise text.error(
            "its first line must state an investigation_time, an imt of PGA or PGV, and a kind"
            f" that is no standard deviation, got {fields}"
        )
    stated_unit = parse_unit(_CONVENTIONS[stated[0]])
    given = (measure or stated[0], statistic or stated[1], (unit or stated_unit)[1:])
    if given != (*stated, stated_unit[1:]):
        found = f"{' '.join(stated)} in {stated_unit.spelling}"
        raise text.error(f"the first line states {found}, another one is given")
    row = _choose_row(table, site, [names.index("lon"), names.index("lat")])
    values = np.array([table.require_number(row, k) for k in columns])
    rates = _convert_probability(values, years)
    return *stated, stated_unit, stated_unit.factor * np.array(levels, float), rates


def _choose_row(
    table: Table, site: tuple[float | int, float | int] | None, columns: Sequence[int]
) -> Row:
    """Choose the line of the site, or the only one."""
    points = np.array([[table.require_number(row, k) for k in columns] for row in table.rows])
    near = np.ones(len(points), bool)
    if site is not None:
        # Coordinates are printed with four or five digits: to about 10 m.
        near = np.isclose(points, site, rtol=0, atol=1e-4).all(axis=1)
    if near.sum() != 1:
        listed = ", ".join(f"{lon:g} {lat:g}" for lon, lat in points[:5])
        got = "none" if site is None else f"{site[0]:g} {site[1]:g}"
        raise table.text.error(
            f"site must be the longitude and latitude of one of its {len(points)} curves, such"
            f" as {listed}, got {got}"
        )
    return table.rows[int(near.argmax())]
