"""Notes on a hazard curve: comments, titles, columns of words, and the names of files."""

import math
import re

from ..oldtables import QUANTITIES, Table, Unit, find_units, parse_unit, quote_names, quote_word

OTHER = "another measure than pga or pgv"
_MEASURES = {
    "pga": r"pga|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+acceleration",
    "pgv": r"pgv|peak[\s_]+(?:horizontal[\s_]+)?ground[\s_]+velocity",
    OTHER: r"pgd|p?sa(?=\s*[(=\d]|\s+at\b)|psa|avgsa|spectr(?:al|um|a)|arias|cav|mmi",
}
# Any word of measures in the same units, where the levels do not say what they are.
_ANY_OTHER = "|".join(
    (_MEASURES[OTHER], *(QUANTITIES[k].words for k in ("spectral acceleration", "intensity")))
)
_REFUSED = {
    "standard deviations, which are no hazard curve: take the mean or a quantile": (
        r"std(?:[\s_-]*dev)?s?|stdevs?|standard[\s_]+(?:deviations?|errors?)"
        r"|coefficients?[\s_]+of[\s_]+variation"
        r"|(?<!\d )(?<!\d-)sigmas?(?!\s*=|\s+trunc)"
    ),
    "logarithms, where the values themselves were expected": (
        r"^(?!.*interpol).*?(?<![^\W\d_])(?<!log-)(?:log(?:e|10)|ln(?!-)|logarithms?"
        r"|log(?=\s*\(|\s+(?:values?|units?|rates?|pg[av]|levels?))"
        r"|logarithmic\s+(?:values|rates|units))"
    ),
    "non-exceedance, where exceedance was expected": r"non[\s_-]*exceed\w*",
}
_REFUSED_ABOVE_RATES = {
    "a probability above a column of rates": QUANTITIES["probability"].words,
    "a number of years above a column of rates, which are per year": (
        r"per\s+(?!1\s)\d+\s*(?:years?|yrs?|a)|investigation[\s_]+time"
    ),
}
# What OpenQuake computes from the curves of a logic tree, or one of these.
_STATISTIC = r"mean|median|max|min|rlz-\d+|quantile-[\d.]+"
_WORDS = r"(?:mean|median|max(?:imum)?|min(?:imum)?|rlz-\d+)"
# A word of its own between commas and the like, or of a hazard: others may be of magnitudes.
_IN_WORDS = (
    rf"(?:(?:^|[#,;:=(\"']|hazard_curve-)\s*(?={_WORDS}\s*(?:$|[-_,;)\"'/&]|and\b|rate))"
    rf"|\b(?={_WORDS}\s+(?:seismic\s+)?(?:hazard|curve)))({_WORDS})"
)
_QUANTILE = r"(?:quant|percent|fract)iles?"
_FRACTION = (
    r"(?<![\w.])(?:0?\.\d+|\d+(?:\.\d+)?"
    rf"(?=st\b|nd\b|rd\b|th\b|\s*%(?!\s*(?:damp|in\b|g\b))|[\s-]*{_QUANTILE})"
    r"|(?<=ile[\s=:_-])\d+(?:\.\d+)?)"
)
Notes = list[tuple[int, str]]


def find_measures(words: str, pattern_of_others: str = _MEASURES[OTHER]) -> set[str]:
    """Find the measures that words name: pga, pgv, or `OTHER`."""
    patterns = _MEASURES | {OTHER: pattern_of_others}
    return {measure for measure, pattern in patterns.items() if _find_word(pattern, words)}


def find_measures_of_levels(table: Table, notes: Notes, measure: str) -> set[str]:
    """Find the measures that notes name; an error if they contradict the measure of the levels.

    Below a measure in the name of the levels they may be about other columns; where it is empty,
    they must not name what else is in the same units.
    """
    columns = find_measures(" ".join(table.names)) | {measure}
    stated: set[str] = set()
    for line, words in notes:
        # In names of files fewer words are clear.
        named = find_measures(words, _MEASURES[OTHER] if measure or not line else _ANY_OTHER)
        if (named and not named & columns) if measure else OTHER in named:
            names = " and ".join(sorted(named))
            levels = measure or "levels of no stated measure"
            raise table.text.error(f"{quote_word(words)} names {names} beside {levels}", line)
        stated |= named
    return stated


def refuse_notes(table: Table, notes: Notes, kind: str, unit: Unit) -> None:
    """Refuse notes that name something else than the columns hold."""
    names = " ".join(table.names)
    units = [unit, *(unit for head in table.heads for unit in head.units)]
    measure = _MEASURES["pga" if unit.dimension == "acceleration" else "pgv"]
    refused = _REFUSED | (_REFUSED_ABOVE_RATES if kind == "rate" else {})
    for line, words in notes:
        for content, pattern in refused.items():
            # It may be about another column.
            match = _find_word(pattern, words)
            if match and not _find_word(pattern, names):
                raise table.text.error(
                    f"{match[0]!r} beside the columns names {content}", line
                )
        # Behind the name of a measure in text a unit may belong to a value; of levels it is theirs.
        plain = re.sub(measure, "acceleration", words, flags=re.I)
        for spelling, _ in find_units(plain):
            stated = parse_unit(spelling)
            if stated.dimension in ("acceleration", "velocity") and not any(
                agree(stated, known) for known in units
            ):
                raise table.text.error(
                    f"{quote_word(words)} states {spelling}, but levels are in {unit.words}",
                    line,
                )


def agree(unit: Unit, expected: Unit) -> bool:
    """Return whether two units are equal, however they are spelled."""
    return unit.dimension == expected.dimension and math.isclose(unit.factor, expected.factor)


def find_statistic(table: Table, notes: Notes, name: str) -> str:
    """Find the statistic over a logic tree; `name` is the name of the column of rates."""
    names = [words for words in table.names if words != name]
    # With numbers as in "84th rate"; without any, notes may not name quantiles either.
    elsewhere = _find_statistics(f"{', '.join(names)} quantile") ^ {"quantile"}
    stated = {words for _, note in notes for words in _find_statistics(note)} - elsewhere
    stated |= _find_statistics(name)
    if len(stated) > 1 or not all(re.fullmatch(_STATISTIC, words) for words in stated):
        raise table.text.error(
            "one kind of curve was expected in comments and the name of the file, such as mean,"
            f" max, quantile-0.85 or rlz-000, got {quote_names(sorted(stated))}"
        )
    # OpenQuake 2.0 wrote the path of a branch above means and quantiles as well.
    is_branch = any("source_model_tree_path" in words for _, words in notes)
    return "single realization" if is_branch and not stated else "".join(stated)


def _find_statistics(words: str) -> set[str]:
    """Find which curves of a logic tree words name: mean, quantile-0.84, rlz-012 and so on.

    A quantile without a number, and what OpenQuake states and is not understood, are added as they
    are.
    """
    # Older versions of OpenQuake name a file quantile_curve-0.1.csv.
    words = words.lower().replace("quantile_curve", "quantile")
    stated = {word.removesuffix("imum") for word in re.findall(_IN_WORDS, words)}
    for value in re.findall(r"\bkind\s*=\s*([^,]*)", words):
        plain = value.strip(" '\"")
        stated |= _find_statistics(plain) or {plain}
    if not _find_word(_QUANTILE, words):
        return stated
    values = [float(value) for value in re.findall(_FRACTION, words)]
    return stated | (
        {f"quantile-{x / 100 if x >= 1 else x:g}" for x in values} or {"quantile"}
    )


def _find_word(pattern: str, words: str) -> re.Match[str] | None:
    """Find a pattern, in upper or lower case, as a word of its own."""
    return re.search(rf"(?<![^\W\d_])(?:{pattern})(?![^\W\d_])", words, re.I)
