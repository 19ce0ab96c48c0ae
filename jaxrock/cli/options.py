"""Options that several commands have, in groups: a block, a motion, a suite, the output."""

import contextlib
import functools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Group, Parameter, Token

from ..block import LARGEST_SIZES, RECTANGLE_INERTIA_RATIO, Block
from ..ground_motion import (
    FEMA_SETS,
    PULSES,
    Motion,
    Suite,
    example_record,
    example_suite,
    fema_p695_suite,
    read_record,
    read_suite,
)
from ..impact import housner_restitution
from ..risk import Hazard, read_hazard
from ..validation import POSITIVE, UNIT_INTERVAL, check

# Panels of the help, in their order below a command's own options.
MOTION = Group("Ground motion", sort_key=2)
_OUTPUT = Group("Output", sort_key=3)
# Decorators of the classes below: their fields become options of a command.
_OF_BLOCK = Parameter(name="*", group=Group("Block", sort_key=1))
_OF_MOTION = Parameter(name="*", group=MOTION)
_OF_OUTPUT = Parameter(name="*", group=_OUTPUT)
_OF_STORE = Parameter(name="*", group=Group("Store", sort_key=4))

Grid = tuple[float | str, ...]  # numbers, and texts START:STOP:COUNT
Folder = Annotated[Path, Parameter(group=_OUTPUT)]
ModelName = Literal["linearized", "nonlinear"]
PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]


def _convert_count(_: type, tokens: Sequence[Token]) -> int:
    """Convert a word to a whole number; cyclopts itself would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is not a whole number") from None


Count = Annotated[int, Parameter(converter=_convert_count)]


def read_numbers(name: str, values: Grid) -> list[float]:
    """List the numbers of an option, given one by one or as START:STOP:COUNT."""
    if not values:
        raise ValueError(f"{name} must be at least one number, got none")
    return [number for value in values for number in _parse_numbers(name, value)]


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
    raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {value!r}")


def refuse(only_with: str, **options: object) -> None:
    """Raise `ValueError` if one of these options is given, since it would be ignored."""
    for name, value in options.items():
        if value is not None:
            items = value if isinstance(value, tuple) else (value,)
            words = [f"{item:g}" if isinstance(item, float) else str(item) for item in items]
            raise ValueError(f"{name} goes with {only_with} only, got {' '.join(words)}")


@_OF_OUTPUT
@dataclass(frozen=True, kw_only=True)
class Output:
    """Options of a command that prints an answer."""

    json: bool = False
    """Print JSON; null stands for what does not exist or never happens."""


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
    """Full height 2a, twice that of the centre of mass [m]. Give this or the slenderness."""
    slenderness: float | None = None
    """Height over width [-]. 5 if neither is given."""
    restitution: float | None = None
    """Velocity after an impact over velocity before it [-], 0 to 1; Housner's if not given."""
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
            self.width, self.height, slenderness, self.gravity, self.inertia_ratio
        )
        _warn_of_large(block)
        return block

    @property
    def coefficient(self) -> float:
        """The coefficient of restitution."""
        if self.restitution is not None:
            check("restitution", self.restitution, UNIT_INTERVAL)
            return self.restitution
        # Housner's C = 1 - (3/2) sin(alpha_c)^2 of a rectangle falls below 0 if it is stocky.
        housner = float(housner_restitution(self.block))
        if housner < 0:
            raise ValueError(
                f"restitution must be given for a block this stocky: Housner's is"
                f" {housner:.3g}, and it must be between 0 and 1"
            )
        return housner


@_OF_BLOCK
@dataclass(frozen=True, kw_only=True)
class SizeOptions:
    """Options that describe a block which need not be known."""

    width: float | None = None
    """Full width 2b of the base [m]; without it the block is not known, or of any size."""
    height: float | None = None
    """Full height 2a, twice that of the centre of mass [m]. Give this or the slenderness."""
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
) -> Block:
    """Make a block of the full width of its base, and of either its height or its slenderness."""
    check("width", width, POSITIVE)
    if height is not None:
        if slenderness is not None:
            raise ValueError(
                f"height and slenderness exclude each other, got {height:g} and"
                f" {slenderness:g}"
            )
        check("height", height, POSITIVE)
        slenderness = height / width
    if slenderness is None:
        raise ValueError(
            f"height or slenderness must be given with a width, got a width of {width:g} only"
        )
    return Block(width / 2, slenderness, gravity, inertia_ratio)


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


@_OF_MOTION
@dataclass(frozen=True, kw_only=True)
class RecordOptions:
    """Options that describe a record."""

    record: str | None = None
    """A file of a record, such as .AT2 or .csv, or "example" for the one of jaxrock."""
    unit: str | None = None
    """Unit of the record: m/s2, cm/s2, mm/s2, gal, g, %g or mg; if the file states none."""
    column: str | None = None
    """Column or channel of the horizontal acceleration, where a file has several."""
    vertical: str | None = None
    """Column or channel of the vertical acceleration, or another file with it."""
    time_step: float | None = None
    """Time between samples [s], where the file states none."""
    scale: float | None = None
    """Factor on the ground motion [-]. 1 if not given."""

    @property
    def factor(self) -> float:
        """The factor on the ground motion."""
        return 1.0 if self.scale is None else self.scale

    def read_unscaled(self) -> Motion:
        """Read the record, by default the example, without the factor."""
        if self.record not in (None, "example"):
            return read_record(
                self.record,
                unit=self.unit,
                column=self.column,
                vertical=self.vertical,
                time_step=self.time_step,
            )
        _refuse_stated_units('record "example" has its', self.unit, self.time_step)
        column = self.column or "north"
        if column not in ("north", "east") or self.vertical not in (None, "up"):
            vertical = f" and {self.vertical!r}" if self.vertical else ""
            raise ValueError(
                'column of the record "example" must be north or east, and vertical up if'
                f" given, got {column!r}{vertical}"
            )
        return example_record(column, vertical=self.vertical is not None)

    def read(self) -> Motion:
        """Read the motion, scaled."""
        return self.read_unscaled().scaled(self.factor)

    def refuse_all(self, only_with: str) -> None:
        """Raise `ValueError` if any of these options is given."""
        refuse(only_with, **vars(self))


@_OF_MOTION
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
    def given(self) -> bool:
        """True if a pulse or a record is given."""
        return self.pulse is not None or self.record is not None

    def read_unscaled(self) -> Motion:
        """Make the pulse, or read the record, without the factor."""
        if self.pulse is None and self.record is None:
            raise ValueError("pulse or record must be given, got neither")
        if self.pulse is not None and self.record is not None:
            raise ValueError(
                f"pulse and record exclude each other, got {self.pulse} and {self.record}"
            )
        if self.pulse is None:
            of_pulse = ("amplitude", "pulse_duration")
            refuse("a pulse", **{name: getattr(self, name) for name in of_pulse})
            return super().read_unscaled()
        of_record = ("unit", "column", "vertical", "time_step")
        refuse("a record", **{name: getattr(self, name) for name in of_record})
        if self.amplitude is None or self.pulse_duration is None:
            of_pulse = ("amplitude", "pulse_duration")
            missing = [name for name in of_pulse if getattr(self, name) is None]
            raise ValueError(f"{' and '.join(missing)} must be given with a pulse")
        return PULSES[self.pulse](self.amplitude, self.pulse_duration)


@_OF_MOTION
@dataclass(frozen=True, kw_only=True)
class SuiteOptions:
    """Options that describe a suite of records, and the hazard of a site."""

    records: str = "example"
    """A folder of records, "example" for twenty, or a set of FEMA P695, as fema-far-field."""
    unit: str | None = None
    """Unit of the records: m/s2, cm/s2, mm/s2, gal, g, %g or mg; if files state none."""
    time_step: float | None = None
    """Time between samples [s], where files state none."""
    with_vertical: bool = False
    """Include the vertical component of each record."""
    hazard: Path | None = None
    """A .csv file: columns of levels and rates per year, or a curve of OpenQuake or nshmp-haz."""
    hazard_unit: str | None = None
    """Unit of these levels: m/s, cm/s, m/s2, g ...; if the file states none."""
    hazard_site: Grid | None = None
    """Longitude and latitude of the curve, where the file has those of several sites [deg]."""

    def read_suite(self) -> Suite:
        """Read the records of a folder, or take those of a name."""
        return read_records(self.records, self.unit, self.time_step, self.with_vertical)

    def read_hazard(self, measure: str) -> Hazard | None:
        """Read the hazard, of this measure; None if none is given."""
        if self.hazard is None:
            refuse("a hazard", hazard_unit=self.hazard_unit, hazard_site=self.hazard_site)
            return None
        if measure not in ("pgv", "pga"):
            raise ValueError(f"hazard goes with the measures pgv and pga, not {measure}")
        site = None
        if self.hazard_site is not None:
            site = tuple(read_numbers("hazard_site", self.hazard_site))
            if len(site) != 2:
                words = " ".join(f"{value:g}" for value in site)
                raise ValueError(
                    f"hazard_site must be a longitude and a latitude, got {words}"
                )
        return read_hazard(self.hazard, unit=self.hazard_unit, measure=measure, site=site)


def read_records(
    records: str, unit: str | None, time_step: float | None, vertical: bool = False
) -> Suite:
    """Read the records of a folder, or take the suite of this name."""
    fema_set = records.removeprefix("fema-")
    is_fema = fema_set != records
    if records != "example" and not (is_fema and fema_set in FEMA_SETS):
        if is_fema and not Path(records).exists():
            sets = ", ".join(f"fema-{name}" for name in FEMA_SETS)
            raise ValueError(
                f"records must be a folder, example, or one of {sets}, got {records!r}"
            )
        return read_suite(records, unit=unit, time_step=time_step, vertical=vertical)
    _refuse_stated_units(f'records "{records}" have their', unit, time_step)
    if records == "example":
        return example_suite(vertical=vertical)
    if vertical:
        raise ValueError(f'records "{records}" have no vertical component')
    return fema_p695_suite(fema_set)


def _refuse_stated_units(example: str, unit: str | None, time_step: float | None) -> None:
    """Raise `ValueError` for what records that come with jaxrock state themselves."""
    options = {"--unit": unit, "--time-step": time_step}
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise ValueError(f"{example} unit and time step: leave out {' and '.join(given)}")


@_OF_STORE
@dataclass(frozen=True, kw_only=True)
class StoreOptions:
    """Options of a command whose answer can go to a Zarr store."""

    store: Path | None = None
    """Zarr store to write instead of the files; one that this command has begun is continued."""
    workers: Count | None = None
    """Processes of this machine that compute the store; one for each processor if not given."""

    def wants_store(self, out: Path | None, force: bool) -> bool:
        """Return whether a store is wanted; `ValueError` for options that exclude each other."""
        if self.store is None:
            refuse("a store", workers=self.workers)
            return False
        if out is not None or force:
            raise ValueError(
                "out and force exclude a store, which is continued and not overwritten, got"
                f" {self.store}"
            )
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"workers must be at least 1, got {self.workers}")
        return True
