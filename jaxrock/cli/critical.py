"""The command about what just overturns a block, in closed form or along a quantity."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np

from .. import resonance
from ..block import SIDES, SIZES_IN_WORDS
from ..driven import require_complete
from ..ground_motion import Motion
from ..overturning import (
    UNITS,
    Boundaries,
    check_subject,
    critical_amplitude,
    critical_factor,
    overturning_boundaries,
    uplift_factor,
)
from ..tables import write_csv
from ..validation import COUNT, NON_NEGATIVE, check
from .command import OF_OUTPUT, Answer, Grid, ModelName, Steps, Writing, save_picture
from .options import BlockOptions, MotionOptions

if TYPE_CHECKING:
    import matplotlib.axes

Quantity = Literal[
    "amplitude",
    "duration",
    "factor",
    "width",
    "height",
    "half_width",
    "slenderness",
    "inertia_ratio",
    "restitution",
]
_UNITS = {
    **UNITS,
    "critical_intensity": "m/s",
    **dict.fromkeys(
        ("width_at_this_height", "width_at_this_slenderness", "height_at_this_width"), "m"
    ),
    **dict.fromkeys(("factor", "slenderness", "inertia_ratio", "restitution"), "-"),
    **dict.fromkeys(("critical_slenderness", "critical_restitution"), "-"),
}
# Ranges of factors and amplitudes, over the one that lifts the block. The second one of
# amplitudes, of short pulses, is examined if there is no boundary in the first.
_FACTORS = (1.0, 50.0)
_AMPLITUDES = ((1.0, 10.0), (10.0, 100.0))
_MOST_LINES = 12  # of boundaries that are printed; the table has all


class _Examined(NamedTuple):
    """Boundaries, the ends of the range that was examined, and what lifts the block."""

    boundaries: Boundaries
    ends: tuple[float, float]
    uplift: float


class Critical(MotionOptions, BlockOptions, Writing):
    """Limits at which a block overturns: under timed pulses, one longer pulse, or a record.

    Without a pulse or a record: critical intensities in closed form, by both equations, and
    the sizes and the restitution with which the given intensity just overturns. With one: what
    lifts the block, and every boundary between standing and overturning along a quantity.
    Writes critical.csv and critical.png if given a folder.

    Example: jaxrock critical --width 0.2 --pulse sine --pulse-duration 0.5
    """

    command = "critical"

    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    half_cycles: tuple[float, ...] = (1.0, 2.0, 5.0, math.inf)
    """Numbers of half-cycles in which instantaneous pulses are to overturn the block."""
    out: Annotated[Path | None, OF_OUTPUT] = None
    """Folder for critical.csv and critical.png; none is written if not given."""
    along: Quantity | None = None
    """Quantity to seek instead of giving it; by default a pulse's amplitude, a record's factor."""
    values: Grid | None = None
    """Values to examine; by default amplitudes or factors of 1 to 10 or 50 times uplift."""
    model: ModelName | None = None
    """Equation of motion under a pulse or a record; nonlinear if not given."""

    def _carry_out(self) -> Steps:
        # Properties that check what they are made of; both are used below the `yield` only.
        _ = self.block, self.coefficient
        check("intensity", self.intensity, NON_NEGATIVE)
        for number in self.read_numbers("half_cycles"):
            check("half_cycles", number, COUNT)
        if self.shaken:
            self.refuse("intensity", "half_cycles", only_with="instantaneous pulses")
        else:
            self.refuse("along", "values", "model", only_with="a pulse or a record")
        search = self._plan_search() if self.shaken else None
        folder = yield "critical.csv", "critical.png"
        found = self._find_boundaries(*search) if search else None
        columns, text, data = (
            self._describe_boundaries(found) if found else self._compute_closed_form()
        )
        columns = {name: np.asarray(column).tolist() for name, column in columns.items()}
        table = list(zip(*columns.values(), strict=True))
        if folder is not None:
            write_csv(folder / "critical.csv", columns, _UNITS, self.about)
            save_picture(self._draw(found), folder / "critical.png")
        rows = [dict(zip(columns, row, strict=True)) for row in table]
        return Answer(text, {"rows": rows, **data})

    def _plan_search(self) -> tuple[Motion, str, np.ndarray | None]:
        """Plan the search for boundaries: the motion, the quantity, the values to examine.

        The values are None for amplitudes of a pulse and for factors: the library knows where
        to look.
        """
        along = self.along or ("amplitude" if self.pulse else "factor")
        sought = {"amplitude": "amplitude", "duration": "pulse_duration"}.get(along)
        if sought and self.pulse is None:
            raise ValueError(f"along {along} goes with a pulse; a record has a factor")
        if sought and getattr(self, sought) is not None:
            raise ValueError(f"{sought} is sought: it must not be given")
        if along == "amplitude":
            self.refuse("scale", only_with="amplitudes that are not sought")
        # A pulse needs a value of the quantity sought, which the search replaces: 1 stands in.
        motion = (replace(self, **{sought: 1.0}) if sought else self).motion
        if self.values is not None:
            values = np.asarray(self.read_numbers("values"))
            check_subject(self.block, self.coefficient, motion, along, values)
            return motion, along, values
        if along not in ("factor", "amplitude"):
            raise ValueError(f"values must be given along {along}")
        return motion, along, None

    def _find_boundaries(
        self, motion: Motion, along: str, values: np.ndarray | None
    ) -> _Examined:
        """Find the boundaries of overturning, and what lifts the block.

        That is a factor on the motion, or an amplitude where this is sought.
        """
        block = self.block
        c = self.coefficient
        model = self.model or "nonlinear"
        # Where an amplitude is sought the motion has an amplitude of 1 m/s2.
        uplift = float(uplift_factor(block, motion, model=model))
        if values is not None:
            found = overturning_boundaries(block, c, motion, along, values, model=model)
            ends = values[0], values[-1]
        elif along == "factor":
            found = critical_factor(block, c, motion, _FACTORS, model=model)
            ends = _FACTORS[0] * uplift, _FACTORS[1] * uplift
        else:
            found, ends = self._find_amplitudes(motion, _AMPLITUDES[0], uplift)
            if not found.count:
                found, ends = self._find_amplitudes(motion, _AMPLITUDES[1], uplift)
        # A boundary may be hidden among values that were given up. A table with gaps would
        # mislead, so none is written.
        low, high = map(float, ends)
        require_complete(found.complete, **{along: f"between {low:g} and {high:g}"})
        return _Examined(found, (low, high), uplift)

    def _find_amplitudes(
        self, pulse: Any, ratios: tuple[float, float], uplift: float
    ) -> tuple[Boundaries, tuple[float, float]]:
        """Find the amplitudes of a pulse in a range, and the ends of all that was examined."""
        found = critical_amplitude(
            self.block,
            self.coefficient,
            type(pulse),
            pulse.duration,
            ratios,
            model=self.model or "nonlinear",
        )
        # A second range goes on where the first one ended.
        return found, (uplift, ratios[1] * uplift)

    def _describe_boundaries(
        self, found: _Examined
    ) -> tuple[dict[str, Any], str, Mapping[str, object]]:
        """Describe boundaries: columns of a table, text, and more data."""
        boundaries, ends, uplift = found
        along = boundaries.along
        names = "overturns_beyond", "impacts", "toppled"
        columns = {along: boundaries.value, **{n: getattr(boundaries, n) for n in names}}
        of = "amplitude" if along == "amplitude" else "factor"
        lines = [self._write_uplift(along, uplift)]
        if along in SIDES:
            other = "height" if along == "width" else "width"
            lines.append(f"{SIZES_IN_WORDS[along]} of {getattr(self.block, other):.6g} m")
        if along == "half_width":
            lines.append(f"{SIZES_IN_WORDS[along]} of {self.block.slenderness:.6g}")
        if self.values is not None:
            others = "" if boundaries.count else "; --values takes others"
            lines.append(f"{_shorten(str(boundaries))}{others}")
        else:
            unit = "{:.4g} m/s2" if of == "amplitude" else "factor {:.4g}"
            last = f"{unit.format(ends[1])}, {ends[1] / uplift:.3g} times uplift"
            lines += (
                [_shorten(str(boundaries)), f"examined up to {last}"]
                if boundaries.count
                else [f"stands up to {last}; --values takes others"]
            )
        data = {
            "along": along,
            "model": self.model or "nonlinear",
            f"uplift_{of}": uplift,
            "examined": list(ends),
        }
        return columns, "\n".join(lines), data

    def _write_uplift(self, along: str, uplift: float) -> str:
        """Write what lifts the block: an amplitude where it is sought, else a factor."""
        if math.isinf(uplift):
            return "never lifted, with any factor on the motion"
        if along == "amplitude":
            return f"lifted from {uplift:.4g} m/s2 on"
        if along == "factor":
            return f"lifted from factor {uplift:.4g} on"
        return f"the block as given is lifted from factor {uplift:.4g} on the motion on"

    def _compute_closed_form(
        self,
    ) -> tuple[dict[str, list[object]], str, Mapping[str, object]]:
        """Compute columns and text for instantaneous pulses, a row per number and model."""
        block = self.block
        c = self.coefficient
        pulse = self.intensity
        cases = list(itertools.product(self.half_cycles, ("linearized", "nonlinear")))
        columns: dict[str, list[Any]] = {"half_cycles": [n for n, _ in cases]}
        columns["model"] = [model for _, model in cases]
        columns["critical_intensity"] = [
            float(resonance.critical_intensity(block, c, *case)) for case in cases
        ]
        for fixed in ("height", "slenderness"):
            columns[f"width_at_this_{fixed}"] = [
                float(resonance.critical_width(block, c, pulse, *case, fixed=fixed))
                for case in cases
            ]
        columns["critical_slenderness"] = [
            float(resonance.critical_slenderness(block, c, pulse, *case)) for case in cases
        ]
        width = float(block.width)
        columns["height_at_this_width"] = [
            width * slenderness for slenderness in columns["critical_slenderness"]
        ]
        columns["critical_restitution"] = [
            float(resonance.critical_restitution(block, pulse, *case)) for case in cases
        ]
        line = "{:<11}  {:<10}  {:<9}  {:<11}  {:<16}  {:<10}  {}"
        heads = (
            ("", "", "", "width at", "size at this", "height at", ""),
            ("", "", "intensity", "this height", "slenderness,", "this width", "restitution"),
            ("half-cycles", "model", "[m/s]", "[m]", "width [m]", "[m]", "[-]"),
        )
        shown = [
            columns[name]
            for name in (
                *("half_cycles", "model", "critical_intensity", "width_at_this_height"),
                *("width_at_this_slenderness", "height_at_this_width"),
                "critical_restitution",
            )
        ]
        lines = [
            f"{width:.6g} m wide, {block.height:.6g} m high (slenderness"
            f" {block.slenderness:.6g}), restitution {c:.6g}; width, size, height and"
            f" restitution are those that {pulse:g} m/s just overturn",
            *(line.format(*head).rstrip() for head in heads),
            *(line.format(*map(_write_cell, row)) for row in zip(*shown, strict=True)),
        ]
        return columns, "\n".join(lines), {}

    def _draw(self, found: _Examined | None) -> "matplotlib.axes.Axes":
        """Draw the boundaries, or critical intensities in closed form."""
        from ..plot import plot_boundaries, plot_critical_intensity

        if found is None:
            return plot_critical_intensity(self.block, self.coefficient, self.intensity)
        # What lifts the block stands on the axis of factors or amplitudes only.
        of_axis = found.boundaries.along in ("factor", "amplitude")
        return plot_boundaries(
            found.boundaries, found.ends, uplift=found.uplift if of_axis else None
        )


def _shorten(text: str) -> str:
    """Leave out lines in the middle of many, and say how many."""
    lines = text.split("\n")
    if len(lines) <= _MOST_LINES:
        return text
    out = len(lines) - _MOST_LINES + 1
    return "\n".join([*lines[: _MOST_LINES - 2], f"... {out} more boundaries ...", lines[-1]])


def _write_cell(value: object) -> str:
    """Write a cell of the table that is printed."""
    if not isinstance(value, float):
        return str(value)
    return (
        "none" if math.isnan(value) else "unlimited" if math.isinf(value) else f"{value:.5g}"
    )
