"""What commands have in common: options, checks before anything runs, and what they answer."""

import abc
import csv
import functools
import json
import math
import weakref
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import tyro

from ..block import Block, housner_restitution
from ..ground_motion import PULSES, Motion, Record, example_record, read_record
from ..host import check_free, written_whole
from ..validation import POSITIVE, UNIT_INTERVAL, check

Grid = tuple[str, ...]
ModelName = Literal["linearized", "nonlinear"]
PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]


class Answer(NamedTuple):
    """What a command has to say: as text, as data for JSON, the exit code, what went wrong."""

    text: str
    data: Mapping[str, Any]
    code: int = 0
    errors: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Command(abc.ABC):
    """One command: its options are its fields."""

    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print JSON; null stands for what does not exist or never happens."""
    no_cache: bool = False
    """Compile everything afresh: neither take nor keep what commands have compiled."""

    @abc.abstractmethod
    def check(self) -> None:
        """Raise `ValueError` for what is not allowed, before anything expensive is done."""

    @abc.abstractmethod
    def run(self) -> Answer:
        """Do it."""

    def refuse(self, *names: str, only_with: str) -> None:
        """Raise `ValueError` if one of these options is given, since it would be ignored."""
        default = {field.name: field.default for field in fields(self)}
        for name in names:
            if getattr(self, name) != default[name]:
                raise ValueError(f"{name} goes with {only_with} only")


# What a command has besides what it is about.
COMMON = frozenset(field.name for field in fields(Command))


@dataclass(frozen=True, kw_only=True)
class Writing(Command):
    """A command that writes files."""

    out: Path | None
    """Folder to write to; made if it is missing."""
    force: bool = False
    """Overwrite existing files."""

    @property
    @abc.abstractmethod
    def names(self) -> Sequence[str]:
        """The names of its files."""

    @property
    def files(self) -> list[str]:
        """The paths of its files; none without a folder."""
        return [] if self.out is None else [str(self.out / name) for name in self.names]

    def check(self) -> None:
        """Files that exist are in the way unless they may be overwritten."""
        if self.out is not None:
            check_free("out", self.out, self.names, self.force)

    def written(self) -> AbstractContextManager[Path]:
        """A folder to write the files into, all or none; see `written_whole`."""
        assert self.out is not None
        return written_whole("out", self.out, self.names, self.force)

    def finished(self, text: str, data: Mapping[str, Any], code: int = 0) -> Answer:
        """The answer, with the files that were written."""
        return Answer("\n".join([text, *self.files]), {**data, "files": self.files}, code)


@dataclass(frozen=True, kw_only=True)
class BlockOptions:
    """Options that describe one block."""

    width: float = 0.8
    """Full width 2b of the base [m]."""
    height: float | None = None
    """Full height 2a [m]. Give this or the slenderness."""
    slenderness: float | None = None
    """Height over width [-]. 5 if neither is given."""
    restitution: float | None = None
    """Velocity after an impact over velocity before it [-], 0 to 1; Housner's if not given."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""

    @functools.cached_property
    def block(self) -> Block:
        """The block."""
        check("width", self.width, POSITIVE)
        if self.height is not None and self.slenderness is not None:
            raise ValueError("height and slenderness exclude each other, got both")
        if self.height is not None:
            return Block.from_size(self.width, self.height, self.gravity)
        slenderness = 5.0 if self.slenderness is None else self.slenderness
        return Block(self.width / 2, slenderness, self.gravity)

    @functools.cached_property
    def coefficient(self) -> float:
        """The coefficient of restitution."""
        if self.restitution is not None:
            check("restitution", self.restitution, UNIT_INTERVAL)
            return self.restitution
        housner = float(housner_restitution(self.block))
        if housner < 0:
            raise ValueError(
                f"restitution must be given for a block this stocky: Housner's is"
                f" {housner:.3g}, and it must be between 0 and 1"
            )
        return housner


@dataclass(frozen=True, kw_only=True)
class RecordOptions(Command):
    """Options that describe a record."""

    record: str | None = None
    """A file .AT2 or .csv, or "example" for the one that comes along."""
    unit: str | None = None
    """Unit of the record."""
    column: str | None = None
    """Column of the horizontal acceleration in a .csv."""
    vertical: str | None = None
    """Column, or file .AT2, of the vertical acceleration."""
    time_step: float | None = None
    """Time between samples of a .csv without times [s]."""
    scale: float = 1.0
    """Factor on the ground motion."""

    @property
    def motion(self) -> Motion:
        """The record, scaled."""
        found = self._reading.found
        if isinstance(found, str):
            raise ValueError(found)
        return found.scaled(self.scale)

    @functools.cached_property
    def _reading(self) -> "_Reading":
        """What reading the record gives, as another command has it that asks for the same."""
        asked = (self.record, self.unit, self.column, self.vertical, self.time_step)
        reading = _readings.get(asked)
        if reading is None:
            try:
                reading = _Reading(self._read())
            except ValueError as error:
                reading = _Reading(str(error))
            _readings[asked] = reading
        return reading

    def _read(self) -> Record:
        if self.record is None:
            raise ValueError("record must be given")
        if self.record != "example":
            return read_record(
                self.record,
                unit=self.unit,
                column=self.column,
                vertical=self.vertical,
                time_step=self.time_step,
            )
        given = (self.unit, self.time_step)
        if given != (None, None) or self.vertical not in (None, "up"):
            raise ValueError(
                'the record "example" has its unit and time step; its column may be "north"'
                ' or "east", and vertical "up"'
            )
        return example_record(self.column or "north", vertical=self.vertical is not None)


@dataclass(frozen=True, eq=False)
class _Reading:
    """A record that was read, or what is wrong with it."""

    found: Record | str


# Kept for as long as a command holds on to it: the file is read once, checked and then used.
_readings: weakref.WeakValueDictionary[tuple[Any, ...], _Reading] = weakref.WeakValueDictionary()


@dataclass(frozen=True, kw_only=True)
class MotionOptions(RecordOptions):
    """Options that describe a pulse or a record."""

    pulse: PulseShape | None = None
    """Shape of a pulse. Give this or a record."""
    amplitude: float | None = None
    """Largest acceleration of the pulse [m/s2]."""
    pulse_duration: float | None = None
    """Duration of the pulse [s]."""

    @property
    def shaken(self) -> bool:
        """Whether a pulse or a record is given."""
        return self.pulse is not None or self.record is not None

    def refuse_motion(self) -> None:
        """Raise `ValueError` if an option is given that says more about a pulse or a record."""
        names = [field.name for field in fields(MotionOptions) if field.name not in COMMON]
        self.refuse(*names, only_with="a pulse or a record")

    @property
    def motion(self) -> Motion:
        """The pulse or the record, scaled."""
        if (self.pulse is None) == (self.record is None):
            raise ValueError("pulse or record must be given, one of the two")
        if self.pulse is None:
            self.refuse("amplitude", "pulse_duration", only_with="a pulse")
            return super().motion
        self.refuse("unit", "column", "vertical", "time_step", only_with="a record")
        if self.amplitude is None or self.pulse_duration is None:
            raise ValueError("amplitude and pulse_duration must be given with a pulse")
        return PULSES[self.pulse](self.amplitude, self.pulse_duration).scaled(self.scale)


def numbers(name: str, given: Grid) -> list[float]:
    """Numbers given one by one or as START:STOP:COUNT."""
    found: list[float] = []
    for word in given:
        parts = word.split(":")
        try:
            if len(parts) == 3 and int(parts[2]) > 0:
                start, stop = float(parts[0]), float(parts[1])
                if not math.isfinite(start) or not math.isfinite(stop):
                    raise ValueError
                found += np.linspace(start, stop, int(parts[2])).tolist()
            elif len(parts) == 1:
                found.append(float(word))
            else:
                raise ValueError
        except ValueError:
            raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {word!r}") from None
    if not found:
        raise ValueError(f"{name} must be at least one number, got none")
    return found


def picture(draw: Any, path: Path, **options: Any) -> None:
    """Write what `draw` draws on new axes to a file; or the figure that it is."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    if callable(draw):
        figure, axes = plt.subplots(layout="constrained", **options)
        draw(axes)
    else:
        figure = draw
    figure.savefig(path, dpi=150)
    plt.close(figure)


def write_rows(rows: Iterable[Mapping[str, Any]], path: Path, names: Sequence[str]) -> None:
    """Write rows as CSV, a column each name."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=names)
        writer.writeheader()
        writer.writerows(rows)


def dumps(value: Any) -> str:
    """JSON; null stands for numbers that are not finite."""

    def plain(item: Any) -> Any:
        if isinstance(item, Mapping):
            return {key: plain(inner) for key, inner in item.items()}
        if isinstance(item, list):
            return [plain(inner) for inner in item]
        return None if isinstance(item, float) and not math.isfinite(item) else item

    return json.dumps(plain(value), indent=2, allow_nan=False)
