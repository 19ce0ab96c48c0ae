"""Tables of hazard curves with a line for each site and a column for each level.

OpenQuake's engine 3 names the columns ``poe-0.005``, engine 2 ``PGA-0.005`` with all measures in
one file, and USGS's nshmp-haz ``0.005``. Measure and unit are no part of the columns.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..tables import Head, Row, Table, as_number, quote_names, quote_word, read_head

# OpenQuake's hazard library and USGS's nshmp-haz both take PGA in g and PGV in cm/s:
# https://docs.openquake.org/oq-engine/manual/ and https://github.com/usgs/nshmp-haz.
_CONVENTIONS = {"pga": "g", "pgv": "cm/s"}
_ABOUT_SITES = r"custom_site_id|site_id|id|name|lon|lat|longitude|latitude|depth|vs30"
_PLACE = (("longitude", r"lon(?:gitude)?", 360.0), ("latitude", r"lat(?:itude)?", 90.0))
_NEAR = 1e-4  # degrees, about 10 m: coordinates are printed with four or five digits
_LEVEL = r"(?:(?P<kind>poe|[a-z]\w*(?:\([\d.]+\))?)-)?(?P<level>[\d.]+(?:e[-+]?\d+)?)"
# Some versions of OpenQuake's engine write the type of a column behind its name.
_TYPE = r"(?i):float\d\d$"
# What OpenQuake's engine computes from the curves of a logic tree, or one of these.
_STATISTIC = r"mean|max|std|quantile-(?:\d*\.)?\d+|rlz-\d+"
_IN_COMMENT = rf"(?i)#[,\s\"']*(?P<statistic>{_STATISTIC})(?![\w.])"
_IN_NAME = rf"(?i)(?:hazard_curve-|(?=quantile))(?P<statistic>{_STATISTIC})(?![^\W_]|\.\d)"


class Frequency(NamedTuple):
    """A column of how often levels are exceeded: a rate, probability or return period."""

    kind: str
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
    """A hazard curve as a file states it.

    Attributes
    ----------
    head : Head
        Of its levels.
    frequency : Frequency
        Of its values.
    points : list of (int, float, float)
        Line, level and value of each point as they are printed.
    reason : str
        Who states the unit of levels.
    statistic : str
        As in `Hazard`.
    """

    head: Head
    frequency: Frequency
    points: list[tuple[int, float, float]]
    reason: str
    statistic: str = ""


def has_sites(table: Table) -> bool:
    """Return whether a table has a line for each site, by its columns."""
    names = _clean_names(table)
    return any(re.fullmatch(_PLACE[0][1], name, re.I) for name in names) and any(
        re.fullmatch(_LEVEL, name, re.I) for name in names
    )


def read_site(
    table: Table, site: tuple[float | int, float | int] | None, measure: str | None
) -> Curve:
    """Read the curve of a site from a table of OpenQuake or of USGS's nshmp-haz."""
    columns: dict[str, list[tuple[int, float]]] = {}
    for k, name in enumerate(_clean_names(table)):
        match = re.fullmatch(_LEVEL, name, re.I)
        level = as_number(match["level"]) if match else None
        if match and level is not None:
            columns.setdefault((match["kind"] or "").lower(), []).append((k, level))
        elif not re.fullmatch(_ABOUT_SITES, name, re.I):
            raise table.text.error(f"column {quote_word(name)} is not understood", table.line)
    row = _choose_row(table, site)
    kinds = [*columns]
    if kinds == [""]:
        head, reason, statistic = _describe_nshmp(table, measure)
        frequency = Frequency("rate")
        kind = ""
    else:
        kind, imt = _choose_kind(table, kinds, measure)
        head = _describe_levels(imt)
        reason = f"OpenQuake has {imt.upper()} in {_CONVENTIONS[imt]} by its convention"
        frequency = Frequency("probability", _read_years(table))
        statistic = _read_statistic(table)
    points = [(row.line, level, read_number(table, row, k)) for k, level in columns[kind]]
    return Curve(head, frequency, points, reason, statistic)


def read_number(table: Table, row: Row, column: int) -> float:
    """Read a number of a row that has all cells."""
    number = table.parse_number(row, column)
    if number is None:
        name = quote_word(table.names[column])
        cell = quote_word(row.cells[column])
        raise table.text.error(f"column {name} must be a number, got {cell}", row.line)
    return number


def _clean_names(table: Table) -> list[str]:
    """Return the names of columns without their types."""
    return [re.sub(_TYPE, "", name) for name in table.names]


def _choose_row(table: Table, site: tuple[float | int, float | int] | None) -> Row:
    """Choose the line of the site, or the only one."""
    columns = [_find_place(table, name, pattern) for name, pattern, _ in _PLACE]
    near: list[Row] = []
    for row in table.rows:
        if len(row.cells) != len(table.names):
            raise table.error_of_width(row)
        place = [read_number(table, row, column) for column in columns]
        for value, (name, _, limit) in zip(place, _PLACE, strict=True):
            if not abs(value) <= limit:
                allowed = f"from {-limit:g} to {limit:g} degrees"
                raise table.text.error(
                    f"a {name} must be {allowed}, got {value:g}", row.line
                )
        if site is None or np.allclose(place, site, rtol=0, atol=_NEAR):
            near.append(row)
    curves = f"got {len(table.rows)} curves"
    if len(near) != 1 and site is None:
        raise table.text.error(
            f"site must be given, the longitude and latitude of one, {curves}"
        )
    if len(near) != 1:
        raise table.text.error(
            f"one curve at longitude and latitude {site} was expected, {curves}, {len(near)} of"
            " them there"
        )
    return near[0]


def _find_place(table: Table, name: str, pattern: str) -> int:
    """Find the column of longitudes, or of latitudes."""
    names = _clean_names(table)
    columns = [k for k, word in enumerate(names) if re.fullmatch(pattern, word, re.I)]
    if len(columns) != 1:
        raise table.text.error(
            f"one column of each {name} was expected, got {len(columns)}", table.line
        )
    return columns[0]


def _describe_levels(measure: str) -> Head:
    """Describe levels in the unit that both programs have for their measure."""
    return read_head(f"{measure.upper()} [{_CONVENTIONS[measure]}]")


def _choose_kind(table: Table, kinds: Sequence[str], measure: str | None) -> tuple[str, str]:
    """Choose the columns by what stands before their levels; the measure of these levels."""
    if kinds == ["poe"]:
        imt = _read_statement(table, "imt")
        if imt.lower() not in _CONVENTIONS:
            raise table.text.error(f"a hazard of pga or pgv was expected, got one of {imt!r}")
        return "poe", imt.lower()
    # In maps of hazard the same columns hold accelerations, and PGA-0.1 a probability of 0.1.
    if not re.search(r"curve", table.text.path.stem, re.I):
        raise table.text.error(
            f"columns such as '{kinds[-1].upper()}-0.1' stand for levels in OpenQuake's hazard"
            " curves, but for probabilities in its hazard maps: the name of a file of curves must"
            f" have the word 'curve', got {table.text.path.name!r}",
            table.line,
        )
    known = [kind for kind in kinds if kind in (_CONVENTIONS if measure is None else [measure])]
    if len(known) != 1:
        expected = "pga or pgv, chosen by measure," if measure is None else measure
        raise table.text.error(
            f"columns of {expected} were expected, got those of {quote_names(kinds)}", table.line
        )
    return known[0], known[0]


def _read_years(table: Table) -> float:
    """Read in how many years OpenQuake's probabilities are."""
    words = _read_statement(table, "investigation_time")
    years = as_number(words)
    if years is None or not 0 < years < math.inf:
        raise table.text.error(
            f"investigation_time must be greater than 0, got {quote_word(words)}"
        )
    return years


def _read_statement(table: Table, key: str) -> str:
    """Read what OpenQuake's comments say of a key."""
    values = _find_statements(table, key)
    if len(values) != 1:
        raise table.text.error(
            f"one {key} was expected in a comment above, as OpenQuake writes it, got"
            f" {quote_names(sorted(values)) or 'none'}"
        )
    return values.pop()


def _find_statements(table: Table, key: str) -> set[str]:
    """Find what comments say of a key."""
    return {
        value.strip(" '\"")
        for _, line in table.notes
        for value in re.findall(rf"\b{key}\s*=([^,]*)", line)
    }


def _read_statistic(table: Table) -> str:
    """Read which of OpenQuake's curves this is, from comments and the name of the file."""
    stated = _find_statements(table, "kind")
    for _, line in table.notes:
        if match := re.match(_IN_COMMENT, line):
            stated.add(match["statistic"])
        elif "source_model_tree_path=" in line:
            return "single realization"
    # Older versions name the file quantile_curve-0.1.
    name = table.text.path.name.replace("quantile_curve-", "quantile-")
    if match := re.search(_IN_NAME, name):
        stated.add(match["statistic"])
    stated = {words.lower() for words in stated}
    if "std" in stated:
        raise table.text.error(
            "standard deviations of a logic tree are no hazard curve: take the mean or a quantile"
        )
    if len(stated) > 1 or not all(re.fullmatch(_STATISTIC, words) for words in stated):
        raise table.text.error(
            "one of mean, max, quantile-0.85, rlz-000 was expected as the kind of curve in"
            f" comment and name of the file, got {quote_names(sorted(stated))}"
        )
    return "".join(stated)


def _describe_nshmp(table: Table, measure: str | None) -> tuple[Head, str, str]:
    """Describe levels and values of nshmp-haz, of which only folders and names may tell.

    The measure stands in ``PGA/curves.csv`` or ``PGA.csv``. Below ``PGA/source`` and
    ``PGA/gmm`` are the parts of the hazard due to kinds of sources and to ground motion models.
    """
    path = table.text.path.absolute()
    folders = path.parts[-4:-1]
    statistic = ""
    for k, folder in enumerate(folders):
        if folder in ("source", "gmm"):
            part = path.stem if k + 1 == len(folders) else folders[k + 1]
            statistic = f"{folder} {part}"
            folders = folders[:k]
            break
    stated = {
        word.lower()
        for name in (*folders[-1:], path.stem)
        for word in re.findall(r"(?<![a-z])(?:pga|pgv|sa\d+p\d+)(?![a-z])", name, re.I)
    }
    if len(stated) > 1 or not stated <= {*_CONVENTIONS}:
        names = quote_names(sorted(stated))
        raise table.text.error(f"a hazard of pga or pgv was expected, got one of {names}")
    if not stated and measure is None:
        raise table.text.error(
            "neither the table nor its folder names the measure, so that measure and unit must"
            " be given"
        )
    # Without a unit the caller has to state one.
    if not stated:
        return Head("level", "level", "level"), "", statistic
    imt = stated.pop()
    reason = f"nshmp-haz has {imt.upper()} in {_CONVENTIONS[imt]} by its convention"
    return _describe_levels(imt), reason, statistic
