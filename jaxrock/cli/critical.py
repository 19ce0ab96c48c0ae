"""``jaxrock critical``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .. import resonance
from ..overturning import Boundaries, checked, critical_amplitude, overturning_boundaries
from ..resonance import Linearized, Nonlinear
from ..validation import COUNT, NON_NEGATIVE, check
from .options import (
    Answer,
    BlockOptions,
    Grid,
    ModelName,
    MotionOptions,
    Writing,
    numbers,
    write_rows,
)

_CLOSED_FORMS = (
    "critical_intensity",
    "critical_width",
    "critical_slenderness",
    "critical_restitution",
)


@dataclass(frozen=True, kw_only=True)
class Critical(MotionOptions, BlockOptions, Writing):
    """What just overturns a block: pulses timed to its impacts, a pulse that lasts, a record.

    Without a pulse or a record: critical intensities in closed form, by both equations, and
    the width, slenderness and restitution with which the given intensity just overturns.
    With one: every boundary between standing and overturning along a quantity. Writes
    critical.csv if given a folder.

    Example: jaxrock critical --width 0.2 --pulse sine --pulse-duration 0.5
    """

    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    half_cycles: tuple[float, ...] = (1.0, 2.0, 5.0, math.inf)
    """In how many half-cycles instantaneous pulses are to overturn the block."""
    out: Path | None = None
    """Folder for critical.csv; none is written if not given."""
    amplitude: float | None = None
    """Largest acceleration of the pulse [m/s2]. Not needed if sought."""
    pulse_duration: float | None = None
    """Duration of the pulse [s]. Not needed if sought."""
    along: (
        Literal["amplitude", "duration", "factor", "half_width", "slenderness", "restitution"]
        | None
    ) = None
    """What to seek: the amplitude of a pulse and the factor on a record if not given."""
    values: Grid | None = None
    """Values to try, one by one or START:STOP:COUNT. If not given, amplitudes 1 to 10 times what
    just lifts the block, or factors 0.05:5:397."""
    model: ModelName | None = None
    """Equation of motion under a pulse or a record; nonlinear if not given."""

    @property
    def names(self) -> tuple[str, ...]:
        """One table."""
        return ("critical.csv",)

    @property
    def sought(self) -> str:
        """The quantity along which boundaries are sought."""
        return self.along or ("amplitude" if self.pulse else "factor")

    @property
    def motion(self) -> Any:
        """The pulse or the record; what is sought may be any."""
        name = self._sought_of_pulse
        if name is None or getattr(self, name) is not None:
            return super().motion
        return replace(self, **{name: 1.0}).motion

    @property
    def _sought_of_pulse(self) -> str | None:
        """The option of the pulse that is sought, if it is one."""
        of_pulse = {"amplitude": "amplitude", "duration": "pulse_duration"}
        return None if self.pulse is None else of_pulse.get(self.sought)

    def check(self) -> None:
        """The block, the question and the files."""
        _ = self.block
        _ = self.coefficient
        check("intensity", self.intensity, NON_NEGATIVE)
        for number in self.half_cycles:
            check("half_cycles", number, COUNT)
        if not self.half_cycles:
            raise ValueError("half_cycles must be at least one number, got none")
        if not self.shaken:
            self.refuse_motion()
            self.refuse("along", "values", "model", only_with="a pulse or a record")
        else:
            self._check_search()
        super().check()

    def run(self) -> Answer:
        """Solve in closed form, or search in driven motion."""
        if self.shaken:
            found = self._boundaries()
            names = [self.sought, "overturns_beyond", "impacts", "toppled"]
            rows, text = _rows(found, names), str(found)
        else:
            rows = self._closed_form()
            names = ["half_cycles", "model", *_CLOSED_FORMS]
            text = "\n".join(self._lines(rows))
        if self.out is not None:
            with self.written() as scratch:
                write_rows(rows, scratch / "critical.csv", names)
        return self.finished(text, {"rows": rows})

    def _check_search(self) -> None:
        self.refuse("intensity", "half_cycles", only_with="instantaneous pulses")
        own = self._sought_of_pulse
        if own is not None and getattr(self, own) is not None:
            raise ValueError(f"{own} is sought: it must not be given")
        if own == "amplitude":
            self.refuse("scale", only_with="amplitudes that are not sought")
        motion = self.motion
        if self._values is not None:
            checked(self.block, self.coefficient, motion, self.sought, self._values)
        elif self.sought != "amplitude":
            raise ValueError(f"values must be given along {self.sought}")
        elif self.pulse is None:
            raise ValueError("along amplitude goes with a pulse; a record has a factor")

    @property
    def _values(self) -> Any:
        if self.values is not None:
            return np.asarray(numbers("values", self.values))
        return np.linspace(0.05, 5, 397) if self.sought == "factor" else None

    def _boundaries(self) -> "Boundaries":
        motion: Any = self.motion
        block, c = self.block, self.coefficient
        if self._values is None:
            found = critical_amplitude(
                block, c, type(motion), motion.duration, model=self.model or "nonlinear"
            )
        else:
            found = overturning_boundaries(
                block, c, motion, self.sought, self._values, model=self.model or "nonlinear"
            )
        if not bool(found.complete):
            raise ValueError("motion could not be followed to its end for every one of the values")
        return found

    def _closed_form(self) -> list[dict[str, Any]]:
        block, c, intensity = self.block, self.coefficient, self.intensity
        rows = []
        for number in self.half_cycles:
            for model in (Linearized(), Nonlinear()):
                found = (
                    resonance.critical_intensity(block, c, number, model),
                    resonance.critical_width(block, c, intensity, number, model),
                    resonance.critical_slenderness(block, c, intensity, number, model),
                    resonance.critical_restitution(block, intensity, number, model),
                )
                row = {"half_cycles": number, "model": model.name}
                rows.append(row | dict(zip(_CLOSED_FORMS, map(float, found), strict=True)))
        return rows

    def _lines(self, rows: list[dict[str, Any]]) -> list[str]:
        lines = [
            f"restitution {self.coefficient:.6g}; width, slenderness and restitution are those"
            f" that {self.intensity:g} m/s just overturn",
            "half-cycles  model        intensity [m/s]  width [m]  slenderness  restitution",
        ]
        for row in rows:
            number, model, *found = row.values()
            lines.append(
                f"{number:<11g}  {model:<11}  {found[0]:<15.6g}  {found[1]:<9.5g}"
                f"  {found[2]:<11.5g}  {found[3]:.6g}"
            )
        return lines


def _rows(found: "Boundaries", names: Sequence[str]) -> list[dict[str, Any]]:
    columns = (found.value, found.overturns_beyond, found.impacts, found.toppled)
    table = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    return [dict(zip(names, row, strict=True)) for row in table]
