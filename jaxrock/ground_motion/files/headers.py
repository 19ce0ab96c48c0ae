"""Headers of records: what they state, understood once for all formats and held to be true.

A format describes in tables where its header states what. The names of statements are these,
whatever the format; further names are the format's own.

============  ===============================================================================
name          what is stated
============  ===============================================================================
points        how many values follow
step          time step [s]
milliseconds  time step [ms]
rate          samples per second
duration      of the record [s]
seconds       of the record in whole seconds, rounded in one way or another
unit          of the values, in words
peak          the largest value or the smallest, perhaps without its sign
peak_unit     of the peak, in words, if it is not that of the values
number        of the channel in the record
channel       name of the channel: an azimuth, a point of the compass, Up, H1 or the like
azimuth       where it points, in degrees from north
code          where it points, by the format's own numbers
============  ===============================================================================

A header may state the same in several places: `Header` requires that all of them agree, with
what the caller states, and with the values.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...tables import (
    NUMBER,
    UNITS_OF_ACCELERATION,
    Statement,
    TextFile,
    collect_statements,
    find_steps,
    find_units,
)
from ..units import convert_unit
from .claims import UNIFORM, Claims
from .components import Component, Direction
from .fixed_columns import Columns, Numbers, match_line, read_numbers
from .plain import read_free_numbers
from .printed_times import find_printed_step, find_uniform_step

# A number in decimals, in a pattern.
DECIMAL = r"[-+]?(?:\d+\.?\d*|\.\d+)"
# Names of statements about the time step, and their units. Shorter steps [s] are mistakes.
_STEPS = {"step": "s", "milliseconds": "ms", "rate": "samples per second"}
_SHORTEST = 1e-5
# Significant digits of a number of single precision, which headers are computed in.
_SIGNIFICANT = 6
NO_COUNTS = (
    "the values are counts of an instrument, no accelerations: take a processed file of the"
    " record, or remove the response from its waveform by obspy and use"
    " jaxrock.ground_motion.from_obspy"
)

# A component and the number of its channel.
Numbered = tuple[str, Component]
# Takes a text and the index of the first line of a channel; returns its accelerations, if it
# has some, and the index of the line after it.
ChannelReader = Callable[[TextFile, Claims, int], tuple[list[Numbered], int]]


class HeaderField(NamedTuple):
    """A statement: the number of its line, the word that stands there, its value or NaN."""

    line: int
    word: str
    value: float


class Header:
    """The statements in the header of a channel or of a file.

    Attributes
    ----------
    fields : dict
        Statements by their names: those that are there, in the order of the file.
    """

    def __init__(self, text: TextFile, claims: Claims):
        """Begin with what the caller states."""
        self._text = text
        self._claims = claims
        self.fields: dict[str, list[HeaderField]] = {}

    def add(self, name: str, line: int, word: str) -> None:
        """Add a statement."""
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        self.fields.setdefault(name, []).append(HeaderField(line, word, value))

    def add_unit(self, line: int, words: str, unit: str | float) -> None:
        """Add a unit that the file states in other words than by its name."""
        self._claims = self._claims.add_unit(line, words, unit)

    def add_step(self, line: int, words: str, step: float) -> None:
        """Add a time step [s] that the file states in other words than by its number."""
        self._claims = self._claims.add_step(line, words, step)

    def read_text(self, lines: Iterable[tuple[int, str]], where: str) -> None:
        """Add units and time steps that running text states; `where` says what it is."""
        lines = [*lines]
        for line, words, unit in collect_statements(find_units, lines, where):
            self.add_unit(line, words, unit)
        for line, words, step in collect_statements(find_steps, lines, where):
            self.add_step(line, words, step)

    def read_line(self, at: int, pattern: str, description: str) -> None:
        """Add the groups of a pattern that the line with index `at` has to match."""
        match = match_line(self._text, at, pattern, description)
        for name, word in match.groupdict().items():
            if word is not None:
                self.add(name, at + 1, word)

    def read_numbers(
        self,
        at: int,
        count: int,
        columns: Columns,
        names: Mapping[int, str],
        missing: float = math.nan,
    ) -> int:
        """Add numbers of a block in columns, with names by their indices.

        `missing` is what the format writes where it states nothing. Returns the index of the
        line after the block.
        """
        numbers = read_numbers(self._text, at, count, columns)
        for index, name in names.items():
            if numbers.values[index] != missing:
                self.add(name, at + index // columns.number + 1, numbers.words[index])
        return numbers.end

    def find(self, name: str) -> HeaderField | None:
        """Find the first statement of a name."""
        return next(iter(self.fields.get(name, [])), None)

    def require_points(self) -> int:
        """Return the number of values, on which all statements have to agree."""
        counts = [
            Statement(line, f"the header states {word} values", value)
            for line, word, value in self.fields.get("points", [])
        ]
        for line, words, value in counts:
            if not (value >= 2 and value % 1 == 0):
                raise self._text.error(
                    f"{words}, where a whole number from 2 on belongs", line
                )
        missing = "the header does not state the number of values"
        return int(self._text.require_agreement(counts, "a number", 0.0, missing))

    def require_unit(self, missing: str = "") -> float:
        """Return the unit of the values [m/s2], on which file and caller have to agree."""
        for line, word, _ in self.fields.get("unit", []):
            if word.lower().startswith("count"):
                raise self._text.error(NO_COUNTS, line)
            # "in g." ends a sentence.
            unit = word.rstrip(".")
            self.add_unit(line, f"the header states {unit}", unit)
        return self._claims.require_unit(self._text, missing)

    def require_step(self, missing: str = "") -> float:
        """Return the time step [s], on which file and caller have to agree."""
        for name, unit in _STEPS.items():
            for line, word, value in self.fields.get(name, []):
                step = value / 1000 if name == "milliseconds" else value
                if name == "rate" and value != 0:
                    step = 1 / value
                if not step >= _SHORTEST:
                    raise self._text.error(
                        f"a time step from {_SHORTEST:g} s on was expected, got {word} {unit}",
                        line,
                    )
                printed = f"{value:g}" if name == "rate" else word
                self.add_step(line, f"the header states {printed} {unit}", step)
        return self._claims.require_step(self._text, missing)

    def require_even_times(self, words: Sequence[str], times: np.ndarray, line: int) -> float:
        """Return the step [s] of the `times` that stand beside the values.

        They have to be printed times of an even step, which is what the caller and the header
        state. `line` is where they begin.
        """
        stated = [step.value for step in self._claims.steps]
        step = find_uniform_step(times) or find_printed_step(words, times, stated)
        if step is None:
            steps = np.diff(times)
            raise self._text.error(
                f"the times beside the values are not evenly spaced, from {steps.min():.6g} to"
                f" {steps.max():.6g} s, as where film was digitized: take volume 2 of the record"
                " or a corrected file, which has an even step",
                line,
            )
        self.add_step(line, f"the times beside the values are {step:.6g} s apart", step)
        return self.require_step()

    def require_duration(self, points: int, step: float) -> None:
        """Raise an error if so many points with this step do not last as long as stated.

        Some programs count the steps, others the points.
        """
        stated = [(duration, 0.0) for duration in self.fields.get("duration", [])]
        stated += [(seconds, 1.0) for seconds in self.fields.get("seconds", [])]
        for (line, word, _), near in stated:
            duration = self._text.parse_number(word, line, "the duration")
            near += _find_half_unit(word) + UNIFORM * abs(duration)
            if not (points - 1) * step - near <= duration <= points * step + near:
                raise self._text.error(
                    f"the header states a duration of {word} s, but {points} points are"
                    f" {step:.6g} s apart",
                    line,
                )

    def require_peak(self, numbers: Numbers, factor: float, name: str = "the values") -> None:
        """Raise an error if the peak of numbers, called `name`, is not the one that is stated.

        Of several that are stated, such as the largest value and the smallest, the one of the
        largest size counts. Some programs print it without its sign. Both numbers are rounded
        to their printed digits, and may have been numbers of single precision.
        """
        words, values, _ = numbers
        if "peak" not in self.fields or not values.size:
            return
        peaks = self.fields["peak"]
        for line, word, _ in peaks:
            self._text.parse_number(word, line, "the peak")
        line, word, value = max(peaks, key=lambda peak: abs(peak.value))
        unit = self._find_peak_unit(factor)
        stated = value * unit
        accelerations = factor * values
        largest = int(np.argmax(abs(accelerations)))
        lowest = int(np.argmin(accelerations))
        near = unit * _find_half_unit(_strip_padding(word))
        near += factor * _find_half_unit(words[largest]) + 1e-6 * abs(stated)
        differs = abs(abs(accelerations[largest]) - abs(stated)) > near
        if differs or (stated < 0 and abs(accelerations[lowest] - stated) > near):
            scale = f" in units of {unit:.6g} m/s2" if unit != factor else ""
            printed = words[lowest if stated < 0 else largest]
            raise self._text.error(
                f"the header states a peak of {word}{scale}, but that of {name} is {printed}",
                line,
            )

    def read_component(
        self, at: int, direction: Direction, columns: Columns | None = None
    ) -> tuple[Component, int]:
        """Read accelerations, and check all that the header states of them.

        They begin in the line with index `at`. Without columns all numbers from there on are
        theirs. Returns them and the index of the line after.
        """
        points = self.require_points()
        factor = self.require_unit("the header states no unit")
        step = self.require_step("the header states no time step")
        self.require_duration(points, step)
        if columns is not None:
            numbers = read_numbers(self._text, at, points, columns)
        else:
            values = read_free_numbers(self._text, at)
            # How they are printed matters only beside a peak.
            printed = "\n".join(self._text.lines[at:]) if "peak" in self.fields else ""
            words = printed.split()
            # Some may run together where a sign stands between; this pattern is slow.
            if len(words) < values.size:
                words = re.findall(NUMBER, printed, re.I)
            numbers = Numbers(words, values, len(self._text.lines))
        if numbers.values.size != points:
            raise self._text.error(
                f"the header states {points} values, but {numbers.values.size} follow",
                self.fields["points"][0].line,
            )
        self.require_peak(numbers, factor)
        return self.make_component(factor, numbers.values, step, direction), numbers.end

    def make_component(
        self, factor: float, values: np.ndarray, step: float, direction: Direction
    ) -> Component:
        """Make a component with the channel's name, if the header states one."""
        channel = self.find("channel")
        name = repr(str(self._text.path))
        return Component(
            name, factor, values, step, direction, channel.word if channel else ""
        )

    def _find_peak_unit(self, factor: float) -> float:
        """Find the unit [m/s2] in which the peak is stated: if it is not, that of the values."""
        stated = self.find("peak_unit")
        if stated is None:
            return factor
        unit = convert_unit(stated.word)
        if math.isnan(unit):
            raise self._text.error(
                f"the header states a peak in {stated.word}, which is not {UNITS_OF_ACCELERATION}",
                stated.line,
            )
        return unit


def read_channels(
    text: TextFile, claims: Claims, read_channel: ChannelReader, kind: str
) -> list[Component]:
    """Read channels that stand one below the other, and name them so that they differ.

    The number of its channel stands before an orientation that is there more than once. Raises
    a `ValueError` that names the `kind` of file if there is no acceleration.
    """
    numbered: list[Numbered] = []
    at = 0
    while at < len(text.lines):
        accelerations, at = read_channel(text, claims, at)
        numbered += accelerations
    if not numbered:
        raise text.error(f"the {kind} file holds no accelerations")
    names = [component.channel.lower() for _, component in numbered]
    channels = [
        component.channel if names.count(name) == 1 else f"{number or k}: {component.channel}"
        for k, (name, (number, component)) in enumerate(zip(names, numbered, strict=True), 1)
    ]
    return [
        component._replace(name=f"{component.name} {channel}", channel=channel)
        for channel, (_, component) in zip(channels, numbered, strict=True)
    ]


def _find_half_unit(word: str) -> float:
    """Find half a unit of the last digit of a number, by how it is written."""
    mantissa, _, exponent = word.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def _strip_padding(word: str) -> str:
    """Strip zeros at the end of a number in decimals, beyond as many digits as are significant.

    COSMOS's own example states a peak of -161.962000, where the values reach -161.96180: a
    number of six digits was put into a column with six decimals.
    """
    if "." not in word or "e" in word.lower():
        return word
    digits = len(word.lstrip("-+0.").replace(".", ""))
    padding = min(len(word) - len(word.rstrip("0")), max(digits - _SIGNIFICANT, 0))
    return word[: len(word) - padding]
