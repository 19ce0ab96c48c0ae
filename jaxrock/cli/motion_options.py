"""Options of a ground motion that several commands have: a record, a pulse, a suite, a floor."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from cyclopts import Group, Parameter

from ..ground_motion import (
    FEMA_SETS,
    FLOOR_PERIOD,
    PULSES,
    Motion,
    Record,
    Suite,
    choose_floor_step,
    example_record,
    example_suite,
    fema_p695_suite,
    read_record,
    read_suite,
)
from ..risk import Hazard, read_hazard
from ..validation import POSITIVE, check
from .options import refuse, refuse_beside, write_option
from .wrong_calls import naming_arguments

# The panel of the help, below that of the block.
MOTION = Group("Ground motion", sort_key=2)
# Decorator of the classes below: their fields become options of a command.
_OF_MOTION = Parameter(name="*", group=MOTION)

PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]
Direction = Literal["recorded", "reversed", "both"]


@_OF_MOTION
@dataclass(frozen=True, kw_only=True)
class RecordOptions:
    """Options that describe a record."""

    record: str | None = None
    """File of a record, such as .AT2 or .csv, or "example" for the record in jaxrock."""
    unit: str | None = None
    """Unit of the record, if the file states none: m/s2, cm/s2, mm/s2, gal, g, %g or mg."""
    column: str | None = None
    """Column or channel of the horizontal acceleration, where a file has several."""
    vertical: str | None = None
    """Column or channel of the vertical acceleration, or another file with it."""
    time_step: float | None = None
    """Time between samples [s], if the file states none."""
    scale: float | None = None
    """Factor on the ground motion [-]; a negative one reverses it. 1 if not given."""
    floor_period: float | None = None
    """Period of the floor on which the block stands [s]. Without it, the block stands on the
    ground."""
    floor_damping: float | None = None
    """Damping ratio of that floor [-]. 0.05 if not given."""
    floor_participation: float | None = None
    """Participation of its mode in the motion of that floor [-]. 1 if not given."""

    @property
    def floor(self) -> tuple[float | None, float | None, float | None]:
        """The floor: its period, damping and participation."""
        return self.floor_period, self.floor_damping, self.floor_participation

    @property
    def factor(self) -> float:
        """The factor on the ground motion."""
        return 1.0 if self.scale is None else self.scale

    def read_unscaled(self) -> Motion:
        """Read the record, by default the example, without the factor; on its floor."""
        record = self._read_record()
        return put_on_floor(Suite([record]), *self.floor).records[0]

    def _read_record(self) -> Record:
        """Read the record, by default the example, of the ground."""
        if self.record not in (None, "example"):
            if Path(self.record).is_dir():
                raise ValueError(
                    f"--record must be one file, got the folder {self.record!r}; fragility,"
                    " inventory and sensitivity take folders, with --records"
                )
            return read_record(
                self.record,
                unit=self.unit,
                column=self.column,
                vertical=self.vertical,
                time_step=self.time_step,
            )
        _refuse_stated_units("--record example states its own", self.unit, self.time_step)
        column = self.column or "north"
        if column not in ("north", "east") or self.vertical not in (None, "up"):
            vertical = f" and {self.vertical!r}" if self.vertical else ""
            raise ValueError(
                "--column of --record example must be north or east, and --vertical up if"
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
    """Duration of the pulse [s]; of a ricker wavelet its period, a quarter of its length."""

    @property
    def given(self) -> bool:
        """True if a pulse or a record is given."""
        return self.pulse is not None or self.record is not None

    @property
    def text(self) -> str:
        """The motion in words, without the numbers of a pulse."""
        if self.pulse is not None:
            return f"{self.pulse} pulse"
        floor = "" if self.floor_period is None else f", floor of {self.floor_period:g} s"
        scale = "" if self.scale is None else f" times {self.scale:g}"
        return f"record {self.record}{scale}{floor}"

    def read_unscaled(self) -> Motion:
        """Make the pulse, or read the record, without the factor."""
        if self.pulse is None and self.record is None:
            raise ValueError(
                "--pulse or --record must be given, got neither; --record example takes the"
                " record in jaxrock"
            )
        if self.pulse is not None and self.record is not None:
            raise ValueError(
                f"--pulse and --record exclude each other, got {self.pulse} and"
                f" {self.record}: leave out one of them"
            )
        if self.pulse is None:
            of_pulse = ("amplitude", "pulse_duration")
            refuse_beside("--record", **{name: getattr(self, name) for name in of_pulse})
            return super().read_unscaled()
        of_record = (
            "unit",
            "column",
            "vertical",
            "time_step",
            "floor_period",
            "floor_damping",
            "floor_participation",
        )
        refuse_beside("--pulse", **{name: getattr(self, name) for name in of_record})
        if self.amplitude is None or self.pulse_duration is None:
            of_pulse = ("amplitude", "pulse_duration")
            missing = [write_option(name) for name in of_pulse if getattr(self, name) is None]
            raise ValueError(f"{' and '.join(missing)} must be given with --pulse")
        check("pulse_duration", self.pulse_duration, POSITIVE)
        return PULSES[self.pulse](self.amplitude, self.pulse_duration)


@_OF_MOTION
@dataclass(frozen=True, kw_only=True)
class SuiteOptions:
    """Options that describe a suite of records, and the hazard of a site."""

    records: str = "example"
    """Folder of records, "example" for jaxrock's twenty, or a set of FEMA P695, such as
    fema-far-field."""
    unit: str | None = None
    """Unit of the records, if the files state none: m/s2, cm/s2, mm/s2, gal, g, %g or mg."""
    time_step: float | None = None
    """Time between samples [s], if the files state none."""
    with_vertical: bool = False
    """Include the vertical component of each record."""
    direction: Direction | None = None
    """Direction of the records. If not given: both for one-sided blocks, as recorded for
    others."""
    floor_period: float | None = None
    """Period of the floor on which objects stand [s]. Without it, they stand on the ground."""
    floor_damping: float | None = None
    """Damping ratio of that floor [-]. 0.05 if not given."""
    floor_participation: float | None = None
    """Participation of its mode in the motion of that floor [-]. 1 if not given."""
    hazard: Path | None = None
    """A .csv file with levels and rates per year, or a hazard curve of OpenQuake or
    nshmp-haz; of the latter, a curve of --measure."""
    hazard_unit: str | None = None
    """Unit of the levels of the hazard, if the file states none: m/s, cm/s, m/s2, g ..."""
    hazard_site: tuple[float, ...] | None = None
    """Longitude and latitude of the site [deg], if the file has curves of several sites."""

    @property
    def floor(self) -> tuple[float | None, float | None, float | None]:
        """The floor: its period, damping and participation."""
        return self.floor_period, self.floor_damping, self.floor_participation

    def read_suite(self, one_sided: bool = False) -> Suite:
        """Read the records of a folder, or take those of a name; on their floor, in a direction."""
        suite = read_records(self.records, self.unit, self.time_step, self.with_vertical)
        suite = put_on_floor(suite, *self.floor)
        return turn_suite(suite, self.direction, one_sided)

    def read_hazard(self, measure: str) -> Hazard | None:
        """Read the hazard, of this measure; None if none is given."""
        if self.hazard is None:
            refuse("--hazard", hazard_unit=self.hazard_unit, hazard_site=self.hazard_site)
            return None
        if measure not in ("pgv", "pga"):
            raise ValueError(
                f"--hazard goes with --measure pgv or pga only, got --measure {measure}"
            )
        site = None
        if self.hazard_site is not None:
            site = self.hazard_site
            if len(site) != 2:
                words = " ".join(f"{value:g}" for value in site)
                raise ValueError(
                    "--hazard-site must be a longitude and a latitude, as in --hazard-site"
                    f" 10.5 45, got {words or 'none'}"
                )
        with naming_arguments(unit="--hazard-unit", site="--hazard-site"):
            return read_hazard(self.hazard, unit=self.hazard_unit, measure=measure, site=site)


def put_on_floor(
    suite: Suite,
    period: float | None,
    damping: float | None,
    participation: float | None = None,
) -> Suite:
    """Put a suite on the floor of a period; the suite itself where none is given."""
    if period is None:
        refuse("--floor-period", floor_damping=damping, floor_participation=participation)
        return suite
    check("floor_period", period, POSITIVE)
    check("floor_period", period, FLOOR_PERIOD)
    given = {"damping": damping, "participation": participation}
    floor = {name: value for name, value in given.items() if value is not None}
    return suite.on_floor(period, time_step=choose_floor_step(period), **floor)


def turn_suite(suite: Suite, direction: Direction | None, one_sided: bool) -> Suite:
    """Turn the records of a suite; in both directions if none is given and blocks are one-sided.

    The answers of free-standing blocks are the same in each direction.
    """
    if direction is None:
        direction = "both" if one_sided else "recorded"
    if direction == "recorded":
        return suite
    both = suite.both_directions()
    return both if direction == "both" else cast("Suite", both[len(suite) :])


def read_records(
    records: str, unit: str | None, time_step: float | None, vertical: bool = False
) -> Suite:
    """Read the records of a folder, or take the suite of this name."""
    fema_set = records.removeprefix("fema-")
    is_fema = fema_set != records
    if records != "example" and not (is_fema and fema_set in FEMA_SETS):
        if not Path(records).exists():
            sets = ", ".join(f"fema-{name}" for name in FEMA_SETS)
            raise ValueError(
                f"--records must be a folder that exists, example, or one of {sets}, got"
                f" {records!r}"
            )
        return read_suite(records, unit=unit, time_step=time_step, vertical=vertical)
    _refuse_stated_units(f"--records {records} states its own", unit, time_step)
    if records == "example":
        return example_suite(vertical=vertical)
    if vertical:
        raise ValueError(
            f"--records {records} has no vertical component: leave out --with-vertical"
        )
    return fema_p695_suite(fema_set)


def _refuse_stated_units(example: str, unit: str | None, time_step: float | None) -> None:
    """Raise `ValueError` for what records that come with jaxrock state themselves."""
    options = {"--unit": unit, "--time-step": time_step}
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise ValueError(f"{example} unit and time step: leave out {' and '.join(given)}")
