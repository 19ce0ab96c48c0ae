"""The command that fits measured impact times."""

import math
from dataclasses import field
from pathlib import Path

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..calibration import FreeRockingFit, fit_free_rocking, read_impact_times
from ..tables import write_csv
from ..validation import POSITIVE, check
from .command import Answer, Folder, ModelName, Steps, Writing, save_picture


class Fit(Writing):
    """Restitution of a block, and if need be its p, from the times of its impacts in a test.

    The block is tilted and let go; a microphone or an accelerometer beside it hears the
    impacts. The file has a line for each: its time [s], and perhaps after a comma the largest
    rotation between it and the next [rad]. Without a width the block is unknown, and p is
    fitted too. Writes fit.csv, a line for each time, and fit.png.

    Example: jaxrock fit times.csv

    Example: jaxrock fit times.csv --width 0.2 --height 1
    """

    command = "fit"

    file: Path = field(kw_only=False)
    """The file with the times of the impacts."""
    width: float | None = None
    """Full width 2b of the base [m]; if not given, the block is unknown."""
    height: float | None = None
    """Full height 2a, twice that of the centre of mass [m]. Give this or the slenderness."""
    slenderness: float | None = None
    """Height over width [-]."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle."""
    frequency_unknown: bool = False
    """Fit p although the block is given; its shape is kept."""
    model: ModelName | None = None
    """Equation of motion; by default nonlinear with a block, without one always linearized."""
    time_noise: float | None = None
    """Standard deviation of a measured time [s]; by default from the residuals."""
    rotation_noise: float | None = None
    """Standard deviation of a measured rotation [rad]; by default from the residuals."""
    no_repair: bool = False
    """Do not look for impacts that are missing, or times that are wrong."""
    out: Folder = Path("fit")

    def _carry_out(self) -> Steps:
        block = self._make_block()
        for name in ("time_noise", "rotation_noise"):
            if getattr(self, name) is not None:
                check(name, getattr(self, name), POSITIVE)
        times, peaks = read_impact_times(self.file)
        # Only the file says whether there are peaks, so it has to be read first.
        if peaks is None:
            self.refuse("rotation_noise", only_with="peak rotations in the file")
        folder = yield "fit.csv", "fit.png"
        from ..plot import plot_free_rocking_fit

        fit = fit_free_rocking(
            times,
            block,
            peak_rotations=peaks,
            model=self.model,
            frequency_known=not self.frequency_unknown,
            time_noise=self.time_noise,
            rotation_noise=self.rotation_noise,
            repair=not self.no_repair,
        )
        columns = _collect_columns(fit, peaks)
        write_csv(folder / "fit.csv", columns, _UNITS, self.about)
        save_picture(plot_free_rocking_fit(fit), folder / "fit.png")
        rows = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        return Answer(str(fit), {"model": fit.model, **_collect_data(fit), "rows": rows})

    def _make_block(self) -> Block | None:
        """Make the block; None if it is unknown, without a width."""
        if self.width is None:
            names = ("height", "slenderness", "gravity", "inertia_ratio")
            self.refuse(*names, "frequency_unknown", "model", only_with="a width")
            return None
        check("width", self.width, POSITIVE)
        if self.slenderness is not None and self.height is None:
            slenderness = self.slenderness
        elif self.height is not None and self.slenderness is None:
            check("height", self.height, POSITIVE)
            slenderness = self.height / self.width
        else:
            raise ValueError(
                "height or slenderness must be given with a width, one of the two"
            )
        return Block(self.width / 2, slenderness, self.gravity, self.inertia_ratio)


_UNITS = {
    **dict.fromkeys(("time", "residual"), "s"),
    **dict.fromkeys(("velocity_ratio", "restitution", "restitution_error"), "-"),
    **dict.fromkeys(("peak_rotation", "rotation_residual"), "rad"),
}


def _collect_columns(fit: FreeRockingFit, peaks: np.ndarray | None) -> dict[str, list[object]]:
    """List a value for each time, NaN where there is none."""
    # A restitution compares the half-cycles before and after an impact, which the first and
    # the last time do not have.
    columns = {
        "impact": fit.impact_numbers,
        "time": fit.impact_times,
        "used": fit.used,
        "residual": fit.time_residuals,
        "velocity_ratio": np.pad(fit.velocity_ratios, 1, constant_values=math.nan),
        "restitution": np.pad(fit.restitutions, 1, constant_values=math.nan),
        "restitution_error": np.pad(fit.restitution_errors, 1, constant_values=math.nan),
    }
    if peaks is not None:
        columns["peak_rotation"] = np.append(peaks, math.nan)
        columns["rotation_residual"] = np.append(fit.rotation_residuals, math.nan)
    return {name: np.asarray(column).tolist() for name, column in columns.items()}


def _collect_data(fit: FreeRockingFit) -> dict[str, object]:
    """Collect the numbers of the fit, NaN for those that it does not determine."""
    values = {name: float(getattr(fit, name)) for name in fit.names}
    errors = {
        name: math.nan if math.isnan(value) else float(fit.standard_errors[name])
        for name, value in values.items()
    }
    said = {name: float(getattr(fit, name)) for name in _NUMBERS}
    counts = {"impacts": fit.used.size, "used": int(fit.used.sum())}
    return {**counts, **values, "standard_errors": errors, **said, "remarks": fit.remarks}


_NUMBERS = (
    *("time_noise", "rotation_noise", "restitution_change", "restitution_change_error"),
    *("restitution_change_p_value", "frequency_p_value", "degrees_of_freedom"),
)
