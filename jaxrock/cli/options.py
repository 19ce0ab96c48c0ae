"""The groups of options that commands share: one block, the output; and grids of numbers."""

import contextlib
import importlib.metadata
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Group, Parameter

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..grids import as_axis
from ..host import write_whole
from ..impact import assume_restitution, describe_scene, read_restitution
from ..validation import POSITIVE, check
from .answers import Files, show_message

# Numbers, and texts START:STOP:COUNT for COUNT evenly spaced values, both ends included.
Grid = Annotated[tuple[float | str, ...], Parameter(metavar="NUMBER|START:STOP:COUNT...")]
ModelName = Literal["linearized", "nonlinear"]
COMMAND_LINE: ContextVar[str] = ContextVar("command line", default="")


# cyclopts itself would round 1.5.
Count = Annotated[int, Parameter(converter=lambda _, tokens: int(tokens[0].value))]


def read_numbers(name: str, values: Grid) -> list[float]:
    """List the numbers of an option, given one by one or as START:STOP:COUNT."""
    numbers: list[float] = []
    for value in values:
        start, *more = str(value).split(":")
        try:
            stop, count = more or (start, "1")
            numbers += np.linspace(float(start), float(stop), int(count)).tolist()
        except ValueError:
            raise ValueError(
                f"{name} must be numbers, as in 0.4 0.8, or START:STOP:COUNT, as in 3:10:15,"
                f" got {value!r}"
            ) from None
    if not numbers:
        raise ValueError(f"{name} must be at least one number, got none")
    return numbers


def read_axis(name: str, values: Grid) -> np.ndarray:
    """Read the values along an axis of a spectrum; a single one makes no dimension."""
    numbers = read_numbers(name, values)
    return as_axis(name, numbers[0] if len(numbers) == 1 else numbers)


def refuse(where: str, **options: object) -> None:
    """Raise `ValueError` if one of these options is given, which has no effect there.

    Parameters
    ----------
    where : str
        In words, such as "with --pulse".
    **options : object
        Values by the names of parameters; None for an option that is not given.
    """
    for name, value in options.items():
        if value is not None:
            option = f"--{name.replace('_', '-')}"
            raise ValueError(f"{option} has no effect {where}, got {value}: leave it out")


@Parameter(name="*", group=Group("Output", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class Output:
    """Options of a command that prints an answer."""

    json: bool = False
    """Print JSON; null means that a value does not exist or that an event never happens."""


@Parameter(name="*", group=Group("Output", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class FileOutput(Output):
    """Options of a command that writes files as well."""

    out: Path | None = None
    """Folder to write to; made if it is missing."""
    force: bool = False
    """Overwrite existing files."""

    @contextlib.contextmanager
    def write(self, name: str, *others: str, dataset: bool = True) -> Iterator[Files]:
        """Let the body write files, all or none: a dataset of this name, and others."""
        target = self.out or Path(name)
        names = [f"{name}.{kind}" for kind in ("nc", "csv", "png") if dataset] + [*others]
        show_message(f"computing what goes into the folder {str(target)!r}")
        version = importlib.metadata.version("jaxrock")
        about = {"source": f"jaxrock {version}", "command": COMMAND_LINE.get()}
        with write_whole("--out", target, names, self.force) as scratch:
            yield Files(name, scratch, about, [target / name for name in names])


@Parameter(name="*", group=Group("Block", sort_key=1))
@dataclass(frozen=True, kw_only=True)
class BlockOptions:
    """Options that describe one block."""

    width: float | None = None
    """Full width 2b of the base [m]."""
    height: float | None = None
    """Full height 2a, twice the height of the centre of mass [m]. Give this or the
    slenderness."""
    slenderness: float | None = None
    """Height over width [-]."""
    restitution: float | None = None
    """Velocity after an impact over velocity before it [-], 0 to 1, or its negative if
    one-sided. Computed from the size if not given."""
    one_sided: bool = False
    """The block stands against a wall, and rocks away from it only."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle."""

    @property
    def block(self) -> Block:
        """The block."""
        if self.width is None or (self.height is None) == (self.slenderness is None):
            raise ValueError(
                "--width and one of --height and --slenderness must be given, as in"
                " --width 0.8 --height 4"
            )
        check("width", self.width, POSITIVE)
        slenderness: Any = self.slenderness
        if self.height is not None:
            check("height", self.height, POSITIVE)
            slenderness = self.height / self.width
        shape = (self.width / 2, slenderness, self.gravity, self.inertia_ratio)
        return Block(*shape, one_sided=self.one_sided)

    @property
    def block_if_given(self) -> Block | None:
        """The block, or None where nothing of its size is given."""
        sizes = (self.width, self.height, self.slenderness)
        return None if sizes == (None, None, None) else self.block

    @property
    def coefficient(self) -> float:
        """The coefficient of restitution."""
        if self.restitution is None:
            return assume_restitution(self.block)
        return float(read_restitution(self.block, self.restitution))

    @property
    def text(self) -> str:
        """The block and its restitution in words."""
        return describe_scene(self.block, self.restitution and self.coefficient)
