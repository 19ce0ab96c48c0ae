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
seconds       of the record in whole seconds, rounded up, down or to the nearest
unit          of the values, in words
peak          the largest value or the smallest, with or without its sign
peak_unit     unit of the peak, in words, where it differs from the unit of the values
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
from types import MappingProxyType

import numpy as np

from ...oldtables import (
    NUMBER,
    Statement,
    TextFile,
    as_number,
    collect_statements,
    find_steps,
    find_units,
    quote_word,
)
from .claims import UNIFORM, Claims
from .components import Component, Direction
from .directions import find_channel_direction
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
_COMPASS = {"n": 0.0, "e": 90.0, "s": 180.0, "w": 270.0}
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


class Header:
    """The statements in the header of a channel or of a file."""

    def __init__(
        self,
        text: TextFile,
        claims: Claims,
        names: Mapping[str, Direction] = MappingProxyType({}),
        codes: Mapping[int, Direction] = MappingProxyType({}),
    ):
        """Begin with what the caller states, and with what names and codes of a format mean."""
        self.text = text
        # What the caller and the file state of unit and time step.
        self.claims = claims
        # Directions by patterns of the format's own names of channels, and by its numbers.
        self.names = names
        self.codes = codes
        # By their names, in the order of the file: the words as they are written, and their
        # values, NaN where they are no numbers.
        self.fields: dict[str, list[Statement]] = {}

    def add(self, name: str, line: int, word: str) -> None:
        """Add a statement."""
        value = as_number(word)
        statement = Statement(line, word, math.nan if value is None else value)
        self.fields.setdefault(name, []).append(statement)

    def add_unit(self, line: int, words: str, unit: str | float) -> None:
        """Add a unit that the file states in other words than by its name."""
        self.claims = self.claims.add_unit(line, words, unit)

    def read_text(self, lines: Iterable[tuple[int, str]], where: str) -> None:
        """Add units and time steps that running text states; `where` says what it is."""
        lines = [*lines]
        units = (*self.claims.units, *collect_statements(find_units, lines, where))
        steps = (*self.claims.steps, *collect_statements(find_steps, lines, where))
        self.claims = Claims(units, steps)

    def read_line(self, at: int, pattern: str, description: str) -> None:
        """Add the groups of a pattern that the line with index `at` has to match.

        A name that the pattern has twice ends in _2 in its second place.
        """
        match = match_line(self.text, at, pattern, description)
        for name, word in match.groupdict().items():
            if word is not None:
                self.add(name.removesuffix("_2"), at + 1, word)

    def read_numbers(
        self,
        at: int,
        count: int,
        columns: Columns,
        names: Mapping[int, str],
        missing: float = math.nan,
    ) -> int:
        """Add numbers of a block, with names by their indices; return the line after it."""
        numbers = read_numbers(self.text, at, count, columns)
        for index, name in names.items():
            # What the format writes where it states nothing.
            if numbers.values[index] != missing:
                self.add(name, at + index // columns.number + 1, numbers.words[index])
        return numbers.end

    def find(self, name: str) -> Statement | None:
        """Find the first statement of a name."""
        return next(iter(self.fields.get(name, [])), None)

    def require_points(self) -> int:
        """Return the number of values, on which all statements have to agree."""
        counts: list[Statement] = []
        for line, word, value in self.fields.get("points", []):
            words = f"the header states {word} values"
            counts.append(Statement(line, words, value))
            if not (value >= 2 and value % 1 == 0):
                raise self.text.error(f"{words}, where a whole number from 2 on belongs", line)
        missing = "the header does not state the number of values"
        return int(self.text.require_agreement(counts, "a number", 0.0, missing))

    def require_unit(self, missing: str = "the header states no unit") -> float:
        """Return the unit of the values [m/s2], on which file and caller have to agree."""
        for line, word, _ in self.fields.get("unit", []):
            if word.lower().startswith("count"):
                raise self.text.error(NO_COUNTS, line)
            # "in g." ends a sentence.
            unit = word.rstrip(".")
            self.add_unit(line, f"the header states {unit}", unit)
        return self.claims.require_unit(self.text, missing)

    def require_step(self) -> float:
        """Return the time step [s], on which file and caller have to agree."""
        for name, unit in _STEPS.items():
            for line, word, value in self.fields.get(name, []):
                step = value / 1000 if name == "milliseconds" else value
                if name == "rate" and value != 0:
                    step = 1 / value
                if not step >= _SHORTEST:
                    shortest = f"a time step from {_SHORTEST:g} s on was expected"
                    raise self.text.error(f"{shortest}, got {word} {unit}", line)
                printed = f"{value:g}" if name == "rate" else word
                words = f"the header states {printed} {unit}"
                self.claims = self.claims.add_step(line, words, step)
        return self.claims.require_step(self.text, "the header states no time step")

    def require_even_times(self, words: Sequence[str], times: np.ndarray, line: int) -> float:
        """Return the even step [s] of the `times` beside the values, from a line on."""
        stated = [step.value for step in self.claims.steps]
        step = find_uniform_step(times) or find_printed_step(words, times, stated)
        if step is None:
            steps = np.diff(times)
            raise self.text.error(
                f"the times beside the values are not evenly spaced, from {steps.min():.6g} to"
                f" {steps.max():.6g} s: take volume 2 of the record or a corrected file",
                line,
            )
        spaced = f"the times beside the values are {step:.6g} s apart"
        self.claims = self.claims.add_step(line, spaced, step)
        return self.require_step()

    def require_duration(self, points: int, step: float) -> None:
        """Raise an error if so many points with this step do not last as long as stated."""
        for name, rounding in (("duration", 0.0), ("seconds", 1.0)):
            for line, word, _ in self.fields.get(name, []):
                duration = self.text.parse_number(word, line, "the duration")
                near = rounding + _find_half_unit(word) + UNIFORM * abs(duration)
                # Some programs count the steps, others the points.
                if not (points - 1) * step - near <= duration <= points * step + near:
                    stated = f"the header states a duration of {word} s"
                    spaced = f"{points} points are {step:.6g} s apart"
                    raise self.text.error(f"{stated}, but {spaced}", line)

    def require_peak(self, numbers: Numbers, factor: float, name: str = "the values") -> None:
        """Raise an error if the peak of numbers, called `name`, is not the one that is stated.

        Of several that are stated, such as the largest value and the smallest, the one of the
        largest size counts. Some programs print it without its sign. The tolerance is half the
        last printed digit of both numbers, and 1e-6 for single precision.
        """
        words, values, _ = numbers
        peaks = self.fields.get("peak", [])
        if not peaks or not values.size:
            return
        for line, word, _ in peaks:
            self.text.parse_number(word, line, "the peak")
        line, word, value = max(peaks, key=lambda peak: abs(peak.value))
        # In the unit of the values, if the header states no other one.
        unit = factor
        for place, words_of_unit, _ in self.fields.get("peak_unit", []):
            stated_unit = f"the header states a peak in {words_of_unit}"
            unit = Claims().add_unit(place, stated_unit, words_of_unit).require_unit(self.text)
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
            raise self.text.error(
                f"the header states a peak of {word}{scale}, but that of {name} is {printed}",
                line,
            )

    def require_direction(self) -> Direction:
        """Return where the channel points, on which its name, azimuth and code have to agree."""
        channel = self.find("channel")
        degrees = find_azimuth(channel.words) if channel else None
        named: Direction | None = "" if degrees is None else "level"
        if channel and degrees is None:
            named = find_channel_direction(channel.words, self.names)
            if named is None:
                raise self.text.error(
                    "an orientation such as '360 deg', 'N28W', 'Up' or 'Down' was expected, got"
                    f" {quote_word(channel.words)}",
                    channel.line,
                )
        azimuth = self.find("azimuth")
        stated = azimuth or self.find("code")
        if stated is None:
            return named
        orientation = f"the header states an orientation of {stated.words}"
        if azimuth is None and stated.value not in self.codes:
            raise self.text.error(f"{orientation}, which is not understood", stated.line)
        coded: Direction = "level" if azimuth else self.codes[int(stated.value)]
        is_turned = azimuth and degrees is not None and (azimuth.value - degrees) % 360 != 0
        if channel and (is_turned or (named and coded and named != coded)):
            name = f"the channel is {channel.words} in line {channel.line}"
            raise self.text.error(f"{name}, but {orientation}", stated.line)
        return named or coded

    def read_component(self, at: int, columns: Columns | None = None) -> tuple[Component, int]:
        """Read accelerations, check all that is stated of them, and return the line after."""
        points = self.require_points()
        factor = self.require_unit()
        step = self.require_step()
        self.require_duration(points, step)
        if columns is not None:
            numbers = read_numbers(self.text, at, points, columns)
        else:
            # All numbers from there on.
            values = read_free_numbers(self.text, at)
            # How they are printed matters only beside a peak.
            printed = "\n".join(self.text.lines[at:]) if "peak" in self.fields else ""
            words = printed.split()
            # Some may run together where a sign stands between; this pattern is slow.
            if len(words) < values.size:
                words = re.findall(NUMBER, printed, re.I)
            numbers = Numbers(words, values, len(self.text.lines))
        if numbers.values.size != points:
            raise self.text.error(
                f"the header states {points} values, but {numbers.values.size} follow",
                self.fields["points"][0].line,
            )
        self.require_peak(numbers, factor)
        return self.make_component(factor, numbers.values, step), numbers.end

    def make_component(self, factor: float, values: np.ndarray, step: float) -> Component:
        """Make a component with the channel's name, if the header states one."""
        channel = self.find("channel")
        name = channel.words if channel else ""
        direction = self.require_direction()
        return Component(repr(str(self.text.path)), factor, values, step, direction, name)


def read_channels(
    text: TextFile, claims: Claims, read_channel: ChannelReader, kind: str
) -> list[Component]:
    """Read channels that stand one below the other, and name them so that they differ."""
    numbered: list[Numbered] = []
    at = 0
    while at < len(text.lines):
        channels, at = read_channel(text, claims, at)
        numbered += channels
    if not numbered:
        raise text.error(f"the {kind} file holds no accelerations")
    names = [component.channel.lower() for _, component in numbered]
    components: list[Component] = []
    for k, (number, component) in enumerate(numbered, 1):
        channel = component.channel
        # The number stands before an orientation that is there more than once.
        if names.count(channel.lower()) > 1:
            channel = f"{number or k}: {channel}"
        name = f"{component.name} {channel}"
        components.append(component._replace(name=name, channel=channel))
    return components


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
