"""Commands about one block: its assessment and its response."""

import math
from pathlib import Path

import numpy as np

from .. import resonance
from ..driven import respond
from ..grids import write_table
from ..host import Status, make_dataset
from ..overturning import uplift_factor
from ..reports import assessment
from ..tables import write_csv
from ..validation import POSITIVE, check
from .command import Answer, Folder, ModelName, Steps, Writing, save_picture
from .options import BlockOptions, MotionOptions


class Assess(BlockOptions):
    """Assess one block under pulses timed to its impacts.

    Geometry, the response to one pulse, the stabilized phase or the half-cycle in which the
    block overturns, critical pulse intensities and sensitivities, by the linearized and the
    nonlinear equation side by side. With a height, sensitivities are to the width at this
    height and the height at this width; else to the half-width at this slenderness and to the
    slenderness.

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
        # Who gives a height thinks of sides, and who gives none of size and slenderness.
        by_sides = self.height is not None
        return Answer(assessment.write_text(result, by_sides=by_sides), result)


class Respond(MotionOptions, BlockOptions, Writing):
    """Response of one block to a pulse or a record, through every impact.

    Writes response.csv and response.nc (rotation over time), impacts.csv and response.png
    (ground and rotation while the block moves, and phase portrait), and says from which factor
    on the motion lifts the block.

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
        status = Status(int(response.status))
        if status in (Status.STOPPED, Status.INVALID):
            raise ValueError(f"integration did not finish: {status.description}")
        data: dict[str, str | int | float] = {"status": status.name.lower()}
        data |= {n: int(getattr(response, n)) for n in ("overturned", "impacts", "at_rest")}
        data |= {name: float(getattr(response, name)) for name in _NUMBERS}
        data["uplift_factor"] = float(uplift_factor(block, motion, model=self.model))
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
        figure, (left, right) = plt.subplots(
            ncols=2, layout="constrained", figsize=(12, 4.8), width_ratios=(1.7, 1)
        )
        scene = self._describe_scene()
        figure.suptitle(scene, fontsize="medium")
        plot_response(response, left)
        save_picture(plot_phase(response, right), folder / "response.png")
        if self.animate:
            animate(response, folder / "response.gif")
        lifted = bool(response.peak_rotation > 0)
        lift = self._write_uplift(data["uplift_factor"], lifted)
        return Answer(f"{scene}\n{response}\n{lift}", data)

    def _describe_scene(self) -> str:
        """Describe the block, its restitution, and what shakes it with which factor."""
        block = self.block
        sizes = f"{2 * block.half_width:.4g} m wide, {2 * block.half_height:.4g} m high"
        if self.record is not None:
            named = "example record" if self.record == "example" else Path(self.record).name
            parts = [part for part in (self.column, self.vertical) if part is not None]
            motion = f"{named} ({', '.join(map(str, parts))})" if parts else named
        else:
            numbers = f"{self.amplitude:.4g} m/s2, {self.pulse_duration:.4g} s"
            motion = f"{self.pulse} pulse of {numbers}"
        return f"{sizes}, C = {self.coefficient:.4g}, {motion}, scaled by {self.scale:g}"

    def _write_uplift(self, factor: float, lifted: bool) -> str:
        """Write the factor on the motion from which on it lifts the block."""
        if math.isinf(factor):
            return "never lifted, with any factor on the motion"
        # A motion that lifts the block after the duration does lift it.
        begins = "lifted" if lifted or factor < 1 else "never lifted; it would be"
        scale = f" (scale {factor * self.scale:.4g})" if self.scale != 1 else ""
        return f"{begins} from factor {factor:.4g} on the motion on{scale}"


_NUMBERS = (
    *("peak_rotation", "peak_time", "overturning_time", "margin"),
    *("final_rotation", "final_velocity", "friction_demand", "normal_force"),
    "contact_loss_time",
)
