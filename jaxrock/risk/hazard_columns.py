"""Names of the columns of a hazard curve: levels, and how often they are exceeded."""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..ground_motion import find_speeds_in_name, find_units_in_name

# A rate for a probability, or cm/s for m/s, would give a plausible answer that is wrong by
# orders of magnitude. So every word of a name must be known, and nothing is guessed: a column
# with a word that is not listed here is none of these, and the message says what was expected.

# Names of the measures.
_NAMES = {
    "pga": r"pga|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+acceleration",
    "pgv": r"pgv|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+velocity",
}
EXAMPLE = "'pgv [m/s],rate [1/yr]' or 'pga [g],annual rate'"
# Words of other measures in the same units: spectral ones, Arias intensity and the like.
_OTHERS = r"p?s[av]|avgsa|sa(?:avg|rotd)|spectr\w+|arias|cav"
# Words that may stand beside the name of a measure or replace it; words for a yearly rate, a
# probability and a return period; words that may stand beside these.
_LEVEL = r"levels?|intensity|measure|iml?|value|of|horizontal|geometric|mean|x"
_RATE = r"rates?|frequency|frequencies|lambda|\u03bb|m?afe"
_PROBABILITY = r"probability|probabilities|prob|poes?"
_PERIOD = r"(?:return|recurrence)[\s_]+(?:period|interval)s?"
_YEARS = r"years?|yrs?|a"
_BESIDE = r"mean|hazard|of|exceed[ae]nces?|exceed(?:ing|ed)"
_A_YEAR = r"annual|yearly"
_PER_YEAR = rf"(?<![^\W_])per[\s_]+(?:{_YEARS})(?![^\W_])"
# An underscore parts words as a blank does.
_SPAN = rf"(?<![^\W_])(?<![.-])(\d+(?:\.\d+)?)[\s_-]*(?:{_YEARS})(?![^\W_])"


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
        if self.kind == "period":
            return 1 / value if value else math.nan
        return value


class Levels(NamedTuple):
    """The name of a column of levels.

    Attributes
    ----------
    name : str
        As it is printed.
    measures : set of str
        The measures that it states: one or none.
    kind : str
        The measure that has such units.
    units : list of pair
        The units that it states, one or none, and their values in m/s or m/s2.
    reason : str
        Who states the unit, in words.
    """

    name: str
    measures: set[str]
    kind: str
    units: list[tuple[str, float]]
    reason: str


class Points(NamedTuple):
    """The points of a curve in a table.

    Attributes
    ----------
    level : Levels
        What the name of the levels states.
    frequency : Frequency
        What the values are.
    lines : list of int
        In which line each point stands.
    levels, values : ndarray, shape (points,)
        As they are printed.
    """

    level: Levels
    frequency: Frequency
    lines: list[int]
    levels: np.ndarray
    values: np.ndarray


def choose_columns(
    names: Sequence[str], measure: str | None
) -> tuple[tuple[int, Levels], tuple[int, Frequency]]:
    """Choose the columns of levels and of their rates; a `ValueError` if that is not clear."""
    head = ",".join(names)[:60]
    often = [(k, found) for k, name in enumerate(names) if (found := _parse_frequency(name))]
    if len(often) != 1:
        must = "one column must be a rate of exceedance per year"
        raise ValueError(
            f"{must}, as in {EXAMPLE}, or a probability of exceedance in a number of years, or a"
            f" return period [yr], got {len(often)} of them in {head!r}"
        )
    levels = {k: found for k, name in enumerate(names) if (found := _parse_level(name))}
    # A column that names its measure is meant, whatever else might be one of levels.
    named = {k: found for k, found in levels.items() if found.measures}
    ours = {k: found for k, found in named.items() if measure in found.measures}
    chosen = [*(ours or named or levels).items()]
    if len(chosen) != 1:
        must = "one column must be pgv or pga with its unit"
        raise ValueError(f"{must}, as in {EXAMPLE}, got {len(chosen)} of them in {head!r}")
    return chosen[0], often[0]


def _parse_level(name: str) -> Levels | None:
    """Parse the name of a column of levels; None if it is none."""
    # Take out the measure, then the unit, and only words without a meaning of their own may be
    # left.
    measures = _find_measures(name)
    rest = name
    for pattern in _NAMES.values():
        rest = re.sub(pattern, " ", rest, flags=re.I)
    kind, units = find_units(rest)
    for said, _ in units:
        rest = rest.replace(said, " ")
    if len(measures) > 1 or len(units) > 1 or not _all_match(_LEVEL, rest):
        return None
    reason = f"the head states {name!r}"
    return Levels(name, measures, kind, units, reason) if _split_words(name) else None


def _parse_frequency(name: str) -> Frequency | None:
    """Parse the name of a column that states how often levels are exceeded; None if none."""
    if re.search(_PERIOD, name, re.I):
        rest = re.sub(_PERIOD, " ", name, flags=re.I)
        # In years, or it may be in anything.
        of_years = _match_any(_YEARS, rest) and _all_match(rf"{_YEARS}|{_BESIDE}|in", rest)
        return Frequency("period") if of_years else None
    if _match_any(_PROBABILITY, name):
        spans = re.findall(_SPAN, name, re.I)
        rest = re.sub(_SPAN, " ", name, flags=re.I)
        known = rf"{_PROBABILITY}|{_BESIDE}|{_A_YEAR}|{_YEARS}|in|per|within|during|for|%"
        if _match_any(_A_YEAR, rest) or re.search(_PER_YEAR, rest, re.I):
            spans.append("1")
        # In how many years must be said, and only once.
        if len(spans) != 1 or not float(spans[0]) or not _all_match(known, rest):
            return None
        return Frequency("probability", float(spans[0]), 0.01 if "%" in name else 1.0)
    # 1/rate is a period, and so is anything in years, not per year.
    if re.match(r"\s*1\s*/", name) or (
        _match_any(_YEARS, name) and not re.search(r"/|per|-\s*1", name, re.I)
    ):
        return None
    if _match_any(_RATE, name) and _all_match(
        rf"{_RATE}|{_BESIDE}|{_A_YEAR}|{_YEARS}|per|1", name
    ):
        return Frequency("rate")
    return None


def find_factor(
    level: Levels, unit: str | None, measure: str | None, comments: Sequence[str]
) -> tuple[float, str]:
    """Find the unit of levels in m/s or m/s2, and their measure, from their name.

    The caller may state both as well, and a comment the measure.

    Raises a `ValueError` if they are not stated, or contradict each other.
    """
    name, _, kind, units, reason = level
    if unit is not None:
        # A unit of the caller may repeat the one in the head, but not contradict it.
        given = find_units(str(unit))
        if len(given[1]) != 1 or math.isnan(given[1][0][1]):
            raise ValueError(
                f"unit must be one like 'm/s', 'cm/s', 'm/s2' or 'g', got {unit!r}"
            )
        if units and (given[0] != kind or not math.isclose(given[1][0][1], units[0][1])):
            raise ValueError(f"unit is {unit!r}, but {reason}")
        kind, units = given
    if not units:
        raise ValueError(f"the head states no unit, so that unit must be given, got {name!r}")
    found = _choose_measure(level, measure, comments)
    ((said, factor),) = units
    if math.isnan(factor) or kind != found:
        raise ValueError(f"{said!r} is not understood as a unit of {found}, got {name!r}")
    return factor, found


def _choose_measure(level: Levels, measure: str | None, comments: Sequence[str]) -> str:
    """Choose the measure that the name of levels, a comment above it or the caller states."""
    # A name that says nothing, like level [g], may be of spectral accelerations.
    stated = level.measures or {kind for line in comments for kind in _find_measures(line)}
    if len(stated) != 1:
        must = "the head does not say which measure the levels are of, so that measure must"
        if measure is None:
            raise ValueError(f"{must} be given, got {level.name!r}")
        return measure
    (found,) = stated
    if measure not in (None, found):
        must = f"a hazard of {measure} was expected"
        raise ValueError(f"{must}, got one of {found}: {level.name!r}")
    return found


def find_contradiction(level: Levels, frequency: Frequency, comment: str) -> str:
    """Find what a comment names instead of what the columns hold; empty if nothing."""
    # Below a name that is clear the comment may be about other columns.
    if not level.measures and _match_any(_OTHERS, comment):
        return "another measure than pga or pgv"
    if frequency.kind == "rate" and _match_any(_PROBABILITY, comment):
        return "a probability above a column of rates"
    return ""


def find_units(text: str) -> tuple[str, list[tuple[str, float]]]:
    """Find the units that a text states, and the measure that has such units."""
    speeds = find_speeds_in_name(text)
    return ("pgv", speeds) if speeds else ("pga", find_units_in_name(text))


def _find_measures(text: str) -> set[str]:
    """Find the measures that a text names."""
    return {kind for kind, pattern in _NAMES.items() if re.search(pattern, text, re.I)}


def _split_words(text: str) -> list[str]:
    """Split a text into words of letters or digits; % is one of its own."""
    return re.findall(r"[^\W\d_]+|\d+|%", text)


def _match_any(pattern: str, text: str) -> bool:
    """Tell whether a word of a text matches a pattern, in upper or lower case."""
    return any(re.fullmatch(pattern, word, re.I) for word in _split_words(text))


def _all_match(pattern: str, text: str) -> bool:
    """Tell whether all words of a text match a pattern, in upper or lower case."""
    return all(re.fullmatch(pattern, word, re.I) for word in _split_words(text))
