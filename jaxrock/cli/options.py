"""Options that several commands have, in groups: a block, the output, a store; and numbers."""

import contextlib
import functools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import CoercionError, Group, Parameter, Token

from ..block import LARGEST_SIZES, RECTANGLE_INERTIA_RATIO, Block
from ..grids import as_axis
from ..impact import (
    compute_restitution_by_size,
    describe_assumed_restitution,
    read_restitution,
)
from ..validation import POSITIVE, check
from .wrong_calls import suggest_number

# Panels of the help, in their order below a command's own options; a motion is the second.
_OUTPUT = Group("Output", sort_key=3)
# Decorators of the classes below: their fields become options of a command.
_OF_BLOCK = Parameter(name="*", group=Group("Block", sort_key=1))
_OF_OUTPUT = Parameter(name="*", group=_OUTPUT)
_OF_STORE = Parameter(name="*", group=Group("Store", sort_key=4))

# Numbers, and texts START:STOP:COUNT; what they stand for is said below the help.
Grid = Annotated[tuple[float | str, ...], Parameter(metavar="NUMBER|START:STOP:COUNT...")]
GRID_HELP = (
    "START:STOP:COUNT stands for COUNT evenly spaced values from START to STOP, both"
    " included: 3:4:5 for 3 3.25 3.5 3.75 4."
)
Folder = Annotated[Path, Parameter(group=_OUTPUT)]
ModelName = Literal["linearized", "nonlinear"]


def _convert_count(_: type, tokens: Sequence[Token]) -> int:
    """Convert a word to a whole number; cyclopts itself would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise CoercionError(token=tokens[0], target_type=int) from None


# [m/s]; peak ground velocities of the strongest records are some 3 m/s.
_LARGEST_INTENSITY = 10.0

Count = Annotated[int, Parameter(converter=_convert_count)]


def read_numbers(name: str, values: Grid) -> list[float]:
    """List the numbers of an option, given one by one or as START:STOP:COUNT."""
    if not values:
        raise ValueError(f"{name} must be at least one number, got none")
    return [number for value in values for number in _parse_numbers(name, value)]


def read_axis(name: str, values: Grid) -> np.ndarray:
    """Read the values along an axis of a spectrum; a single one makes no dimension."""
    numbers = read_numbers(name, values)
    return as_axis(name, numbers[0] if len(numbers) == 1 else numbers)


def _parse_numbers(name: str, value: float | str) -> list[float]:
    """Parse one number, or START:STOP:COUNT."""
    # All that `float`, `int` and unpacking refuse ends in the one sentence below.
    with contextlib.suppress(ValueError):
        if ":" not in str(value):
            return [float(value)]
        start, stop, count = str(value).split(":")
        ends = float(start), float(stop)
        if np.isfinite(ends).all() and int(count) > 0:
            return np.linspace(*ends, int(count)).tolist()
    hint = _suggest_count(str(value)) or suggest_number(str(value))
    raise ValueError(
        f"{name} must be numbers, or START:STOP:COUNT with a count of at least 1, got"
        f" {value!r}{hint}"
    )


def _suggest_count(word: str) -> str:
    """Say what to type where a count is missing, or is a step; empty if that is not clear."""
    with contextlib.suppress(ValueError, OverflowError):
        start, stop, *steps = [float(part) for part in word.split(":")]
        if not steps:
            return f"; {word}:15 stands for 15 values"
        if len(steps) == 1 and 0 < abs(steps[0]) < abs(stop - start) and steps[0] % 1:
            count = round(abs((stop - start) / steps[0])) + 1
            return (
                "; the last number is a count, not a step:"
                f" {word.rpartition(':')[0]}:{count} has steps of"
                f" {(stop - start) / (count - 1):.4g}"
            )
    return ""


def refuse(only_with: str, **options: object) -> None:
    """Raise `ValueError` if one of these options is given, since it would be ignored.

    Parameters
    ----------
    only_with : str
        What to type so that it is not ignored, such as "--store".
    **options : object
        Values by the names of parameters; None for an option that is not given.
    """
    for name, value in options.items():
        if value is not None:
            option = write_option(name)
            given = "" if value is True else f", got {_write_words(value)}"
            raise ValueError(
                f"{option} goes with {only_with} only{given}: add {only_with}, or leave out"
                f" {option}"
            )


def refuse_beside(given: str, **options: object) -> None:
    """Raise `ValueError` if one of these options is given beside options that exclude it."""
    for name, value in options.items():
        if value is not None:
            option = write_option(name)
            raise ValueError(
                f"{option} has no meaning beside {given}, got {_write_words(value)}: leave it"
                " out"
            )


def write_option(name: str) -> str:
    """Write the option of a parameter as it is typed."""
    return f"--{name.replace('_', '-')}"


def _write_words(value: object) -> str:
    """Write the value of an option as it is typed."""
    items = value if isinstance(value, tuple) else (value,)
    return " ".join(f"{item:g}" if isinstance(item, float) else str(item) for item in items)


@_OF_OUTPUT
@dataclass(frozen=True, kw_only=True)
class Output:
    """Options of a command that prints an answer."""

    json: bool = False
    """Print JSON; null means that a value does not exist or that an event never happens."""


@_OF_OUTPUT
@dataclass(frozen=True, kw_only=True)
class FileOutput(Output):
    """Options of a command that writes files as well."""

    force: bool = False
    """Overwrite existing files."""


@_OF_BLOCK
@dataclass(frozen=True, kw_only=True)
class BlockOptions:
    """Options that describe one block."""

    width: float = 0.8
    """Full width 2b of the base [m]."""
    height: float | None = None
    """Full height 2a, twice the height of the centre of mass [m]. Give this or the
    slenderness."""
    slenderness: float | None = None
    """Height over width [-]. 5 if neither is given."""
    restitution: float | None = None
    """Velocity after an impact over velocity before it [-], 0 to 1, or its negative if
    one-sided. Computed from the size if not given."""
    one_sided: bool = False
    """The block stands against a wall, and rocks away from it only."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle."""

    # Cached, so that it warns once. This works in a frozen dataclass: the value goes into the
    # dictionary of the instance.
    @functools.cached_property
    def block(self) -> Block:
        """The block."""
        slenderness = self.slenderness
        if self.height is None and slenderness is None:
            slenderness = 5.0
        block = make_block(
            self.width,
            self.height,
            slenderness,
            self.gravity,
            self.inertia_ratio,
            one_sided=self.one_sided,
        )
        _warn_of_large(block)
        return block

    @property
    def restitution_text(self) -> str:
        """The coefficient of restitution in words, and whether it was given or assumed."""
        if self.restitution is None:
            return describe_assumed_restitution(self.block)
        return f"C = {self.coefficient:.6g}"

    @property
    def size_text(self) -> str:
        """The size of the block in words."""
        block = self.block
        wall = ", against a wall" if block.one_sided else ""
        return f"block {float(block.width):.6g} m wide, {float(block.height):.6g} m high{wall}"

    @property
    def scene_text(self) -> str:
        """The size and the restitution of the block in words."""
        return f"{self.size_text}, {self.restitution_text}"

    @property
    def coefficient(self) -> float:
        """The coefficient of restitution."""
        if self.restitution is not None:
            return float(read_restitution(self.block, self.restitution))
        by_size = float(compute_restitution_by_size(self.block))
        if by_size < 0 and self.one_sided:
            raise ValueError(
                "restitution must be given for a one-sided block this stocky: by size it is"
                f" {-by_size:.3g}, and it must be negative"
            )
        if by_size < 0:
            raise ValueError(
                "restitution must be given for a block this stocky: Housner's is"
                f" {by_size:.3g}, and it must be between 0 and 1"
            )
        return by_size


@_OF_BLOCK
@dataclass(frozen=True, kw_only=True)
class SizeOptions:
    """Options that describe a block which need not be known."""

    width: float | None = None
    """Full width 2b of the base [m]. Without it the block is unknown, or its size does not
    matter."""
    height: float | None = None
    """Full height 2a, twice the height of the centre of mass [m]. Give this or the
    slenderness."""
    slenderness: float | None = None
    """Height over width [-]."""
    gravity: float | None = None
    """Acceleration of gravity [m/s2]. 9.81 if not given."""
    inertia_ratio: float | None = None
    """Moment of inertia about an edge over m R^2 [-], at least 1. 4/3 if not given."""

    def make_block(self, width: float, default_slenderness: float | None = None) -> Block:
        """Make the block of this width, and perhaps of a slenderness if nothing says more."""
        slenderness = self.slenderness
        if self.height is None and slenderness is None:
            slenderness = default_slenderness
        return make_block(
            width,
            self.height,
            slenderness,
            9.81 if self.gravity is None else self.gravity,
            RECTANGLE_INERTIA_RATIO if self.inertia_ratio is None else self.inertia_ratio,
        )


def make_block(
    width: float,
    height: float | None,
    slenderness: float | None,
    gravity: float,
    inertia_ratio: float,
    *,
    one_sided: bool = False,
) -> Block:
    """Make a block of the full width of its base, and of its height or its slenderness."""
    check("width", width, POSITIVE)
    if height is not None:
        if slenderness is not None:
            raise ValueError(
                f"--height and --slenderness exclude each other, got {height:g} and"
                f" {slenderness:g}: leave out one of them"
            )
        check("height", height, POSITIVE)
        slenderness = height / width
    if slenderness is None:
        raise ValueError(
            f"--height or --slenderness must be given with --width, got --width {width:g} only"
        )
    return Block(width / 2, slenderness, gravity, inertia_ratio, one_sided=one_sided)


def warn_of_intensity(intensity: float) -> None:
    """Warn of an intensity of pulses that was perhaps given in centimetres per second."""
    if intensity > _LARGEST_INTENSITY:
        warnings.warn(
            f"--intensity is in m/s, and {intensity:.4g} m/s is far more than the ground moves"
            f" in an earthquake; type {intensity / 100:.4g} if {intensity:.4g} cm/s are meant",
            stacklevel=3,
        )


def _warn_of_large(block: Block) -> None:
    """Warn of a size that was perhaps given in centimetres or millimetres."""
    adjectives = {"width": "wide", "height": "high"}
    large = [
        f"{float(getattr(block, name)):.4g} m {adjective}"
        for name, adjective in adjectives.items()
        if float(getattr(block, name)) > LARGEST_SIZES[name]
    ]
    if large:
        sizes = " and ".join(large)
        warnings.warn(f"the block is {sizes}; lengths are in metres", stacklevel=3)


@_OF_STORE
@dataclass(frozen=True, kw_only=True)
class StoreOptions:
    """Options of a command whose answer can go to a Zarr store."""

    store: Path | None = None
    """Zarr store to write instead of the files. A store that this command has begun is
    continued."""
    workers: Count | None = None
    """Processes of this machine that compute the store; one for each processor if not given."""

    def wants_store(self, out: Path | None, force: bool) -> bool:
        """Return whether a store is wanted; `ValueError` for options that exclude each other."""
        if self.store is None:
            refuse("--store", workers=self.workers)
            return False
        if out is not None or force:
            raise ValueError(
                "--out and --force exclude --store, which is continued and not overwritten,"
                f" got --store {self.store}"
            )
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"workers must be at least 1, got {self.workers}")
        return True
