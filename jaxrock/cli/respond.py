"""``jaxrock respond``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..dynamics import Response, Status, respond
from ..host import labelled
from ..validation import POSITIVE, check
from .options import Answer, BlockOptions, ModelName, MotionOptions, Writing
from .output import picture

if TYPE_CHECKING:
    import xarray

_NUMBERS = (
    "peak_rotation",
    "peak_time",
    "overturning_time",
    "margin",
    "final_rotation",
    "final_velocity",
    "friction_demand",
    "normal_force",
)


@dataclass(frozen=True, kw_only=True)
class Respond(MotionOptions, BlockOptions, Writing):
    """Response of one block to a pulse or a record, through every impact.

    Writes response.csv and response.nc (rotation over time), impacts.csv and response.png
    (rotation over time and phase portrait).

    Example: jaxrock respond --pulse sine --amplitude 4 --pulse-duration 0.5
    """

    FILES = ("response.csv", "impacts.csv", "response.nc", "response.png")

    duration: float | None = None
    """Time to follow the block for [s]. 10 s beyond the input if not given."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    animate: bool = False
    """Write response.gif as well."""
    out: Path = Path("response")

    @property
    def names(self) -> Sequence[str]:
        """An animation if asked for, besides the files that are always written."""
        return [*self.FILES, "response.gif"] if self.animate else self.FILES

    def check(self) -> None:
        """The motion, the duration, the block and the files."""
        _ = self.coefficient  # which has a block
        _ = self.motion
        if self.duration is not None:
            check("duration", self.duration, POSITIVE)
        super().check()

    def run(self) -> Answer:
        """Follow the block."""
        from ..plot import animate, plot_phase, plot_response

        motion = self.motion
        length = float(motion.end) + 10 if self.duration is None else self.duration
        response = respond(self.block, self.coefficient, motion, length, model=self.model)
        if response.status > Status.LIST_FULL:
            raise ValueError(f"motion could not be followed to its end: {response}")
        history = _history(response, np.linspace(0, length, 4001))

        def draw(panels: Any) -> None:
            plot_response(response, panels[0])
            plot_phase(response, panels[1])

        with self.written() as scratch:
            history.to_dataframe().to_csv(scratch / "response.csv")
            impacts = np.stack([response.impact_times, response.impact_velocities], axis=1)
            header = "time_s,velocity_before_rad_per_s"
            np.savetxt(scratch / "impacts.csv", impacts, delimiter=",", header=header, comments="")
            history.to_netcdf(scratch / "response.nc")
            sizes = {"figsize": (11, 4), "width_ratios": (1.6, 1)}
            picture(draw, scratch / "response.png", ncols=2, **sizes)
            if self.animate:
                animate(response, scratch / "response.gif")
        return self.finished(str(response), _scalars(response))


def _scalars(response: Response) -> dict[str, Any]:
    counts = {name: int(getattr(response, name)) for name in ("overturned", "impacts", "at_rest")}
    values = {name: float(getattr(response, name)) for name in _NUMBERS}
    return {"status": Status(int(response.status)).name.lower(), **counts, **values}


def _history(response: Response, times: np.ndarray) -> "xarray.Dataset":
    rotation, velocity = response.history(times)
    ratio = rotation / response.scene.block.critical_angle
    variables = {
        "rotation": (rotation, "rotation", "rad"),
        "velocity": (velocity, "angular velocity", "rad s-1"),
        "rotation_ratio": (ratio, "rotation over critical angle", "1"),
        "time": (times, "time", "s"),
    }
    described = {
        name: ("time", values, {"long_name": label, "units": unit})
        for name, (values, label, unit) in variables.items()
    }
    time = {"time": described.pop("time")}
    return labelled("Response of a rocking block", described, time, _scalars(response))
