"""Options of a ground motion: one record or pulse, or a suite with the hazard of a site."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cyclopts import Group, Parameter

from .. import ground_motion
from ..ground_motion import Motion, Suite
from ..risk import Hazard, read_hazard
from ..validation import POSITIVE, check
from .options import refuse

# The panel of the help, below that of the block.
MOTION = Group("Ground motion", sort_key=2)
PulseShape = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]
_OF_RECORDS = ("unit", "column", "vertical", "time_step")
_OF_FLOORS = ("floor_period", "floor_damping")


@Parameter(name="*", group=MOTION)
@dataclass(frozen=True, kw_only=True)
class RecordOptions:
    """Options that files of records have in common, and their floor."""

    unit: str | None = None
    """Unit of records, if the files state none: m/s2, cm/s2, mm/s2, gal, g, %g or mg."""
    time_step: float | None = None
    """Time between samples [s], if the files state none."""
    floor_period: float | None = None
    """Period of the floor on which the block stands [s]. Without it, it stands on the ground."""
    floor_damping: float | None = None
    """Damping ratio of that floor [-]. 0.05 if not given."""

    def put_on_floor(self, suite: Suite) -> Suite:
        """Put a suite on the floor; the suite itself where none is given."""
        if self.floor_period is None:
            refuse("without --floor-period", floor_damping=self.floor_damping)
            return suite
        check("floor_period", self.floor_period, POSITIVE)
        check("floor_period", self.floor_period, ground_motion.FLOOR_PERIOD)
        damping = (
            ground_motion.FLOOR_DAMPING if self.floor_damping is None else self.floor_damping
        )
        step = ground_motion.choose_floor_step(self.floor_period)
        return suite.on_floor(self.floor_period, damping, time_step=step)

    def read_records(self, records: str) -> Suite:
        """Read the records of a folder, or take the suite of this name; on their floor."""
        stated = {"unit": self.unit, "time_step": self.time_step}
        if Path(records).exists():
            suite = ground_motion.read_suite(records, **stated)
        else:
            refuse(f"with --records {records}", **stated)
            suite = ground_motion.find_suite(records)
        return self.put_on_floor(suite)


@Parameter(name="*", group=MOTION)
@dataclass(frozen=True, kw_only=True)
class MotionOptions(RecordOptions):
    """Options that describe a pulse or a record."""

    record: str | None = None
    """File of a record, such as .AT2 or .csv, or "example" for the record in jaxrock."""
    column: str | None = None
    """Column or channel of the horizontal acceleration, where a file has several."""
    vertical: str | None = None
    """Column or channel of the vertical acceleration, or another file with it."""
    pulse: PulseShape | None = None
    """Shape of a pulse. Give this or a record."""
    amplitude: float | None = None
    """Largest acceleration of the pulse [m/s2]."""
    pulse_duration: float | None = None
    """Duration of the pulse [s]; of a ricker wavelet its period, a quarter of its length."""
    scale: float | None = None
    """Factor on the ground motion [-]; a negative one reverses it. 1 if not given."""

    @property
    def given(self) -> bool:
        """True if a pulse or a record is given."""
        return self.pulse is not None or self.record is not None

    @property
    def factor(self) -> float:
        """The factor on the ground motion."""
        return 1.0 if self.scale is None else self.scale

    @property
    def text(self) -> str:
        """The motion in words."""
        name = f"{self.pulse} pulse" if self.pulse else f"record {Path(str(self.record)).name}"
        numbers = {"s": self.pulse_duration, "m/s2": self.amplitude}
        size = "".join(f" {value:g} {unit}" for unit, value in numbers.items() if value)
        scale = "" if self.scale is None else f" times {self.scale:g}"
        floor = "" if self.floor_period is None else f", floor of {self.floor_period:g} s"
        return f"{name}{size}{scale}{floor}"

    def refuse(self, where: str) -> None:
        """Raise `ValueError` if any of these options is given."""
        refuse(where, **vars(self))

    def read(self) -> Motion:
        """Read the motion, scaled."""
        return self.read_unscaled().scaled(self.factor)

    def read_unscaled(self) -> Motion:
        """Make the pulse, or read the record on its floor, without the factor."""
        if (self.pulse is None) == (self.record is None):
            raise ValueError(
                "one of --pulse and --record must be given; --record example takes the record"
                " in jaxrock"
            )
        if self.pulse is not None:
            others = {name: getattr(self, name) for name in (*_OF_RECORDS, *_OF_FLOORS)}
            refuse("with --pulse", **others)
            if self.amplitude is None or self.pulse_duration is None:
                raise ValueError("--amplitude and --pulse-duration must be given with --pulse")
            check("pulse_duration", self.pulse_duration, POSITIVE)
            return ground_motion.PULSES[self.pulse](self.amplitude, self.pulse_duration)
        refuse("with --record", amplitude=self.amplitude, pulse_duration=self.pulse_duration)
        if self.record == "example":
            refuse("with --record example", unit=self.unit, time_step=self.time_step)
            upward = self.vertical is not None
            record = ground_motion.example_record(self.column or "north", vertical=upward)
        else:
            stated = {name: getattr(self, name) for name in _OF_RECORDS}
            record = ground_motion.read_record(str(self.record), **stated)
        return self.put_on_floor(Suite([record])).records[0]


@Parameter(name="*", group=MOTION)
@dataclass(frozen=True, kw_only=True)
class SuiteOptions(RecordOptions):
    """Options that describe a suite of records, and the hazard of a site."""

    records: str = "example"
    """Folder of records, "example" for jaxrock's twenty, or a set of FEMA P695, such as
    fema-far-field."""
    hazard: Path | None = None
    """A .csv file with levels and rates per year, or a hazard curve of OpenQuake."""

    def read_suite(self, one_sided: bool = False) -> Suite:
        """Read the records on their floor; of one-sided blocks in both directions."""
        suite = self.read_records(self.records)
        # The answers of free-standing blocks are the same in each direction.
        return suite.both_directions() if one_sided else suite

    def read_hazard(self, measure: str | None) -> Hazard | None:
        """Read the hazard, of this measure if one is given; None without a hazard."""
        return None if self.hazard is None else read_hazard(self.hazard, measure=measure)
