"""Components of ground motions as files state them, what a caller states, and their records."""

import math
import re
import warnings
from typing import Literal, NamedTuple

import numpy as np

from ...tables import UNITS_OF_ACCELERATION, NamedFile, as_number
from ...validation import POSITIVE, as_real, check
from ..drift import warn_of_drift
from ..record import Record
from ..units import convert_unit, require_unit

Direction = Literal["level", "up", "down", ""]

# Relative difference of time steps that count as the same: files print them with few digits.
UNIFORM = 1e-3
# No ground has moved so fast: a larger PGA [m/s2] is one of other units, or of counts.
_LARGEST_PGA = 20 * 9.80665
# Names of channels, and of the axes of columns. An azimuth is level.
_WORDS: dict[Direction, str] = {
    "up": "up u ud v z 3 vertical vert ver vrt",
    "down": "down dn dwn",
    "level": "north east south west n e s w ns ew h1 h2 1 2 x y l t r",
}
DIRECTIONS: dict[str, Direction] = {
    word: to for to, words in _WORDS.items() for word in words.split()
}
_AZIMUTH = re.compile(r"h?\d{2,3}|[ns]\d{1,2}[ew]|0")
# A channel of SEED ends in its direction; KiK-net adds the number of its sensor.
_SEED = re.compile(r"[behs][hlgn]([zne12xy])|(ns|ew|ud)[12]")


class NotAcceleration(ValueError):
    """A file states that it holds something else than accelerations of the ground."""


class Caller(NamedTuple):
    """What a caller states: the unit in words and in m/s2, and the time step [s]; None for none."""

    unit: str | None = None
    factor: float | None = None
    step: float | None = None

    def choose_unit(self, file: NamedFile, stated: str) -> float:
        """Return the unit [m/s2] that the file states, or else the caller; they must agree."""
        factor = convert_unit(stated) if stated else self.factor
        if factor is None or math.isnan(factor):
            seen = f"the unit {stated!r} is unknown" if stated else "no unit is stated"
            raise file.error(f"{seen}: give unit, {UNITS_OF_ACCELERATION}")
        if not math.isclose(factor, self.factor or factor):
            raise file.error(f"unit is {self.unit!r}, but the file states {stated!r}")
        return factor

    def choose_step(self, file: NamedFile, stated: float | None) -> float:
        """Return the time step [s] that the file states, or else the caller; they must agree."""
        step = self.step if stated is None else stated
        if step is None:
            raise file.error("no time step is stated: give time_step, in s")
        if not 0 < step < math.inf:
            raise file.error(f"a time step must be finite and greater than 0, got {step:g} s")
        if not math.isclose(step, self.step or step, rel_tol=UNIFORM):
            raise file.error(f"time_step is {self.step:g} s, but the file states {step:g} s")
        return step


def make_caller(unit: str | None, time_step: float | int | None) -> Caller:
    """Check what a caller states."""
    if time_step is not None:
        check("time_step", as_real("time_step", time_step, unit="s"), POSITIVE)
        time_step = float(time_step)
    return Caller(unit, None if unit is None else require_unit(unit), time_step)


class Component(NamedTuple):
    """A row of accelerations [m/s2] and its time step [s].

    `name` is for errors; `channel` and `direction` are as the file states them, or empty.
    """

    name: str
    values: np.ndarray
    step: float
    channel: str = ""
    direction: Direction = ""


def make_component(
    file: NamedFile,
    caller: Caller,
    values: np.ndarray,
    *,
    unit: str,
    step: float | None,
    channel: str = "",
    direction: Direction | None = None,
) -> Component:
    """Make a component of what a header states, which has to agree with the caller.

    The unit is that of the values, the time step in s; they are empty or None where the header does
    not state them. Without a direction the name of the channel says where it points.
    """
    values = caller.choose_unit(file, unit) * values
    direction = find_direction(channel) if direction is None else direction
    name = f"{str(file.path)!r} {channel}".rstrip()
    return Component(name, values, caller.choose_step(file, step), channel, direction)


def require_number(file: NamedFile, word: str, line: int = 0) -> float:
    """Convert a word of a header to a number; a `ValueError` if it is none."""
    number = as_number(word)
    if number is None:
        raise file.error(f"a number was expected in the header, got {word!r}", line)
    return number


def invert(rate: float) -> float:
    """Convert a sampling rate to a time step, infinite for 0."""
    return 1 / rate if rate else math.inf


def find_direction(channel: str) -> Direction:
    """Find where a channel points by its name; "" if that does not say so."""
    word = channel.lower()
    if match := _SEED.fullmatch(word):
        word = match[1] or match[2]
    return "level" if _AZIMUTH.fullmatch(word) else DIRECTIONS.get(word, "")


def make_record(horizontal: Component, *upward: Component) -> Record:
    """Make the record of one or two components; a `ValueError` if they do not fit together.

    A warning says if the peak ground acceleration is beyond belief, or if the peak ground velocity
    is due to a drift.
    """
    name, values, step = horizontal[:3]
    for other in upward:
        if other.direction in ("down", "level"):
            raise ValueError(
                f"{other.name} points {other.direction}, a vertical component must be positive"
                " upward: give its values, times -1 if need be, as Record(vertical=)"
            )
        if not math.isclose(other.step, step, rel_tol=1e-6):
            raise ValueError(
                f"{other.name} has a step of {other.step:g} s, {name} of {step:g} s"
            )
    try:
        record = Record(values, step, *(other.values for other in upward))
    # Too few samples, or accelerations too large for the precision of JAX.
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    peak = abs(values).max()
    if peak > _LARGEST_PGA:
        warnings.warn(f"{name}: a PGA of {peak:.4g} m/s2: is the unit right?", stacklevel=2)
    warn_of_drift(name, record)
    return record
