"""Directions of components, told by the names of columns and files."""

import re
from pathlib import Path

from .components import Direction

# Words of names of columns, and the ends of names of .AT2 files, after the conventions of data
# centres: the last letter of a channel of three, as in HNZ, is its direction.
_UPWARD = r"up(?:ward|down)?|ud|ve?r?t(?:ical)?|ver|v|u|a?z|accz|[a-z]{2}z"
_DOWNWARD = r"do?w?n(?:ward)?"
_NO_ACCELERATION = r"samples?|index|number|id|v(?:el)?[xyz]"
_AT2_UPWARD = r"up|ud|ve?rt|ver|vertical|v|(?<=-)v1|z|[a-z][hnlg]z"
_AT2_DOWNWARD = r"dn|down|dwn"
# The code of a location may follow that of the channel.
_LOCATION = r"(?:[-_. ]\d\d)?$"
# In the NGA databases such an end may follow the code of a station with nothing between.
_NGA_NAME = r"RSN\d+_"


def find_column_direction(name: str) -> Direction | None:
    """Find the direction of a column by its name without a unit; None for no acceleration."""
    if _has_word(_UPWARD, name):
        return "up"
    if _has_word(_DOWNWARD, name):
        return "down"
    return None if _has_word(_NO_ACCELERATION, name) else "level"


def _has_word(pattern: str, words: str) -> bool:
    """Tell whether a whole word of a name, which may be in camelCase, matches a pattern."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words)
    return any(re.fullmatch(pattern, word, re.I) for word in re.findall(r"[^\W\d_]+", apart))


def _find_vertical_end(path: Path) -> tuple[str, bool]:
    """Find the end of a name that marks a vertical component; tell whether it points down."""
    # Elsewhere a separator has to stand before the end, or a number before the longer ones:
    # the last letters of a word, as in "setup", say nothing.
    apart = r"[-_. ]*"
    if not re.match(_NGA_NAME, path.stem, re.I):
        apart = r"(?:[-_. ]+|(?<=\d)(?=ud|up|dwn))"
    for pattern, downward in ((_AT2_UPWARD, False), (_AT2_DOWNWARD, True)):
        if match := re.search(f"{apart}(?:{pattern}){_LOCATION}", path.stem, re.I):
            return match[0], downward
    return "", False


def is_vertical(path: Path) -> bool:
    """Tell whether the name of a file says that its component is vertical."""
    return _find_vertical_end(path)[0] != ""


def find_vertical_file(path: Path, paths: list[Path]) -> Path:
    """Find the vertical component beside a horizontal one, .AT2 files, by their names."""
    found: dict[str, Path] = {}
    for other in paths:
        if (
            other.suffix.lower() == ".at2"
            and is_vertical(other)
            and other.parent == path.parent
        ):
            stem = other.stem.removesuffix(_find_vertical_end(other)[0])
            # Both names begin alike. In the horizontal one a separator, an angle or, in the
            # NGA databases, a direction comes next: another letter is of another station.
            rest = path.stem.removeprefix(stem) if path.stem.startswith(stem) else "?"
            if re.match(r"[-_. ]|\d{3}$|$|(?:[ns]|[ew]|ns|ew|[hlt]\d?)$", rest, re.I):
                found[stem] = other
    if not found:
        raise ValueError(f"{str(path)!r}: no file is its vertical component by the name")
    # The longest common beginning: "A-STA" may stand beside "A-STA-2".
    nearest = found[max(found, key=len)]
    if _find_vertical_end(nearest)[1]:
        points = f"{str(nearest)!r} points downward by its name"
        raise ValueError(f"{points}, but a vertical component must be positive upward")
    return nearest
