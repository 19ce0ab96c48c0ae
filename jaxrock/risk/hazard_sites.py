"""Tables of hazard curves with a line for each site and a column for each level.

OpenQuake's engine 3 names the columns ``poe-0.005``, engine 2 ``PGA-0.005`` with all measures in
one file (https://github.com/gem/oq-engine, openquake/calculators/export/hazard.py), and USGS's
nshmp-haz ``0.005`` (https://github.com/usgs/nshmp-haz, HazardExport.java).
"""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..oldtables import Row, Table, Unit, as_number, parse_unit, quote_names, quote_word
from .hazard_notes import find_measures

# The unit of levels is no part of these files: both programs take PGA in g and PGV in cm/s.
_CONVENTIONS = {"pga": "g", "pgv": "cm/s"}
_ABOUT_SITES = r"custom_site_id|site_id|id|name|lon|lat|longitude|latitude|depth|vs30"
_LIMITS = {"longitude": 360.0, "latitude": 90.0}
_MAX_PLACES = 5  # that a message lists
_NEAR = 1e-4  # degrees, about 10 m: coordinates are printed with four or five digits
# Some versions of OpenQuake write the type of a column behind its name.
_LEVEL = (
    r"(?:(?P<kind>poe|pg[avd]|(?:avg)?sa(?:\([\d.]+\))?|ia|cav|rsd\d*|mmi|[avd]si)-)?"
    r"(?P<level>[\d.]+(?:e[-+]?\d+)?)(?::float\d\d)?"
)


class Levels(NamedTuple):
    """A column of levels: its name, and its measure and unit if they are stated by `source`."""

    name: str
    measure: str
    unit: Unit | None
    source: str


class Frequency(NamedTuple):
    """A column of how often levels are exceeded: a rate, probability or return period."""

    kind: str
    name: str = ""
    years: float = 1.0  # of a probability
    factor: float = 1.0  # 0.01 for one in per cent

    @property
    def allowed(self) -> str:
        """The values that it may have, in words."""
        if self.kind == "probability":
            return "from 0 to 100 %" if self.factor < 1 else "from 0 to 1"
        return "finite and at least 0" if self.kind == "rate" else "greater than 0"

    def convert(self, value: float) -> float:
        """Convert a value to a rate [1/yr]; NaN if it is not possible, inf at probability 1."""
        value = self.factor * value
        if self.kind == "probability":
            if value == 1:
                return math.inf
            return -math.log1p(-value) / self.years if 0 <= value < 1 else math.nan
        if not 0 <= value < math.inf:
            return math.nan
        if self.kind == "return period":
            return 1 / value if value else math.nan
        return value


class Curve(NamedTuple):
    """A curve as it is printed.

    `points` are lines of the file, levels and values; `notes` all that is said beside the columns,
    with its line, or 0 for the path; `part` names one part of the hazard.
    """

    levels: Levels
    frequency: Frequency
    points: list[tuple[int, float, float]]
    notes: list[tuple[int, str]]
    part: str = ""


def has_sites(table: Table) -> bool:
    """Return whether a table has a line for each site, by its columns."""
    names = [name.lower().partition(":")[0] for name in table.names]
    return bool({"lon", "longitude"} & {*names}) and any(
        re.fullmatch(_LEVEL, name) for name in names
    )


def read_site(
    table: Table, site: tuple[float | int, float | int] | None, measure: str | None
) -> Curve:
    """Read the curve of a site from a table of OpenQuake or of USGS's nshmp-haz."""
    columns: dict[str, list[tuple[int, float]]] = {}
    for k, name in enumerate(table.names):
        match = re.fullmatch(_LEVEL, name, re.I)
        level = as_number(match["level"]) if match else None
        if match and level is not None:
            columns.setdefault((match["kind"] or "").lower(), []).append((k, level))
        elif not re.fullmatch(_ABOUT_SITES, name.partition(":")[0], re.I):
            raise table.text.error(f"column {quote_word(name)} is not understood", table.line)
    row = _choose_row(table, site)
    words_of_path = table.text.path.stem
    part = ""
    kind = ""
    if [*columns] == [kind]:
        levels, words_of_path, part = _describe_nshmp(table.text.path.absolute())
        frequency = Frequency("rate")
    else:
        kind, levels = _choose_kind(table, [*columns], measure)
        words = _read_statement(table, "investigation_time")
        years = as_number(words)
        if years is None or not 0 < years < math.inf:
            raise table.text.error(f"investigation_time must be greater than 0, got {words!r}")
        frequency = Frequency("probability", years=years)
    points = [(row.line, level, read_number(table, row, k)) for k, level in columns[kind]]
    return Curve(levels, frequency, points, [*table.notes, (0, words_of_path)], part)


def read_number(table: Table, row: Row, column: int) -> float:
    """Read a number of a row; an error if it is none, or if the row has not all cells."""
    if len(row.cells) != len(table.names):
        raise table.error_of_width(row)
    number = table.parse_number(row, column)
    if number is None:
        name = quote_word(table.names[column])
        cell = quote_word(row.cells[column])
        raise table.text.error(f"column {name} must be a number, got {cell}", row.line)
    return number


def _choose_row(table: Table, site: tuple[float | int, float | int] | None) -> Row:
    """Choose the line of the site, or the only one."""
    near: list[Row] = []
    places: list[str] = []
    for row in table.rows:
        place = [_read_degrees(table, row, name) for name in _LIMITS]
        places.append(f"{place[0]:g} {place[1]:g}")
        if site is None or np.allclose(place, site, rtol=0, atol=_NEAR):
            near.append(row)
    if len(near) == 1:
        return near[0]
    listed = ", ".join(places[:_MAX_PLACES])
    if len(places) > _MAX_PLACES:
        listed += f" and {len(places) - _MAX_PLACES} more"
    if site is None:
        raise table.text.error(
            "site must be given, the longitude and latitude of one of its"
            f" {len(places)} curves: {listed}"
        )
    raise table.text.error(
        f"site must be the longitude and latitude of one of its {len(places)} curves, {listed},"
        f" got {site[0]:g} {site[1]:g}, which matches {len(near)} of them"
    )


def _read_degrees(table: Table, row: Row, name: str) -> float:
    """Read the longitude or latitude of a line."""
    short = [word.lower().partition(":")[0] for word in table.names]
    columns = [k for k, word in enumerate(short) if word in (name, name[:3])]
    if len(columns) != 1:
        raise table.text.error(f"one {name} was expected, got {len(columns)}", table.line)
    value = read_number(table, row, columns[0])
    if not abs(value) <= _LIMITS[name]:
        raise table.text.error(
            f"a {name} must be within {_LIMITS[name]:g} degrees, got {value:g}", row.line
        )
    return value


def _follow_convention(program: str, measure: str) -> Levels:
    """Describe levels in the unit that a program has for their measure."""
    unit = _CONVENTIONS[measure]
    name = measure.upper()
    return Levels(name, measure, parse_unit(unit), f"{program} has {name} in {unit}")


def _choose_kind(table: Table, kinds: list[str], measure: str | None) -> tuple[str, Levels]:
    """Choose columns by what stands before their levels."""
    if kinds == ["poe"]:
        imt = _read_statement(table, "imt")
        if imt.lower() not in _CONVENTIONS:
            raise table.text.error(f"a hazard of pga or pgv was expected, got one of {imt!r}")
        return "poe", _follow_convention("OpenQuake", imt.lower())
    # In maps of hazard the same columns hold accelerations, and PGA-0.1 a probability of 0.1.
    if "curve" not in table.text.path.stem.lower():
        raise table.text.error(
            f"columns such as '{kinds[-1].upper()}-0.1' are levels in OpenQuake's hazard curves,"
            " but probabilities in its hazard maps: 'curve' was expected in the name of the file",
            table.line,
        )
    known = [kind for kind in kinds if kind in ([measure] if measure else _CONVENTIONS)]
    if len(known) != 1:
        raise table.text.error(
            f"columns of one measure were expected, {measure or 'pga or pgv'}, got those of"
            f" {quote_names(kinds)}",
            table.line,
        )
    return known[0], _follow_convention("OpenQuake", known[0])


def _read_statement(table: Table, key: str) -> str:
    """Read what OpenQuake's comments say of a key."""
    words = [w for _, line in table.notes for w in re.findall(rf"\b{key}\s*=([^,]*)", line)]
    values = {word.strip(" '\"") for word in words}
    if len(values) != 1:
        raise table.text.error(
            f"one {key} was expected in comments, as in '# investigation_time=50.0, imt=PGA', got"
            f" {quote_names(sorted(values)) or 'none'}"
        )
    return values.pop()


def _describe_nshmp(path: Path) -> tuple[Levels, str, str]:
    """Describe nshmp-haz by its path: measure of the levels, words of the path, part of the hazard.

    The measure stands in the name of the folder or file: PGA/curves.csv, PGA.csv. Folders such as
    PGA/source/FAULT and PGA/gmm/ASK_14 have what a kind of sources, or a ground motion model, adds
    to the hazard.
    """
    names = [*path.parts[-4:-1], path.stem]
    at = next(
        (k for k, name in enumerate(names[:-1]) if name in ("source", "gmm")), len(names)
    )
    part = " ".join(names[at : at + 2])
    above = names[max(at - 2, 0) : at]
    measures = {m for m in _CONVENTIONS for name in above if m in find_measures(name)}
    words_of_path = ", ".join([*above, *names[at + 2 :]])
    if len(measures) == 1:
        return _follow_convention("nshmp-haz", measures.pop()), words_of_path, part
    return Levels("level", "", None, ""), words_of_path, part
