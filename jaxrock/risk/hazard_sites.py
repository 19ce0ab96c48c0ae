"""Tables of hazard curves with a line for each site and a column for each level."""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..host import Row, TextTable, is_number
from .hazard_columns import Frequency, Levels, Points, find_units

# The unit of levels is no part of these files, but the convention of the programs: OpenQuake's
# hazard library and USGS's nshmp-haz both take PGA in g and PGV in cm/s.
_CONVENTIONS = {"pga": "g", "pgv": "cm/s"}
# Columns beside those of levels.
_ABOUT_SITES = r"custom_site_id|site_id|id|name|lon|lat|longitude|latitude|depth|vs30"
_PLACE = ((r"lon(?:gitude)?", 360.0), (r"lat(?:itude)?", 90.0))
_NEAR = 1e-4  # degrees, about 10 m: coordinates are printed with four or five digits
_POE = "poe-"


def has_sites(names: Sequence[str]) -> bool:
    """Tell by its columns whether a table has a line for each site."""
    return any(re.fullmatch(_PLACE[0][0], name, re.I) for name in names) and any(
        name.startswith(_POE) or is_number(name) for name in names
    )


def read_site(
    table: TextTable, site: tuple[float | int, float | int] | None, measure: str | None
) -> Points:
    """Read the curve of a site from a table of OpenQuake or of USGS's nshmp-haz."""
    number, _, names = table.rows[0]
    prefix = _POE if any(name.startswith(_POE) for name in names) else ""
    places = {}
    for k, name in enumerate(names):
        if name.startswith(prefix) and is_number(word := name.removeprefix(prefix)):
            places[k] = float(word)
        else:
            unknown = not re.fullmatch(_ABOUT_SITES, name, re.I)
            table.refuse(unknown, f"column {name!r:.60} is not understood", number)
    row = _choose_row(table, site)
    for k in places:
        must = f"column {names[k]!r} must be a number, got {row[2][k]!r:.60}"
        table.refuse(not is_number(row[2][k]), must, row[0])
    table.refuse_cut(row, len(names) - 1, [row[2][k] for k in [*places][:-1]])
    if prefix:
        level, frequency = _read_comments(table)
    else:
        level, frequency = _find_measure(table, measure), Frequency("rate")
    values = [float(row[2][k]) for k in places]
    lines = [row[0]] * len(places)
    return Points(level, frequency, lines, np.array([*places.values()]), np.array(values))


def _choose_row(table: TextTable, site: tuple[float | int, float | int] | None) -> Row:
    """Choose the line of the site, or the only one."""
    (_, _, names), *rows = table.rows
    near = []
    for row in rows:
        must = f"{len(names)} fields were expected, as many as names"
        table.refuse(len(row[2]) != len(names), f"{must}, got {len(row[2])}", row[0])
        place = _find_place(table, names, row)
        if site is None or np.allclose(place, site, rtol=0, atol=_NEAR):
            near.append(row)
    must = "site must be given, the longitude and latitude of one"
    if site is not None:
        must = f"one of them with longitude and latitude {site} was expected"
    found = f"{len(rows)} curves, {len(near)} of them there"
    table.refuse(len(near) != 1, f"{must}, got {found if site else len(rows)}")
    return near[0]


def _find_place(table: TextTable, names: Sequence[str], row: Row) -> list[float]:
    """Find longitude and latitude of a line."""
    place = []
    for pattern, most in _PLACE:
        found = [
            row[2][k] for k, name in enumerate(names) if re.fullmatch(pattern, name, re.I)
        ]
        wrong = len(found) != 1 or not is_number(found[0]) or not abs(float(found[0])) <= most
        must = "one longitude and one latitude in degrees were expected"
        table.refuse(wrong, f"{must}, got {found!r:.60}", row[0])
        place.append(float(found[0]))
    return place


def _read_comments(table: TextTable) -> tuple[Levels, Frequency]:
    """Read the measure, and in how many years probabilities are, from OpenQuake's comment."""
    said = {}
    for key in ("imt", "investigation_time"):
        found = {
            value.strip(" '\"")
            for _, line, _ in table.comments
            for value in re.findall(rf"\b{key}\s*=([^,]*)", line)
        }
        must = f"one {key} was expected in a comment above, as OpenQuake writes it"
        table.refuse(len(found) != 1, f"{must}, got {len(found)}")
        said[key] = found.pop()
    years = said["investigation_time"]
    wrong = not is_number(years) or not 0 < float(years) < math.inf
    table.refuse(wrong, f"investigation_time must be greater than 0, got {years!r:.60}")
    measure = said["imt"].lower()
    must = "a hazard of pga or pgv was expected"
    table.refuse(measure not in _CONVENTIONS, f"{must}, got one of {said['imt']!r:.60}")
    return _follow_convention("OpenQuake", measure), Frequency("probability", float(years))


def _find_measure(table: TextTable, measure: str | None) -> Levels:
    """Find the measure of a table of nshmp-haz, which only its folder or its name may state."""
    # PGA/curves.csv, or PGA.csv.
    path = Path(table.path).absolute()
    stated = {
        word.lower()
        for name in (path.parent.name, path.stem)
        for word in re.findall(r"(?<![a-z])(?:pga|pgv|sa\d+p\d+)(?![a-z])", name, re.I)
    }
    names = ", ".join(sorted(stated))
    must = "a hazard of pga or pgv was expected"
    table.refuse(
        len(stated) > 1 or not stated <= {*_CONVENTIONS}, f"{must}, got one of {names}"
    )
    silent = "neither the table nor its folder names the measure"
    must = "measure and unit must be given"
    table.refuse(not stated and measure is None, f"{silent}, so that {must}")
    # Without a unit the caller has to state one.
    if not stated:
        return Levels("level", set(), "", [], "")
    return _follow_convention("nshmp-haz", stated.pop())


def _follow_convention(program: str, measure: str) -> Levels:
    """Describe levels in the unit that a program has for their measure."""
    unit = _CONVENTIONS[measure]
    name = f"{measure.upper()} [{unit}]"
    reason = f"{program} has {measure.upper()} in {unit} by its convention"
    return Levels(name, {measure}, *find_units(unit), reason)
