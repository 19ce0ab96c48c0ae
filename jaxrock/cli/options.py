"""What commands have in common: options, checks before anything runs, answers."""

import abc
import contextlib
import functools
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import tyro

from ..block import Block
from ..ground_motion import PULSES, Motion, Record, example_record, read_record
from ..host import check_free, written_whole
from ..impact import housner_restitution
from ..validation import POSITIVE, UNIT_INTERVAL, check

GridValue = float | str
Grid = tuple[GridValue, ...]  # numbers, and texts START:STOP:COUNT
ModelName = Literal["linearized", "nonlinear"]
PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]


@dataclass(frozen=True)
class Answer:
    """What a command answers: as text and as data for JSON, its exit code, its errors."""

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
    """Compile everything afresh: neither use nor keep compiled programs."""

    @abc.abstractmethod
    def check(self) -> None:
        """Raise `ValueError` for what is not allowed, before anything expensive is done."""

    @abc.abstractmethod
    def run(self) -> Answer:
        """Do what the command is for."""

    def refuse(self, *names: str, only_with: str) -> None:
        """Raise `ValueError` if one of these options is given, since it would be ignored."""
        default = {field.name: field.default for field in fields(self)}
        for name in names:
            if getattr(self, name) != default[name]:
                raise ValueError(f"{name} goes with {only_with} only")


COMMON = frozenset(field.name for field in fields(Command))  # options of every command


@dataclass(frozen=True, kw_only=True)
class Writing(Command):
    """A command that writes files."""

    FILES: ClassVar[Sequence[str]]

    out: Path | None
    """Folder to write to; made if it is missing."""
    force: bool = False
    """Overwrite existing files."""

    @property
    def names(self) -> Sequence[str]:
        """The names of its files."""
        return self.FILES

    def check(self) -> None:
        """Raise `ValueError` also for files that exist and must not be overwritten."""
        if self.out is not None:
            check_free("out", self.out, self.names, self.force)
        super().check()

    def written(self) -> AbstractContextManager[Path]:
        """A folder to write the files into, all or none; see `written_whole`."""
        assert self.out is not None
        return written_whole("out", self.out, self.names, self.force)

    def finished(self, text: str, data: Mapping[str, Any], code: int = 0) -> Answer:
        """The answer, with the paths of the files that were written."""
        files = [] if self.out is None else [str(self.out / name) for name in self.names]
        return Answer("\n".join([text, *files]), {**data, "files": files}, code)


@dataclass(frozen=True, kw_only=True)
class BlockOptions(Command):
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

    def check(self) -> None:
        """Raise `ValueError` also for a block or a restitution that cannot be."""
        _ = self.block, self.coefficient
        super().check()

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
    """A file .AT2 or .csv, or "example" for the one that comes with jaxrock."""
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
        if self._reading.error is not None:
            raise ValueError(self._reading.error)
        return self._reading.record.scaled(self.scale)

    @functools.cached_property
    def _reading(self) -> "_Reading":
        options = (self.record, self.unit, self.column, self.vertical, self.time_step)
        reading = _readings.get(options) or _Reading(self._read)
        return _readings.setdefault(options, reading)

    def _read(self) -> Record:
        if self.record is None:
            raise ValueError("record must be given")
        if self.record != "example":
            names = ("unit", "column", "vertical", "time_step")
            return read_record(self.record, **{name: getattr(self, name) for name in names})
        if (self.unit, self.time_step) != (None, None) or self.vertical not in (None, "up"):
            raise ValueError(
                'the record "example" has its unit and time step; its column may be "north"'
                ' or "east", and vertical "up"'
            )
        return example_record(self.column or "north", vertical=self.vertical is not None)


class _Reading:
    """A record that was read, or what is wrong with it."""

    record: Record
    error: str | None = None

    def __init__(self, read: Callable[[], Record]):
        try:
            self.record = read()
        except ValueError as error:
            self.error = str(error)


# Commands that ask for the same record share it while one of them lives: a file is read once.
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
        """Raise `ValueError` if an option is given that describes a pulse or a record."""
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


def numbers(name: str, values: Grid) -> list[float]:
    """Numbers given one by one or as START:STOP:COUNT."""
    if not values:
        raise ValueError(f"{name} must be at least one number, got none")
    return [number for value in values for number in _span(name, value)]


def _span(name: str, value: GridValue) -> list[float]:
    with contextlib.suppress(ValueError):
        if ":" not in str(value):
            return [float(value)]
        start, stop, count = str(value).split(":")
        ends = float(start), float(stop)
        if np.isfinite(ends).all() and int(count) > 0:
            return np.linspace(*ends, int(count)).tolist()
    raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {value!r}")
