"""Directions of channels, by the names, azimuths and codes of headers, which have to agree."""

import re
from collections.abc import Mapping
from types import MappingProxyType

from ...tables import TextFile, quote_word
from .components import Direction
from .directions import find_channel_direction
from .headers import Header, HeaderField


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
    named: Direction = "" if channel is None else _find_named(text, channel, names)
    stated = header.find("azimuth")
    coded: Direction = "level"
    if stated is None:
        stated = header.find("code")
        if stated is None:
            return named
        if stated.value not in codes:
            raise text.error(
                f"the header states an orientation of {stated.word}, which is not understood",
                stated.line,
            )
        coded = codes[int(stated.value)]
    elif channel is not None:
        degrees = find_azimuth(channel.word)
        if degrees is not None and (stated.value - degrees) % 360 != 0:
            raise _make_error(text, channel, stated)
    if channel is not None and named and coded and named != coded:
        raise _make_error(text, channel, stated)
    return named or coded


def find_azimuth(name: str) -> float | None:
    """Find the degrees from north of a name such as 340, N28W, S or East; None for others."""
    if name.isdigit() and int(name) <= 360:
        return float(name)
    match = re.fullmatch(r"(n|s)(\d+)(e|w)|(n|s|e|w|north|south|east|west)", name, re.I)
    if match is None:
        return None
    begin = (match[1] or match[4])[0].lower()
    degrees = {"n": 0.0, "e": 90.0, "s": 180.0, "w": 270.0}[begin]
    if match[4]:
        return degrees
    # N28W is 28 degrees from north to the west.
    clockwise = begin + match[3].lower() in ("ne", "sw")
    return (degrees + (1 if clockwise else -1) * int(match[2])) % 360


def _find_named(
    text: TextFile, channel: HeaderField, names: Mapping[str, Direction]
) -> Direction:
    """Find the direction of a name; an error if it is not understood."""
    if find_azimuth(channel.word) is not None:
        return "level"
    direction = find_channel_direction(channel.word, names)
    if direction is not None:
        return direction
    raise text.error(
        "an orientation such as '360 deg', 'N28W', 'Up' or 'Down' was expected, got"
        f" {quote_word(channel.word)}",
        channel.line,
    )


def _make_error(text: TextFile, channel: HeaderField, stated: HeaderField) -> ValueError:
    """Make the error that name and number of an orientation differ."""
    return text.error(
        f"the channel is {channel.word} in line {channel.line}, but the header states an"
        f" orientation of {stated.word}",
        stated.line,
    )
