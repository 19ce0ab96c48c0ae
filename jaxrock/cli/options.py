"""What commands have in common: options, what is checked before they run, files, answers."""

import abc
import contextlib
import functools
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, dataclass_transform

import numpy as np
from cyclopts import Group, Parameter, Token

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..ground_motion import PULSES, Motion, Record, example_record, read_record
from ..host import check_free, version, written_whole
from ..impact import housner_restitution
from ..validation import POSITIVE, UNIT_INTERVAL, check

# Titles of options in help, under which those stand that several commands have.
OF_BLOCK = Parameter(group=Group("Block", sort_key=1))
OF_MOTION = Parameter(group=Group("Ground motion", sort_key=2))
OF_OUTPUT = Parameter(group=Group("Output", sort_key=3))
OF_STORE = Parameter(group=Group("Store", sort_key=4))

GridValue = float | str
Grid = tuple[GridValue, ...]  # numbers, and texts START:STOP:COUNT
Folder = Annotated[Path, OF_OUTPUT]


def as_count(_: type, tokens: Sequence[Token]) -> int:
    """Convert a word to a whole number; cyclopts itself would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is not a whole number") from None


Count = Annotated[int, Parameter(converter=as_count)]
ModelName = Literal["linearized", "nonlinear"]
PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]


@dataclass(frozen=True)
class Answer:
    """What a command answers: as text and as data for JSON, its exit code, its errors."""

    text: str
    data: Mapping[str, Any]
    code: int = 0
    errors: Sequence[str] = ()


Steps = Generator[Any, Any, Answer]


@dataclass_transform(frozen_default=True, kw_only_default=True)
@dataclass(frozen=True, kw_only=True)
class Command(abc.ABC):
    """One command: a dataclass, whose fields are its options and what stands beside them is help.

    What it does is a generator: above the `yield` all is checked, below it is computed.
    """

    command: ClassVar[str]  # as it is called
    as_json: Annotated[bool, OF_OUTPUT, Parameter(name="--json")] = False
    """Print JSON; null stands for what does not exist or never happens."""
    no_cache: Annotated[bool, OF_OUTPUT] = False
    """Compile everything afresh: neither use nor keep compiled programs."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    @abc.abstractmethod
    def _steps(self) -> Steps:
        """Yield the names of the files once all is checked; then get the folder for them."""

    @functools.cached_property
    def _begun(self) -> tuple[Sequence[str], Steps]:
        steps = self._steps()
        return next(steps), steps

    def _ended(self, folder: Path | None) -> Answer:
        _, steps = self._begun
        del vars(self)["_begun"]  # another time from the beginning
        try:
            return steps.send(folder)
        except StopIteration as end:
            answer: Answer = end.value
        if not (remark := self._remark()):
            return answer
        text = f"{answer.text}\nremark: {remark}"
        data = {**answer.data, "remark": remark}
        return replace(answer, text=text, data=data)

    def _remark(self) -> str:
        """Say what a user should look at again."""
        return ""

    def check(self) -> None:
        """Raise `ValueError` for what is not allowed, before anything expensive is done."""
        _ = self._begun

    def run(self) -> Answer:
        """Do what the command is for."""
        return self._ended(None)

    def refuse(self, *names: str, only_with: str) -> None:
        """Raise `ValueError` if one of these options is given, since it would be ignored."""
        for name in names:
            if getattr(self, name) != getattr(type(self), name):
                raise ValueError(f"{name} goes with {only_with} only")

    def numbers(self, name: str) -> list[float]:
        """List the numbers of an option, given one by one or as START:STOP:COUNT."""
        values: Grid = getattr(self, name)
        if not values:
            raise ValueError(f"{name} must be at least one number, got none")
        return [number for value in values for number in _span(name, value)]

    def _given(self) -> dict[str, Any]:
        """Return the options, with what follows from them in their place."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def paths(self) -> dict[str, Any]:
        """Return the options that are paths: those of that type, and names of record files."""
        return {
            name: value
            for name, value in vars(self).items()
            if isinstance(value, Path) or str(value).lower().endswith((".at2", ".csv"))
        }

    @classmethod
    def names_of_options(cls) -> list[str]:
        """Name the options that a job of a study may have."""
        return [field.name for field in fields(cls) if not hasattr(Command, field.name)]


def _span(name: str, value: GridValue) -> list[float]:
    with contextlib.suppress(ValueError):
        if ":" not in str(value):
            return [float(value)]
        start, stop, count = str(value).split(":")
        ends = float(start), float(stop)
        if np.isfinite(ends).all() and int(count) > 0:
            return np.linspace(*ends, int(count)).tolist()
    raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {value!r}")


class Writing(Command):
    """A command that writes files, all or none."""

    out: Annotated[Path | None, OF_OUTPUT]
    """Folder to write to; made if it is missing."""
    force: Annotated[bool, OF_OUTPUT] = False
    """Overwrite existing files."""

    @property
    def about(self) -> dict[str, Any]:
        """Version, command and options, from which its files were computed."""
        said = {
            name: _words(value)
            for name, value in self._given().items()
            if value is not None and name not in _OF_WRITING
        }
        return {"source": f"jaxrock {version()}", "command": self.command, **said}

    @property
    def names(self) -> Sequence[str]:
        """The names of its files."""
        return self._begun[0]

    @property
    def targets(self) -> list[Path]:
        """The paths that it writes."""
        return [] if self.out is None else [self.out / name for name in self.names]

    def check(self) -> None:
        """Raise `ValueError` also for files that exist and must not be overwritten."""
        super().check()
        if self.out is not None and self.names:
            check_free("out", self.out, self.names, self.force)

    def run(self) -> Answer:
        """Compute and write; the answer tells the paths of the files."""
        if self.out is None:
            files = []
            writing = contextlib.nullcontext()
        else:
            files = [str(self.out / name) for name in self.names]
            writing = written_whole("out", self.out, self.names, self.force)
        with writing as folder:
            answer = self._ended(folder)
        text = "\n".join([answer.text, *files])
        data = {**answer.data, "files": files}
        return replace(answer, text=text, data=data)


_LARGE = 60.0  # metres, beyond what stands free on two edges
_OF_WRITING = ("as_json", "no_cache", "out", "force", "animate", "repeats")
_OF_WRITING += ("store", "chunks", "workers", "scheduler")


def _words(value: Any) -> str | int | float:
    """As CF has attributes, which are numbers or text."""
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, int | float):
        return value
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


class BlockOptions(Command):
    """Options that describe one block."""

    width: Annotated[float, OF_BLOCK] = 0.8
    """Full width 2b of the base [m]."""
    height: Annotated[float | None, OF_BLOCK] = None
    """Full height 2a, twice that of the centre of mass [m]. Give this or the slenderness."""
    slenderness: Annotated[float | None, OF_BLOCK] = None
    """Height over width [-]. 5 if neither is given."""
    restitution: Annotated[float | None, OF_BLOCK] = None
    """Velocity after an impact over velocity before it [-], 0 to 1; Housner's if not given."""
    gravity: Annotated[float, OF_BLOCK] = 9.81
    """Acceleration of gravity [m/s2]."""
    inertia_ratio: Annotated[float, OF_BLOCK] = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle."""

    @functools.cached_property
    def block(self) -> Block:
        """The block."""
        check("width", self.width, POSITIVE)
        if self.height is None:
            slenderness = 5.0 if self.slenderness is None else self.slenderness
        elif self.slenderness is not None:
            raise ValueError("height and slenderness exclude each other, got both")
        else:
            check("height", self.height, POSITIVE)
            slenderness = self.height / self.width
        return Block(self.width / 2, slenderness, self.gravity, self.inertia_ratio)

    def _remark(self) -> str:
        sizes = {"wide": 2 * self.block.half_width, "high": 2 * self.block.half_height}
        large = [f"{size:.4g} m {word}" for word, size in sizes.items() if size > _LARGE]
        return f"the block is {' and '.join(large)}; lengths are in metres" if large else ""

    def _given(self) -> dict[str, Any]:
        slenderness = float(self.block.slenderness)
        return super()._given() | {"slenderness": slenderness, "restitution": self.coefficient}

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


class RecordOptions(Command):
    """Options that describe a record."""

    record: Annotated[str | None, OF_MOTION] = None
    """A file .AT2 or .csv, or "example" for the one that comes with jaxrock."""
    unit: Annotated[str | None, OF_MOTION] = None
    """Unit of the record."""
    column: Annotated[str | None, OF_MOTION] = None
    """Column of the horizontal acceleration in a .csv."""
    vertical: Annotated[str | None, OF_MOTION] = None
    """Column, or file .AT2, of the vertical acceleration."""
    time_step: Annotated[float | None, OF_MOTION] = None
    """Time between samples of a .csv without times [s]."""
    scale: Annotated[float, OF_MOTION] = 1.0
    """Factor on the ground motion."""

    @property
    def motion(self) -> Motion:
        """The record, scaled."""
        found = read(self.record, **{name: getattr(self, name) for name in _OF_RECORD})
        if isinstance(found, str):
            raise ValueError(found)
        return found.scaled(self.scale)


_OF_RECORD = ("unit", "column", "vertical", "time_step")
_OF_PULSE = ("amplitude", "pulse_duration")


@functools.cache
def read(record: str | None, **options: Any) -> Record | str:
    """Read a record, or say what is wrong with it; the jobs of a study read it once."""
    try:
        if record is None:
            raise ValueError("record must be given")
        if record != "example":
            return read_record(record, **options)
        leave_out('record "example" has its', options)
        column = options["column"] or "north"
        vertical = options["vertical"]
        if column not in ("north", "east") or vertical not in (None, "up"):
            got = f"got {column!r}" + (f" and {vertical!r}" if vertical else "")
            must = "must be north or east, and vertical up if given"
            raise ValueError(f'column of the record "example" {must}, {got}')
        return example_record(column, vertical=vertical is not None)
    except ValueError as error:
        return str(error)


def leave_out(example: str, options: Mapping[str, Any]) -> None:
    """Raise `ValueError` for what records that come with jaxrock state themselves."""
    given = [f"--{name}" for name in ("unit", "time_step") if options[name] is not None]
    if given:
        names = " and ".join(given).replace("_", "-")
        raise ValueError(f"{example} unit and time step: leave out {names}")


class MotionOptions(RecordOptions):
    """Options that describe a pulse or a record."""

    pulse: Annotated[PulseShape | None, OF_MOTION] = None
    """Shape of a pulse. Give this or a record."""
    amplitude: Annotated[float | None, OF_MOTION] = None
    """Largest acceleration of the pulse [m/s2]."""
    pulse_duration: Annotated[float | None, OF_MOTION] = None
    """Duration of the pulse [s]."""

    @property
    def shaken(self) -> bool:
        """True if a pulse or a record is given."""
        return self.pulse is not None or self.record is not None

    def check(self) -> None:
        """Raise `ValueError` also for a part of a pulse or a record without the rest."""
        if not self.shaken:
            self.refuse(*_OF_PULSE, *_OF_RECORD, "scale", only_with="a pulse or a record")
        super().check()

    @property
    def motion(self) -> Motion:
        """The pulse or the record, scaled."""
        if (self.pulse is None) == (self.record is None):
            raise ValueError("pulse or record must be given, one of the two")
        if self.pulse is None:
            self.refuse(*_OF_PULSE, only_with="a pulse")
            return super().motion
        self.refuse(*_OF_RECORD, only_with="a record")
        if self.amplitude is None or self.pulse_duration is None:
            raise ValueError("amplitude and pulse_duration must be given with a pulse")
        return PULSES[self.pulse](self.amplitude, self.pulse_duration).scaled(self.scale)


def picture(drawn: Any, path: Path) -> None:
    """Write a figure, or the one that axes belong to, to a file."""
    import matplotlib.pyplot as plt

    drawn.figure.savefig(path, dpi=150)
    plt.close(drawn.figure)
