"""``jaxrock critical``."""

import itertools
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..overturning import Boundaries, checked, critical_amplitude, overturning_boundaries
from ..resonance import (
    critical_intensity,
    critical_restitution,
    critical_slenderness,
    critical_width,
)
from ..validation import COUNT, NON_NEGATIVE, check
from .options import Answer, BlockOptions, Grid, ModelName, MotionOptions, Writing, numbers
from .output import Row, rows_of, write_rows

Quantity = Literal["amplitude", "duration", "factor", "half_width", "slenderness", "restitution"]


@dataclass(frozen=True, kw_only=True)
class Critical(MotionOptions, BlockOptions, Writing):
    """What just overturns a block: pulses timed to its impacts, one longer pulse, or a record.

    Without a pulse or a record: critical intensities in closed form, by both equations, and
    the width, slenderness and restitution with which the given intensity just overturns.
    With one: every boundary between standing and overturning along a quantity. Writes
    critical.csv if given a folder.

    Example: jaxrock critical --width 0.2 --pulse sine --pulse-duration 0.5
    """

    FILES = ("critical.csv",)

    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    half_cycles: tuple[float, ...] = (1.0, 2.0, 5.0, math.inf)
    """Numbers of half-cycles in which instantaneous pulses are to overturn the block."""
    out: Path | None = None
    """Folder for critical.csv; none is written if not given."""
    amplitude: float | None = None
    """Largest acceleration of the pulse [m/s2]. Not needed if sought."""
    pulse_duration: float | None = None
    """Duration of the pulse [s]. Not needed if sought."""
    along: Quantity | None = None
    """What to seek: the amplitude of a pulse and the factor on a record if not given."""
    values: Grid | None = None
    """Values to examine; by default amplitudes of 1 to 10 times uplift, or factors 0.05:5:397."""
    model: ModelName | None = None
    """Equation of motion under a pulse or a record; nonlinear if not given."""

    @property
    def sought(self) -> Quantity:
        """The quantity along which boundaries are sought."""
        return self.along or ("amplitude" if self.pulse else "factor")

    @property
    def motion(self) -> Any:
        """The pulse or the record; 1 stands in for what is sought of a pulse."""
        name = self._sought_of_pulse
        if name is None or getattr(self, name) is not None:
            return super().motion
        return replace(self, **{name: 1.0}).motion

    @property
    def _sought_of_pulse(self) -> str | None:
        """The option of the pulse that is sought, if it is one."""
        options = {"amplitude": "amplitude", "duration": "pulse_duration"}
        return options.get(self.sought) if self.pulse else None

    def check(self) -> None:
        """The question, the block and the files."""
        _ = self.coefficient  # which has a block
        check("intensity", self.intensity, NON_NEGATIVE)
        for number in self.half_cycles:
            check("half_cycles", number, COUNT)
        if not self.half_cycles:
            raise ValueError("half_cycles must be at least one number, got none")
        if self.shaken:
            self._check_search()
        else:
            self.refuse_motion()
            self.refuse("along", "values", "model", only_with="a pulse or a record")
        super().check()

    def _check_search(self) -> None:
        self.refuse("intensity", "half_cycles", only_with="instantaneous pulses")
        option = self._sought_of_pulse
        if option is not None and getattr(self, option) is not None:
            raise ValueError(f"{option} is sought: it must not be given")
        if option == "amplitude":
            self.refuse("scale", only_with="amplitudes that are not sought")
        motion, values = self.motion, self._values
        if values is not None:
            checked(self.block, self.coefficient, motion, self.sought, values)
        elif self.sought != "amplitude":
            raise ValueError(f"values must be given along {self.sought}")
        elif self.pulse is None:
            raise ValueError("along amplitude goes with a pulse; a record has a factor")

    @property
    def _values(self) -> np.ndarray | None:
        if self.values is not None:
            return np.asarray(numbers("values", self.values))
        return np.linspace(0.05, 5, 397) if self.sought == "factor" else None

    def run(self) -> Answer:
        """Solve in closed form, or search in driven motion."""
        if self.shaken:
            boundaries = self._boundaries()
            names = ("overturns_beyond", "impacts", "toppled")
            columns = {name: getattr(boundaries, name) for name in names}
            columns = {self.sought: boundaries.value, **columns}
            rows, text = rows_of(**columns), str(boundaries)
        else:
            rows = self._closed_form()
            columns, text = rows[0], self._table(rows)
        if self.out is not None:
            with self.written() as scratch:
                write_rows(rows, scratch / "critical.csv", list(columns))
        return self.finished(text, {"rows": rows})

    def _boundaries(self) -> Boundaries:
        motion, values, model = self.motion, self._values, self.model or "nonlinear"
        block, c = self.block, self.coefficient
        if values is None:
            boundaries = critical_amplitude(block, c, type(motion), motion.duration, model=model)
        else:
            boundaries = overturning_boundaries(block, c, motion, self.sought, values, model=model)
        if not bool(boundaries.complete):
            raise ValueError("motion could not be followed to its end for every one of the values")
        return boundaries

    def _closed_form(self) -> list[Row]:
        block, c, intensity = self.block, self.coefficient, self.intensity
        rows = []
        for number, model in itertools.product(self.half_cycles, ("linearized", "nonlinear")):
            answers = {
                "critical_intensity": critical_intensity(block, c, number, model),
                "critical_width": critical_width(block, c, intensity, number, model),
                "critical_slenderness": critical_slenderness(block, c, intensity, number, model),
                "critical_restitution": critical_restitution(block, intensity, number, model),
            }
            solutions = {name: float(answer) for name, answer in answers.items()}
            rows.append({"half_cycles": number, "model": model, **solutions})
        return rows

    def _table(self, rows: list[Row]) -> str:
        lines = [
            f"restitution {self.coefficient:.6g}; width, slenderness and restitution are those"
            f" that {self.intensity:g} m/s just overturn",
            "half-cycles  model        intensity [m/s]  width [m]  slenderness  restitution",
        ]
        line = "{:<11g}  {:<11}  {:<15.6g}  {:<9.5g}  {:<11.5g}  {:.6g}"
        return "\n".join([*lines, *(line.format(*row.values()) for row in rows)])
