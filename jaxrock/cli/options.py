"""Options that several commands have: of a block, of a record, of a pulse."""

import functools
from pathlib import Path
from typing import Annotated, Literal

from ..block import LARGEST_SIZES, RECTANGLE_INERTIA_RATIO, Block
from ..ground_motion import (
    FEMA_SETS,
    PULSES,
    Motion,
    Record,
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
from .command import OF_BLOCK, OF_MOTION, Command, Grid

PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]


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

    def _write_remark(self) -> str:
        """Write a remark on a size that was perhaps given in centimetres or millimetres."""
        words = {"width": "wide", "height": "high"}
        sizes = {name: float(getattr(self.block, name)) for name in words}
        large = [
            f"{size:.4g} m {words[name]}"
            for name, size in sizes.items()
            if size > LARGEST_SIZES[name]
        ]
        return f"the block is {' and '.join(large)}; lengths are in metres" if large else ""

    def _collect_options(self) -> dict[str, object]:
        """Collect the options, with the slenderness and the restitution that were used."""
        slenderness = float(self.block.slenderness)
        return super()._collect_options() | {
            "slenderness": slenderness,
            "restitution": self.coefficient,
        }

    @functools.cached_property
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


class RecordOptions(Command):
    """Options that describe a record."""

    record: Annotated[str | None, OF_MOTION] = None
    """A file of a record, such as .AT2 or .csv, or "example" for the one of jaxrock."""
    unit: Annotated[str | None, OF_MOTION] = None
    """Unit of the record: m/s2, cm/s2, mm/s2, gal, g, %g or mg; if the file states none."""
    column: Annotated[str | None, OF_MOTION] = None
    """Column or channel of the horizontal acceleration, where a file has several."""
    vertical: Annotated[str | None, OF_MOTION] = None
    """Column or channel of the vertical acceleration, or another file with it."""
    time_step: Annotated[float | None, OF_MOTION] = None
    """Time between samples [s], where the file states none."""
    scale: Annotated[float, OF_MOTION] = 1.0
    """Factor on the ground motion."""

    @property
    def motion(self) -> Motion:
        """The record, scaled."""
        found = read_motion(self.record, self.unit, self.column, self.vertical, self.time_step)
        if isinstance(found, str):
            raise ValueError(found)
        return found.scaled(self.scale)


_OF_RECORD = ("unit", "column", "vertical", "time_step")
_OF_PULSE = ("amplitude", "pulse_duration")


@functools.cache
def read_motion(
    record: str | None,
    unit: str | None,
    column: str | None,
    vertical: str | None,
    time_step: float | None,
) -> Record | str:
    """Read a record, or return the error in words; the jobs of a study read it once."""
    # An error is returned, since a cache keeps no exceptions: a hundred jobs with a record
    # that is wrong would read it a hundred times.
    try:
        if record is None:
            raise ValueError("record must be given")
        if record != "example":
            return read_record(
                record, unit=unit, column=column, vertical=vertical, time_step=time_step
            )
        refuse_stated_units('record "example" has its', unit, time_step)
        column = column or "north"
        if column not in ("north", "east") or vertical not in (None, "up"):
            got = f"got {column!r}" + (f" and {vertical!r}" if vertical else "")
            must = "must be north or east, and vertical up if given"
            raise ValueError(f'column of the record "example" {must}, {got}')
        return example_record(column, vertical=vertical is not None)
    except ValueError as error:
        return str(error)


def refuse_stated_units(example: str, unit: str | None, time_step: float | None) -> None:
    """Raise `ValueError` for what records that come with jaxrock state themselves."""
    options = {"--unit": unit, "--time-step": time_step}
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise ValueError(f"{example} unit and time step: leave out {' and '.join(given)}")


def read_records(
    records: str, unit: str | None, time_step: float | None, vertical: bool = False
) -> Suite:
    """Read the records of a folder, or take the suite of this name."""
    fema_set = records.removeprefix("fema-")
    named = records == "example" or (fema_set != records and fema_set in FEMA_SETS)
    if not named:
        if fema_set != records and not Path(records).exists():
            sets = ", ".join(f"fema-{name}" for name in FEMA_SETS)
            raise ValueError(
                f"records must be a folder, example, or one of {sets}, got {records!r}"
            )
        return read_suite(records, unit=unit, time_step=time_step, vertical=vertical)
    refuse_stated_units(f'records "{records}" have their', unit, time_step)
    if records == "example":
        return example_suite(vertical=vertical)
    if vertical:
        raise ValueError(f'records "{records}" have no vertical component')
    return fema_p695_suite(fema_set)


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
        # With neither, the options of both would be ignored. With one of them `motion` refuses
        # the options of the other.
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


class SuiteOptions(Command):
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
            self.refuse("hazard_unit", "hazard_site", only_with="a hazard")
            return None
        if measure not in ("pgv", "pga"):
            raise ValueError(f"hazard goes with the measures pgv and pga, not {measure}")
        site = None
        if self.hazard_site is not None:
            site = tuple(self.read_numbers("hazard_site"))
            if len(site) != 2:
                got = f"got {len(site)} numbers"
                raise ValueError(f"hazard_site must be a longitude and a latitude, {got}")
        return read_hazard(self.hazard, unit=self.hazard_unit, measure=measure, site=site)
