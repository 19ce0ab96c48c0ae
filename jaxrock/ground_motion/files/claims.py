"""Statements of a caller and a file about the unit and the time step of accelerations."""

import math
from typing import NamedTuple

from ...oldtables import UNITS_OF_ACCELERATION, NamedFile, Statement
from ...validation import POSITIVE, as_real, check
from ..units import convert_unit, require_unit

# Relative difference of time steps that count as the same: files print them with few digits.
UNIFORM = 1e-3
# Of units, which are products of few factors.
_SAME_UNIT = 1e-9
_STEP = "a time step in s, ms or the like, or in samples per second"


class Claims(NamedTuple):
    """Statements about the unit and the time step, which all have to agree."""

    # In m/s2. What the caller states comes first, so that errors say that the file disagrees.
    units: tuple[Statement, ...] = ()
    # In s.
    steps: tuple[Statement, ...] = ()

    def add_unit(self, line: int, words: str, unit: str | float) -> "Claims":
        """Add that a line states a unit, in words or in m/s2."""
        factor = convert_unit(unit) if isinstance(unit, str) else unit
        return self._replace(units=(*self.units, Statement(line, words, factor)))

    def add_step(self, line: int, words: str, step: float) -> "Claims":
        """Add that a line states a time step [s]."""
        return self._replace(steps=(*self.steps, Statement(line, words, step)))

    def require_unit(self, file: NamedFile, missing: str = "the file states none") -> float:
        """Return the unit [m/s2]; a `ValueError` if it is `missing`, or statements disagree."""
        for line, words, factor in self.units:
            if math.isnan(factor):
                raise file.error(f"{words}, which is not {UNITS_OF_ACCELERATION}", line)
        missing = f"{missing}, so that unit must be given: {UNITS_OF_ACCELERATION}"
        return file.require_agreement(self.units, UNITS_OF_ACCELERATION, _SAME_UNIT, missing)

    def require_step(
        self, file: NamedFile, missing: str = "the file states none", line: int = 0
    ) -> float:
        """Return the step [s]; a `ValueError` if it is `missing`, or statements disagree."""
        missing = f"{missing}, so that time_step must be given"
        return file.require_agreement(self.steps, _STEP, UNIFORM, missing, line)


def make_claims(unit: str | None, time_step: float | int | None) -> Claims:
    """Collect what the caller states."""
    claims = Claims()
    if unit is not None:
        claims = claims.add_unit(0, f"unit is {unit!r}", require_unit(unit))
    if time_step is not None:
        step = as_real("time_step", time_step, unit="s")
        check("time_step", step, POSITIVE)
        seconds = float(time_step if isinstance(time_step, float | int) else step)
        claims = claims.add_step(0, f"time_step is {seconds} s", seconds)
    return claims
