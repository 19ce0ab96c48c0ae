"""Directions of channels, by the names, azimuths and codes of headers, which have to agree."""

import re
from collections.abc import Mapping
from types import MappingProxyType

from ...tables import TextFile, quote_word
from .components import Direction
from .directions import find_channel_direction
from .headers import Header

_COMPASS = {"n": 0.0, "e": 90.0, "s": 180.0, "w": 270.0}


def find_direction(
    text: TextFile,
    header: Header,
    names: Mapping[str, Direction] = MappingProxyType({}),
    codes: Mapping[int, Direction] = MappingProxyType({}),
) -> Direction:
    """Find where a channel points, by the statements "channel", "azimuth" and "code".

    `names` are patterns of names that are a format's own, `codes` its numbers.
    """
    channel = header.find("channel")
    degrees = None if channel is None else find_azimuth(channel.word)
    named: Direction | None = "" if degrees is None else "level"
    if channel is not None and degrees is None:
        named = find_channel_direction(channel.word, names)
        if named is None:
            raise text.error(
                "an orientation such as '360 deg', 'N28W', 'Up' or 'Down' was expected, got"
                f" {quote_word(channel.word)}",
                channel.line,
            )
    azimuth = header.find("azimuth")
    stated = azimuth or header.find("code")
    if stated is None:
        return named
    if azimuth is None and stated.value not in codes:
        raise text.error(
            f"the header states an orientation of {stated.word}, which is not understood",
            stated.line,
        )
    coded: Direction = "level" if azimuth else codes[int(stated.value)]
    is_turned = azimuth and degrees is not None and (azimuth.value - degrees) % 360 != 0
    if channel is not None and (is_turned or (named and coded and named != coded)):
        raise text.error(
            f"the channel is {channel.word} in line {channel.line}, but the header states an"
            f" orientation of {stated.word}",
            stated.line,
        )
    return named or coded


def find_azimuth(name: str) -> float | None:
    """Find the degrees from north of a name such as 340, N28W, S or East; None for others."""
    if name.isdigit() and int(name) <= 360:
        return float(name)
    match = re.fullmatch(r"(north|south|east|west|[nsew])|([ns])(\d+)([ew])", name.lower())
    if match is None:
        return None
    if match[1]:
        return _COMPASS[match[1][0]]
    # N28W is 28 degrees from north to the west.
    turn = int(match[3]) if match[2] + match[4] in ("ne", "sw") else -int(match[3])
    return (_COMPASS[match[2]] + turn) % 360
