"""Tables of hazard curves with a line for each site and a column for each level.

OpenQuake's engine 3 names the columns of levels ``poe-0.005``, and states measure, years and kind
of curve in its first line (https://github.com/gem/oq-engine,
openquake/calculators/export/hazard.py). USGS's nshmp-haz names them ``0.005``
(https://github.com/usgs/nshmp-haz, HazardExport.java).
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..tables import Head, Row, Table, Unit, as_number, parse_unit, quote_word
from ..validation import POSITIVE

# Both programs have these units, which no field of theirs states.
CONVENTIONS = {"pga": "g", "pgv": "cm/s"}
_FIELD = re.compile(r"(kind|investigation_time|imt)='?([^',;\"]*)")
_PREFIX = "poe-"
_ABOUT_SITES = ("name", "custom site id", "site id", "lon", "lat", "depth", "vs30")
_NEAR = 1e-4  # degrees, about 10 m: coordinates are printed with four or five digits
_MAX_PLACES = 5  # that a message lists


class Curve(NamedTuple):
    """A curve as a file has it.

    `levels` are in SI; `values` are rates, return periods or probabilities in a number of years,
    as `kind` says.
    """

    measure: str
    statistic: str
    levels: np.ndarray
    kind: str
    values: np.ndarray
    years: float
    unit: str


def has_sites(heads: Sequence[Head]) -> bool:
    """Return whether these are the heads of a table with a line for each site."""
    return {"lon", "lat"} <= {*_list_names(heads)}


def read_site(
    table: Table,
    site: tuple[float | int, float | int] | None,
    measure: str | None,
    unit: Unit | None,
    statistic: str | None,
) -> Curve:
    """Read the curve of a site from a table of OpenQuake or of nshmp-haz."""
    names = _list_names(table.heads)
    places = [k for k, name in enumerate(names) if name not in _ABOUT_SITES]
    is_openquake = any(names[k].startswith(_PREFIX) for k in places)
    levels = [_read_level(table, names[k], _PREFIX if is_openquake else "") for k in places]
    fields = dict(_FIELD.findall(table.text.lines[0])) if is_openquake else {}
    measure = _choose(table, "measure", measure, fields.get("imt", "").lower())
    if measure not in CONVENTIONS:
        got = repr(measure) if measure else "none"
        raise table.text.error(f"measure must be given, as 'pga' or 'pgv', got {got}")
    statistic = _choose(table, "statistic", statistic, fields.get("kind", ""))
    if statistic == "std":
        raise table.text.error(
            "a hazard curve was expected, got standard deviations: take the mean or a quantile"
        )
    convention = parse_unit(CONVENTIONS[measure])
    if not (is_openquake or unit):
        raise table.text.error("unit must be given, 'g' for pga or 'cm/s' for pgv")
    if unit and unit[1:] != convention[1:]:
        raise table.text.error(
            f"unit is {unit.spelling!r}, but {measure} is in {convention.spelling} in such files"
        )
    years = as_number(fields.get("investigation_time", "")) if is_openquake else 1.0
    if years is None or not POSITIVE.contains(np.asarray(years)):
        raise table.text.error("investigation_time must be stated in the first line, in years")
    row = _choose_row(table, site, [names.index("lon"), names.index("lat")])
    values = np.array([table.require_number(row, k) for k in places])
    kind = "probability" if is_openquake else "rate"
    in_si = convention.factor * np.array(levels)
    return Curve(measure, statistic, in_si, kind, values, years, convention.spelling)


def _list_names(heads: Sequence[Head]) -> list[str]:
    """List the names of columns; some versions of OpenQuake write their type behind a colon."""
    return [head.name.lower().partition(":")[0] for head in heads]


def _read_level(table: Table, name: str, prefix: str) -> float:
    """Read the level of a column from its name."""
    level = as_number(name.removeprefix(prefix)) if name.startswith(prefix) else None
    if level is None:
        raise table.error(
            f"columns of levels were expected, {prefix}0.1, got {quote_word(name)}"
        )
    return level


def _choose(table: Table, name: str, given: str | None, stated: str) -> str:
    """Choose what the caller gives or a field states; if both do, they must agree."""
    if given and stated and given != stated:
        raise table.text.error(f"{name} is {given!r}, but the first line states {stated!r}")
    return stated or given or ""


def _choose_row(
    table: Table, site: tuple[float | int, float | int] | None, columns: Sequence[int]
) -> Row:
    """Choose the line of the site, or the only one."""
    if site is not None and np.shape(site) != (2,):
        raise ValueError(f"site must be a longitude and a latitude, got {site!r}")
    places = [[table.require_number(row, k) for k in columns] for row in table.rows]
    near = [
        row
        for row, place in zip(table.rows, places, strict=True)
        if site is None or np.allclose(place, site, rtol=0, atol=_NEAR)
    ]
    if len(near) != 1:
        listed = ", ".join(f"{place[0]:g} {place[1]:g}" for place in places[:_MAX_PLACES])
        got = "none" if site is None else f"{site[0]:g} {site[1]:g}"
        raise table.text.error(
            f"site must be the longitude and latitude of one of its {len(places)} curves, such"
            f" as {listed}, got {got}"
        )
    return near[0]
