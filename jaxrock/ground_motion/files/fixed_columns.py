"""Columns of fixed width, as Fortran writes them, and what headers say about the values."""

import contextlib
import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .components import Component
from .text import UNIFORM, RecordText, quote_word


class Columns(NamedTuple):
    """Numbers in a full line, and characters for each."""

    number: int
    width: int


class Numbers(NamedTuple):
    """Numbers that have been read, as they are written and as values, and the next line."""

    words: list[str]
    values: np.ndarray
    end: int


# Takes a text, the index of the first line of a channel and a list, to which it appends number
# and component of the channel if this is an acceleration; returns the index of the line after it.
ChannelReader = Callable[[RecordText, int, list[tuple[str, Component]]], int]


def get_line(text: RecordText, at: int, name: str) -> str:
    """Return the line with index `at`; an error that the file ends if there is none."""
    text.refuse(at >= len(text.lines), f"the file ends before {name}")
    return text.lines[at]


def match_line(text: RecordText, at: int, pattern: str, name: str) -> re.Match[str]:
    """Match the line with index `at` against a pattern from its beginning on."""
    line = get_line(text, at, name)
    match = re.match(pattern, line, re.I)
    if match is None:
        raise text.make_error(f"{name} was expected, got {quote_word(line.strip())}", at + 1)
    return match


def parse_format(text: RecordText, words: str, line: int) -> Columns:
    """Understand a format of Fortran with one kind of number, such as (8f10.3) or (10I8)."""
    match = re.fullmatch(r"\(\s*(\d+)(?:i(\d+)|[feg](\d+)\.\d+)\s*\)", words.strip(), re.I)
    if match is None or not int(match[1]) or not int(match[2] or match[3]):
        reason = f"a format such as (8f10.3) was expected, got {quote_word(words)}"
        raise text.make_error(reason, line)
    return Columns(int(match[1]), int(match[2] or match[3]))


def read_numbers(text: RecordText, at: int, count: int, columns: Columns) -> Numbers:
    """Read `count` numbers in columns of fixed width, from the line with index `at` on.

    Every line is full except the last one, and every number ends where its column does:
    otherwise columns are shifted.
    """
    words: list[str] = []
    while len(words) < count:
        line = get_line(text, at, f"all of {count} values, {len(words)} of them are there")
        here = min(columns.number, count - len(words))
        line = line.rstrip()
        fits = len(line) == here * columns.width
        wanted = f"{here} values in columns of {columns.width} characters were expected"
        text.refuse(not fits, f"{wanted}, the line has {len(line)} characters", at + 1)
        fields = [line[k : k + columns.width] for k in range(0, len(line), columns.width)]
        for field in fields:
            wrong = field[-1] == " " or "," in field
            text.refuse(wrong, f"{wanted}, got {quote_word(field)}", at + 1)
        words += [field.lower().replace("d", "e").strip() for field in fields]
        at += 1
    with contextlib.suppress(ValueError):
        values = np.array([*map(float, words)])
        # Python would also take 1_000, which is a mistake elsewhere.
        if np.isfinite(values).all() and "_" not in "".join(words):
            return Numbers(words, values, at)
    first = at - -(-count // columns.number) + 1
    values = [
        text.parse_number(word, first + k // columns.number) for k, word in enumerate(words)
    ]
    return Numbers(words, np.array(values), at)


def require_peak(
    text: RecordText, peak: tuple[int, str, float], numbers: Numbers, factor: float
) -> None:
    """Refuse values whose peak is not the one that the header states.

    `peak` is the line of the statement, the number as it is written there, and its unit
    [m/s2]. Some programs print it without its sign. Both are rounded to their printed digits,
    and may have been numbers of single precision.
    """
    if not numbers.values.size:
        return
    line, word, unit = peak
    stated = float(word) * unit
    values = factor * numbers.values
    largest = int(np.argmax(abs(values)))
    lowest = int(np.argmin(values))
    near = unit * _find_half_unit(word) + factor * _find_half_unit(numbers.words[largest])
    near += 1e-6 * abs(stated)
    differs = abs(abs(values[largest]) - abs(stated)) > near
    differs |= stated < 0 and abs(values[lowest] - stated) > near
    found = numbers.words[lowest if stated < 0 else largest]
    scale = f" in units of {unit:.6g} m/s2" if unit != factor else ""
    text.refuse(
        bool(differs),
        f"the header states a peak of {word}{scale}, but that of the values is {found}",
        line,
    )


def require_duration(
    text: RecordText, duration: tuple[int, str, float], points: int, step: float
) -> None:
    """Refuse a number of points and a time step that do not give the header's duration.

    `duration` is the line of the statement, the number as it is written there [s], and how
    far it may be off [s]. Some programs count the steps, others the points.
    """
    line, word, near = duration
    stated = text.parse_number(word, line, "the duration")
    near += _find_half_unit(word) + UNIFORM * abs(stated)
    wrong = not (points - 1) * step - near <= stated <= points * step + near
    given = f"the header states a duration of {word} s"
    text.refuse(wrong, f"{given}, but {points} points are {step:.6g} s apart", line)


def refuse_counts(text: RecordText, wrong: bool, line: int) -> None:
    """Refuse counts of an instrument, with the way out."""
    text.refuse(
        wrong,
        "the values are counts of an instrument: convert the file to accelerations first,"
        " with obspy or gmprocess",
        line,
    )


def read_channels(text: RecordText, read_channel: ChannelReader, kind: str) -> list[Component]:
    """Read channels that stand one below the other, each by `read_channel`."""
    found: list[tuple[str, Component]] = []
    at = 0
    while at < len(text.lines):
        at = read_channel(text, at, found)
    return name_channels(text, found, kind)


def name_channels(
    text: RecordText, found: list[tuple[str, Component]], kind: str
) -> list[Component]:
    """Return components whose names tell them apart; an error with the kind if there is none.

    Each comes with the number of its channel, which stands before orientations that are the
    same.
    """
    text.refuse(not found, f"the {kind} file holds no accelerations")
    names = [each.channel.lower() for _, each in found]
    return [
        each
        if names.count(each.channel.lower()) == 1
        else each._replace(channel=f"{number}: {each.channel}")
        for number, each in found
    ]


def _find_half_unit(word: str) -> float:
    """Find half a unit of the last digit of a number, by how it is written."""
    mantissa, _, exponent = word.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)
