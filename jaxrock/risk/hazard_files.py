"""Hazard curves from files, whose heads must leave no doubt about measure and units."""

import math
import os
import re
from pathlib import Path

import numpy as np

from ..ground_motion import find_speeds_in_name, find_units_in_name
from ..host import is_number, read_numbered_lines
from .hazard import HAZARD_MEASURES, Hazard

# A rate for a probability, or cm/s for m/s, would give a plausible answer that is wrong by
# orders of magnitude. So every word of the head must be known, and nothing is guessed: a head
# with a word that is not listed here is refused, and the message says what was expected.

# Names of the measures.
_NAMES = {
    "pga": r"pga|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+acceleration",
    "pgv": r"pgv|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+velocity",
}
_EXAMPLE = "'pgv [m/s],rate [1/yr]' or 'pga [g],annual rate'"
# Words that may stand beside the name of a measure or replace it; words for a yearly rate.
_LEVEL = r"levels?|intensity|measure|iml?|value|of|horizontal|geometric|mean|x"
_RATE = r"rates?|frequency|frequencies|lambda|\u03bb|m?afe"
_OF_A_YEAR = r"annual|yearly|mean|hazard|of|exceed[ae]nces?|exceed(?:ing|ed)|per|years?|yr|a|1"


def read_hazard(
    path: str | os.PathLike[str], *, unit: str | None = None, measure: str | None = None
) -> Hazard:
    r"""Read a hazard curve from a .csv file.

    Parameters
    ----------
    path : str or path
        A file with two columns separated by commas, the level of the intensity measure and the
        yearly rate of exceedance, below one line with their names, such as
        ``pgv [m/s],rate [1/yr]``, and perhaps lines that begin with #.
    unit : str, optional
        Of the levels, where the head does not state it: ``"m/s"``, ``"cm/s"`` and so on, or
        a unit of acceleration as in `read_record`.
    measure : {"pgv", "pga"}, optional
        Which measure is expected: the curve must not be of another one.

    Returns
    -------
    Hazard
        Levels in m/s or m/s2.

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read, holds no hazard curve, is about another
        measure, or if its head is not understood: the measure, the unit of the levels, and
        that the second column is a yearly rate.

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
    if measure not in (None, *HAZARD_MEASURES):
        allowed = ", ".join(HAZARD_MEASURES)
        raise ValueError(f"measure must be one of {allowed}, or None, got {measure!r:.60}")
    lines = read_numbered_lines(path)
    if lines and is_number(lines[0][1].split(",")[0]):
        must = "a line with the names of the two columns was expected"
        raise ValueError(
            f"{str(path)!r}, line {lines[0][0]}: {must}, got {lines[0][1][:60]!r}"
        )
    rows = [_parse_level_and_rate(path, *line) for line in lines[1:]]
    if len(rows) < 2:
        must = "at least two lines of a level and a rate below their names were expected"
        raise ValueError(f"{str(path)!r}: {must}, got {len(rows)}")
    number, head = lines[0]
    try:
        factor, found = _parse_head(head, unit, measure)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}, line {number}: {error}") from None
    levels, rates = np.array(rows).T
    try:
        return Hazard(factor * levels, rates, found)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}: {error}") from None


def _parse_head(head: str, unit: str | None, expected: str | None) -> tuple[float, str]:
    """Read the unit of the levels, in m/s or m/s2, and the measure from the columns' names."""
    columns = [name.strip().strip('"').strip() for name in head.split(",")]
    if len(columns) != 2:
        raise ValueError(f"two columns were expected, as in {_EXAMPLE}, got {head[:60]!r}")
    name, rate = columns
    # The second column: at least one word for a rate, and no word that means something else.
    named = [word for word in _split_words(rate) if re.fullmatch(_RATE, word, re.I)]
    if not named or not _all_match(f"{_RATE}|{_OF_A_YEAR}", rate):
        must = "the second column must be a rate of exceedance per year"
        raise ValueError(
            f"{must}, as in {_EXAMPLE}, got {rate!r}; a probability p in n years is a"
            " rate of -ln(1 - p) / n"
        )
    # The first column: take out the measure, then the unit, and only words without a meaning
    # of their own may be left.
    stated = {kind for kind, pattern in _NAMES.items() if re.search(pattern, name, re.I)}
    rest = name
    for pattern in _NAMES.values():
        rest = re.sub(pattern, " ", rest, flags=re.I)
    kind, units = _find_units(rest)
    for said, _ in units:
        rest = rest.replace(said, " ")
    if len(stated) > 1 or len(units) > 1 or not _all_match(_LEVEL, rest):
        must = "the first column must be pgv or pga with its unit"
        raise ValueError(f"{must}, as in {_EXAMPLE}, got {name!r}")
    if unit is not None:
        # A unit of the caller may repeat the one in the head, but not contradict it.
        given = _find_units(str(unit))
        if len(given[1]) != 1 or math.isnan(given[1][0][1]):
            raise ValueError(
                f"unit must be one like 'm/s', 'cm/s', 'm/s2' or 'g', got {unit!r}"
            )
        if units and (given[0] != kind or not math.isclose(given[1][0][1], units[0][1])):
            raise ValueError(f"unit is {unit!r}, but the head states {name!r}")
        kind, units = given
    if not units:
        raise ValueError(f"the head states no unit, so that unit must be given, got {name!r}")
    # Without its name the measure follows from the unit.
    found = next(iter(stated), kind)
    ((said, factor),) = units
    if math.isnan(factor) or kind != found:
        raise ValueError(f"{said!r} is not understood as a unit of {found}, got {name!r}")
    if expected is not None and found != expected:
        raise ValueError(f"a hazard of {expected} was expected, got one of {found}: {name!r}")
    return factor, found


def _find_units(text: str) -> tuple[str, list[tuple[str, float]]]:
    """Find the units that a text states, and the measure that has such units."""
    speeds = find_speeds_in_name(text)
    return ("pgv", speeds) if speeds else ("pga", find_units_in_name(text))


def _split_words(text: str) -> list[str]:
    """Split a text into words of letters and digits; % is one of its own."""
    return re.findall(r"[^\W_]+|%", text)


def _all_match(pattern: str, text: str) -> bool:
    """Tell whether all words of a text match a pattern, in upper or lower case."""
    return all(re.fullmatch(pattern, word, re.I) for word in _split_words(text))


def _parse_level_and_rate(path: Path, number: int, line: str) -> tuple[float, float]:
    """Read a level and a rate from a line; a `ValueError` with its number if it has others."""
    fields = line.split(",")
    must = "a level and a rate were expected, separated by a comma"
    if len(fields) == 2 and all(map(is_number, fields)):
        level, rate = map(float, fields)
        if 0 < level < math.inf and 0 < rate < math.inf:
            return level, rate
        must = "a level and a rate must be finite and greater than 0"
    raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
