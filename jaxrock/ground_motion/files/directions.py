"""Directions of components, as stated by names of columns, files and channels, and by titles."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

from ...oldtables import split_words
from .components import Direction

# "vertical" is a word such as V or Z, which does not say whether up or down.
Stated = Literal["level", "up", "down", "vertical", ""]

# Words for directions, in any case, after the conventions of data centres: the last letter of a
# channel of three, as in HNZ, is its direction.
_LEVEL = r"n-?s[12]?|s-?n|e-?w[12]?|w-?e|[nsewlt]|h[12]|long|tran|radl|tang|ln|tr"
_WORDS: dict[Stated, str] = {
    "up": r"up|upward|u-?d[12]?",
    "down": r"dn|down|dwn|downward",
    "vertical": r"ve?r?t|ver|vertical|v|(?<=-)v1|z|[a-z][hnlg]z",
    "level": rf"[ns]\d{{1,2}}[ew]|{_LEVEL}|[a-z][hnlg][ne12]",
}
_COMPASS = r"north|east|south|west"
_DEGREES = r"(?:[0-2]\d\d|3[0-5]\d|360)"

# Words of names of columns.
_ACCELERATION = r"(?:acc(?:el)?|a)?"
_UPWARD = rf"{_ACCELERATION}(?:{_WORDS['up']}|{_WORDS['vertical']})|u|updown|[a-z]{{2}}z"
_DOWNWARD = rf"{_ACCELERATION}(?:{_WORDS['down']})"
_NO_ACCELERATION = r"samples?|index|number|id|v(?:el)?[xyz]"
# What can only be horizontal. The axes x and y may be any, in two dimensions too.
_CLEARLY_LEVEL = rf"[ne]|ns|sn|ew|we|{_COMPASS}|[behls][hnlg][ne]"

# Ends of names of files.
# The code of a location may follow that of the channel: digits, or -- where it is blank.
_LOCATION = r"(?:[-_. ](?:\d\d|--))?"
# A separator has to stand before an end: the last letters of a word, as in "setup", say
# nothing. No word ends in some of them, nor has others after a number.
_APART = (
    r"(?:^|[-_. ]+|(?=dwn$|vrt$)|(?<=\d)(?=ud[12]?$|up$|n-?s[12]?$|e-?w[12]?$)"
    r"|(?<=[a-z])(?=[ns]\d\d[ew]$))"
)
_ANGLE = rf"(?:^|[-_. a-z]){_DEGREES}|[-_. ]\d\d"
# In the NGA databases an end may follow the code of a station with nothing between. Such
# names are known elsewhere only beside another component of the station.
_NGA_NAME = r"RSN\d+_"
_VERTICAL = "|".join(_WORDS[direction] for direction in ("up", "down", "vertical"))
_GLUED = rf"(?P<station>.+?)(?P<end>{_VERTICAL})"

# In these parts the names of a horizontal and of a vertical component may differ: words as
# above, angles, or digits of channels.
_LEVEL_PART = (
    rf"[-_. ]*(?:{_WORDS['level']}|[hlt]\d|[xyr]|trans|{_COMPASS})|[-_. ]+\d{{1,3}}|\d{{3}}|"
)
_VERTICAL_PART = rf"[-_. ]*(?:{_VERTICAL}|v\d|u)"
# Of KiK-net's sensors in a borehole and at the surface, 1 and 2, each has its own vertical.
_PARTS = rf"(?!.*[sw]1/.*d2|.*[sw]2/.*d1)(?:(?:{_LEVEL_PART})/(?:{_VERTICAL_PART})|[12]/[3z])"


def find_column_direction(name: str) -> Direction | None:
    """Find the direction of a column by its name without a unit; None for no acceleration."""
    if _has_word(_UPWARD, name):
        return "up"
    if _has_word(_DOWNWARD, name):
        return "down"
    return None if _has_word(_NO_ACCELERATION, name) else "level"


def find_clear_direction(name: str) -> Direction:
    """Find the direction that the name of a column, without a unit, says; "" for none."""
    direction = find_column_direction(name)
    if direction == "level" and not _has_word(_CLEARLY_LEVEL, name):
        return ""
    return direction or ""


def _has_word(pattern: str, words: str) -> bool:
    """Return whether a whole word of a name, which may be in camelCase, matches a pattern."""
    return any(re.fullmatch(pattern, word, re.I) for word in split_words(words))


def find_name_direction(path: Path, paths: Iterable[Path]) -> Stated:
    """Find the direction of a component by the names of its file and of others beside it."""
    stem = path.stem
    of_nga = re.match(_NGA_NAME, stem, re.I) is not None
    for direction, ends in _WORDS.items():
        apart = r"[-_. ]*" if of_nga and direction != "level" else _APART
        if re.search(rf"{apart}(?:{ends}){_LOCATION}$", stem, re.I):
            return direction
    if re.search(rf"(?:{_ANGLE})$", stem, re.I):
        return "level"
    glued = re.fullmatch(_GLUED, stem, re.I)
    if glued is None:
        return ""
    beside = re.escape(glued["station"]) + r"(?:\d{3}|[ns]\d\d[ew]|[a-z][hnlg][ne12])"
    known = any(
        other.parent == path.parent and re.fullmatch(beside, other.stem, re.I)
        for other in paths
    )
    return find_word_direction(glued["end"]) if known else ""


def find_word_direction(word: str) -> Stated:
    """Find the direction that a word says, such as UP, DWN, V, N90E, 140; "" for none."""
    for direction, ends in _WORDS.items():
        if re.fullmatch(ends, word, re.I):
            return direction
    return "level" if re.fullmatch(_DEGREES, word) else ""


def find_channel_direction(name: str, names: Mapping[str, Direction]) -> Direction | None:
    """Find the direction of a channel by words, or by patterns of names of its format."""
    stated = find_word_direction(name)
    if stated and stated != "vertical":
        return stated
    # In SEED's channels Z points up. Any other word for vertical leaves open where to.
    if stated and name.lower().endswith("z"):
        return "up"
    for pattern, direction in names.items():
        if re.fullmatch(pattern, name, re.I):
            return direction
    return None


def settle_direction(name: Stated, title: Stated) -> Direction | None:
    """Settle a direction by what the name of a file and its title say; None if they differ."""
    stated = {name, title} - {""}
    if stated <= {"up", "vertical"}:
        return "up" if stated else ""
    if stated <= {"down", "vertical"}:
        return "down"
    return "level" if stated == {"level"} else None


def is_same_station(level: Path, vertical: Path) -> bool:
    """Return whether the names of two files differ only in the parts for their components."""
    if level.parent != vertical.parent:
        return False
    names = [level.name.lower(), vertical.name.lower()]
    # Separators belong to the parts, and the common end begins with one.
    begin = len(_find_common(names).rstrip("-_. "))
    end = _find_common([name[begin:][::-1] for name in names])[::-1]
    end = re.sub(r"^[^-_. ]*", "", end)
    parts = "/".join(name[begin : len(name) - len(end)] for name in names)
    return re.fullmatch(_PARTS, parts) is not None


def _find_common(names: list[str]) -> str:
    """Find the letters with which two names begin alike."""
    alike = [letter == second for letter, second in zip(*names, strict=False)]
    return names[0][: [*alike, False].index(False)]
