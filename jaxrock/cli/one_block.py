"""Commands about one block: its assessment, its response, its boundaries of overturning."""

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .. import resonance
from ..driven import Status, respond
from ..grids import write_table
from ..ground_motion import Motion
from ..host import make_dataset, write_csv
from ..overturning import UNITS, check_subject, critical_amplitude, overturning_boundaries
from ..reports import assessment
from ..validation import COUNT, NON_NEGATIVE, POSITIVE, check
from .command import OF_OUTPUT, Answer, Folder, Grid, ModelName, Steps, Writing, save_picture
from .options import BlockOptions, MotionOptions

Quantity = Literal[
    "amplitude",
    "duration",
    "factor",
    "half_width",
    "slenderness",
    "inertia_ratio",
    "restitution",
]


class Assess(BlockOptions):
    """Assess one block under pulses timed to its impacts.

    Geometry, the response to one pulse, the stabilized phase or the half-cycle in which the
    block overturns, critical pulse intensities and sensitivities, by the linearized and the
    nonlinear equation side by side.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7
    """

    command = "assess"

    intensity: float = 0.15
    """Change of ground velocity in each pulse [m/s]."""
    tolerance: float | None = None
    """Name the equation and the precision that are good enough for this relative error."""

    def _carry_out(self) -> Steps:
        if self.tolerance is not None:
            check("tolerance", self.tolerance, POSITIVE)
        scene = resonance.Scene(self.block, self.coefficient, self.intensity)
        yield ()
        result = assessment.assess(scene, self.tolerance)
        return Answer(assessment.write_text(result), result)


class Respond(MotionOptions, BlockOptions, Writing):
    """Response of one block to a pulse or a record, through every impact.

    Writes response.csv and response.nc (rotation over time), impacts.csv and response.png
    (ground and rotation while the block moves, and phase portrait).

    Example: jaxrock respond --pulse sine --amplitude 4 --pulse-duration 0.5
    """

    command = "respond"

    duration: float | None = None
    """Time to follow the block [s]; by default 10 s beyond the input."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    animate: bool = False
    """Write response.gif as well."""
    out: Folder = Path("response")

    def _carry_out(self) -> Steps:
        if self.duration is not None:
            check("duration", self.duration, POSITIVE)
        block = self.block
        c = self.coefficient
        motion = self.motion
        names = "response.csv", "impacts.csv", "response.nc", "response.png"
        folder = yield (*names, "response.gif") if self.animate else names
        # After the check: a wrong option is told before matplotlib has loaded.
        import matplotlib.pyplot as plt

        from ..plot import animate, plot_phase, plot_response

        length = float(motion.end) + 10 if self.duration is None else self.duration
        response = respond(block, c, motion, length, model=self.model)
        # No file is written of a motion that breaks off: half of it would look like all.
        if response.status in (Status.STOPPED, Status.INVALID):
            raise ValueError(f"motion could not be followed to its end: {response}")
        data: dict[str, str | int | float] = {
            "status": Status(int(response.status)).name.lower()
        }
        data |= {n: int(getattr(response, n)) for n in ("overturned", "impacts", "at_rest")}
        data |= {name: float(getattr(response, name)) for name in _NUMBERS}
        times = np.linspace(0, length, 4001)
        rotation, velocity = response.history(times)
        ratio = {"long_name": "rotation over critical angle", "units": "1"}
        variables = {
            "rotation": ("time", rotation, {"long_name": "rotation", "units": "rad"}),
            "velocity": (
                "time",
                velocity,
                {"long_name": "angular velocity", "units": "rad s-1"},
            ),
            "rotation_ratio": ("time", rotation / block.critical_angle, ratio),
        }
        time = {"time": ("time", times, {"long_name": "time", "units": "s"})}
        about = {**self.about, **data}
        history = make_dataset("Response of a rocking block", variables, time, about)
        history.to_netcdf(folder / "response.nc")
        write_table(history, folder / "response.csv")
        impacts = {
            "time": np.asarray(response.impact_times).tolist(),
            "velocity_before": np.asarray(response.impact_velocities).tolist(),
        }
        units = {"time": "s", "velocity_before": "rad/s"}
        write_csv(folder / "impacts.csv", impacts, units, self.about)
        _, (left, right) = plt.subplots(
            ncols=2, layout="constrained", figsize=(12, 4.8), width_ratios=(1.7, 1)
        )
        plot_response(response, left)
        save_picture(plot_phase(response, right), folder / "response.png")
        if self.animate:
            animate(response, folder / "response.gif")
        return Answer(str(response), data)


_NUMBERS = (
    *("peak_rotation", "peak_time", "overturning_time", "margin"),
    *("final_rotation", "final_velocity", "friction_demand", "normal_force"),
    "contact_loss_time",
)


_UNITS = {
    **UNITS,
    "factor": "-",
    **{"critical_intensity": "m/s", "critical_width": "m"},
    **dict.fromkeys(("slenderness", "inertia_ratio", "restitution"), "-"),
    **dict.fromkeys(("critical_slenderness", "critical_restitution"), "-"),
}


class Critical(MotionOptions, BlockOptions, Writing):
    """Limits at which a block overturns: under timed pulses, one longer pulse, or a record.

    Without a pulse or a record: critical intensities in closed form, by both equations, and
    the width, slenderness and restitution with which the given intensity just overturns.
    With one: every boundary between standing and overturning along a quantity. Writes
    critical.csv if given a folder.

    Example: jaxrock critical --width 0.2 --pulse sine --pulse-duration 0.5
    """

    command = "critical"

    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    half_cycles: tuple[float, ...] = (1.0, 2.0, 5.0, math.inf)
    """Numbers of half-cycles in which instantaneous pulses are to overturn the block."""
    out: Annotated[Path | None, OF_OUTPUT] = None
    """Folder for critical.csv; none is written if not given."""
    along: Quantity | None = None
    """Quantity to seek instead of giving it; by default a pulse's amplitude, a record's factor."""
    values: Grid | None = None
    """Values to examine; by default amplitudes of 1 to 10 times uplift, or factors 0.05:5:397."""
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
        folder = yield ["critical.csv"]
        columns, text = (
            self._find_boundaries(*search) if search else self._compute_closed_form()
        )
        columns = {name: np.asarray(column).tolist() for name, column in columns.items()}
        table = list(zip(*columns.values(), strict=True))
        if folder is not None:
            write_csv(folder / "critical.csv", columns, _UNITS, self.about)
        return Answer(text, {"rows": [dict(zip(columns, row, strict=True)) for row in table]})

    def _plan_search(self) -> tuple[Motion, str, np.ndarray | None]:
        """Plan the search for boundaries: the motion, the quantity, the values to examine.

        The values are None for amplitudes of a pulse: the library knows where to look.
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
        elif along == "factor":
            values = np.linspace(0.05, 5, 397)
        elif along == "amplitude":
            return motion, along, None
        else:
            raise ValueError(f"values must be given along {along}")
        check_subject(self.block, self.coefficient, motion, along, values)
        return motion, along, values

    def _find_boundaries(
        self, motion: Motion, along: str, values: np.ndarray | None
    ) -> tuple[dict[str, ArrayLike], str]:
        """Find the boundaries of overturning: columns of a table, and text."""
        block = self.block
        c = self.coefficient
        model = self.model or "nonlinear"
        if values is None:
            pulse: Any = motion
            found = critical_amplitude(block, c, type(pulse), pulse.duration, model=model)
        else:
            found = overturning_boundaries(block, c, motion, along, values, model=model)
        # A boundary may be hidden among values that were given up. A table with gaps would
        # mislead, so none is written.
        if not bool(found.complete):
            raise ValueError(
                "motion could not be followed to its end for every one of the values"
            )
        columns = {
            name: getattr(found, name) for name in ("overturns_beyond", "impacts", "toppled")
        }
        others = "" if found.count else "; --values takes others"
        return {along: found.value, **columns}, f"{found}{others}"

    def _compute_closed_form(self) -> tuple[dict[str, list[object]], str]:
        """Compute columns and text for instantaneous pulses, a row per number and model."""
        block = self.block
        c = self.coefficient
        pulse = self.intensity
        cases = list(itertools.product(self.half_cycles, ("linearized", "nonlinear")))
        given = {
            resonance.critical_intensity: (block, c),
            resonance.critical_width: (block, c, pulse),
            resonance.critical_slenderness: (block, c, pulse),
            resonance.critical_restitution: (block, pulse),
        }
        columns: dict[str, list[object]] = {"half_cycles": [n for n, _ in cases]}
        columns["model"] = [model for _, model in cases]
        for solve, first in given.items():
            columns[solve.__name__] = [float(solve(*first, *case)) for case in cases]
        line = "{:<11}  {:<11}  {:<15}  {:<9}  {:<11}  {}"
        lines = [
            f"restitution {c:.6g}; width, slenderness and restitution are those"
            f" that {pulse:g} m/s just overturn",
            "half-cycles  model        intensity [m/s]  width [m]  slenderness  restitution",
            *(
                line.format(*map(_write_cell, row))
                for row in zip(*columns.values(), strict=True)
            ),
        ]
        return columns, "\n".join(lines)


def _write_cell(value: object) -> str:
    """Write a cell of the table that is printed."""
    if not isinstance(value, float):
        return str(value)
    return (
        "none" if math.isnan(value) else "unlimited" if math.isinf(value) else f"{value:.5g}"
    )
