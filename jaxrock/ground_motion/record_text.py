"""The text of a file with a record: its lines, what is wrong with them, what has to agree."""

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..host import read_regular, with_progress
from .record_header import UNITS, Stated, steps_in_text, unit_factor, units_in_text

# Steps may differ by this fraction, since times are often printed with few digits.
UNIFORM = 1e-3

_BLOCK = 1 << 20  # bytes that are turned into numbers at a time

Lines = list[tuple[int, str]]  # with their numbers, counted from 1 on

_LINE_END = re.compile(rb"\r\n|\r|\n")
_BINARY = bytes({*range(0x20)} - {*b"\t\n\v\f\r"})


class Text(NamedTuple):
    """The content of a file."""

    path: Path
    content: bytes = b""
    end: int = 0  # of what is not blank

    def fault(self, reason: str, line: int | None = None) -> ValueError:
        """What is wrong with the file, or with one line of it."""
        where = repr(str(self.path)) + ("" if line is None else f", line {line}")
        return ValueError(f"{where}: {reason}")

    def number(self, word: str, line: int, name: str = "a value") -> float:
        """A word of a line as a finite number; `name` says of what."""
        try:
            value = float(word.replace("_", "?"))  # Python's 1_000 is no number elsewhere
        except ValueError:
            got = short(word) if word.strip() else "an empty field"
            raise self.fault(f"{name} must be a number, got {got}", line) from None
        if not math.isfinite(value):
            raise self.fault(f"{name} must be finite, got {short(word)}", line)
        return value

    def lines(self) -> Iterator[tuple[int, str, int]]:
        """The number and text of each line, and the byte at which the next one begins."""
        number, start = 0, 0
        while start < self.end:
            found = _LINE_END.search(self.content, start, self.end)
            stop, following = found.span() if found else (self.end, self.end)
            number += 1
            yield number, self.decoded(start, stop), following
            start = following

    def blocks(self, start: int, line: int) -> Iterator[tuple[int, list[str]]]:
        """What begins at byte `start` with line number `line`, as first numbers and lines."""
        spans = []
        while start < self.end:
            stop = self.content.find(b"\n", start + _BLOCK, self.end) + 1 or self.end
            spans.append((start, stop))
            start = stop
        for span in with_progress(spans, f"reading {self.path.name} [MB]"):
            block = self.decoded(*span).replace("\r\n", "\n").replace("\r", "\n")
            lines = block.removesuffix("\n").split("\n")
            yield line, lines
            line += len(lines)

    def decoded(self, start: int, stop: int) -> str:
        """What is between two bytes, as text."""
        content = self.content[start:stop]
        if len(content.translate(None, _BINARY)) < len(content):
            raise self.fault("a text file was expected, this one is binary")
        try:
            return content.decode()
        except UnicodeDecodeError:
            return content.decode("latin-1")  # names of stations; numbers are the same in both


def read_text(path: Path) -> Text:
    """The text of a file, or a `ValueError` if it cannot be read or is none."""
    text = Text(path)
    try:
        content = read_regular(path).removeprefix(b"\xef\xbb\xbf")
    except OSError as error:
        raise text.fault(f"the file cannot be read: {error.strerror or error}") from error
    end, blank = len(content), True
    while end and blank:
        tail = content[max(0, end - _BLOCK) : end]
        kept = len(tail.rstrip(b"\x1a\r\n\t "))  # old files end as under DOS, with a Ctrl-Z
        end, blank = end - len(tail) + kept, not kept
    if not end:
        raise text.fault("the file is empty")
    return text._replace(content=content, end=end)


def agreed_step(
    text: Text,
    header: Lines,
    step: float | None,
    given: float | None,
    top: int | None = None,
    names: Sequence[str] = (),
) -> float:
    """The time step [s] that the file and the caller say, or a fault if they say several."""
    for number, line in header:
        for stated in steps_in_text(line):
            if math.isnan(stated.value):
                raise text.fault(f"the time step is not understood: {short(stated.words)}", number)
            if step is None:
                step = stated.value
            if not 0 < stated.value < math.inf or abs(stated.value - step) > UNIFORM * step:
                raise text.fault(
                    f"the time step is {stated.value:.6g} s here, but {step:.6g} s elsewhere",
                    number,
                )
    known = step if given is None else given
    if known is None:
        raise text.fault(
            f"time_step must be given, since no column of times is among {listed([*names])}", top
        )
    if step is not None and abs(known - step) > UNIFORM * step:
        raise text.fault(f"time_step is {given} s, but the file has {step:.6g} s")
    return known


def given_unit(unit: str | None) -> Stated | None:
    """What the caller says of the unit, if anything."""
    return None if unit is None else Stated(f"unit is {unit!r}", factor_of(unit))


def stated_units(header: Lines) -> list[tuple[int, Stated]]:
    """The units that lines state, with the numbers of these lines."""
    return [(number, stated) for number, line in header for stated in units_in_text(line)]


def agreed_unit(
    text: Text, known: Stated | None, where: str, said: list[tuple[int, Stated]]
) -> Stated | None:
    """What is `known` of the unit, or else said in the file, or a fault if that differs."""
    for number, (words, value) in said:
        if known is None and not math.isnan(value):
            known = Stated(f"line {number} states {words}", value)
        elif known is None:
            raise text.fault(f"{where} states {words}, which is not {ALLOWED}", number)
        elif not math.isclose(known.value, value):
            raise text.fault(f"{known.words}, but {where} states {words}", number)
    return known


def factor_of(unit: str) -> float:
    """What a unit is in m/s2."""
    factor = unit_factor(unit)
    if factor is None:
        raise ValueError(f"unit must be {ALLOWED}, got {unit!r}")
    return factor


def in_si(factor: float, values: np.ndarray) -> np.ndarray:
    """Accelerations in m/s2, from their unit."""
    with np.errstate(over="ignore"):  # inf, which a record refuses
        return factor * values


def listed(names: list[str]) -> str:
    """The first of several names, for a message."""
    return ", ".join([short(name) for name in names[:12]]) + (", ..." if names[12:] else "")


def short(word: str) -> str:
    """In quotes, cut if it is no word but half a file."""
    return repr(word if len(word) <= 60 else f"{word[:57]}...")


ALLOWED = f"one of {listed(list(UNITS))}"
