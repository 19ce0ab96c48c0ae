"""The command that simulates the response of one block."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import driven
from ..block import Block
from ..grids import write_table
from ..ground_motion import FLOOR_DAMPING
from ..host import Status, make_dataset, write_whole
from ..overturning import uplift_factor
from ..tables import write_csv
from ..validation import POSITIVE, check
from .answers import Answer, describe_options, save_picture
from .motion_options import MotionOptions
from .options import BlockOptions, FileOutput, Folder, ModelName

if TYPE_CHECKING:
    import xarray

_FILES = ("response.csv", "impacts.csv", "response.nc", "response.png")
_UNITS = {"time": "s", "velocity_before": "rad/s"}
_SUMMARY = (
    *("peak_rotation", "peak_time", "overturning_time", "margin"),
    *("final_rotation", "final_velocity", "friction_demand", "normal_force"),
    "contact_loss_time",
)


def respond(
    *,
    duration: float | None = None,
    model: ModelName = "nonlinear",
    animate: bool = False,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    out: Folder = Path("response"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Simulate the response of one block to a pulse or a record, through every impact.

    Writes response.csv and response.nc (rotation over time), impacts.csv and response.png
    (ground and rotation while the block moves, and phase portrait). Prints the smallest
    factor on the motion that lifts the block.

    Example: jaxrock respond --pulse sine --amplitude 4 --pulse-duration 0.5

    Parameters
    ----------
    duration
        Simulated time [s]; by default 10 s beyond the input.
    model
        Equation of motion.
    animate
        Write response.gif as well.
    out
        Folder to write to; made if it is missing.
    """
    about = describe_options("respond", locals())
    if duration is not None:
        check("duration", duration, POSITIVE)
    block = block_options.block
    c = block_options.coefficient
    motion = motion_options.read()
    names = (*_FILES, "response.gif") if animate else _FILES
    with write_whole("out", out, names, output.force) as folder:
        from ..plot import animate as write_film

        length = float(motion.end) + 10 if duration is None else duration
        response = driven.respond(block, c, motion, length, model=model)
        status = Status(int(response.status))
        # No file is written of a motion that breaks off: half of it would look like all.
        if status in (Status.STOPPED, Status.INVALID):
            raise ValueError(f"integration did not finish: {status.description}")
        uplift = float(uplift_factor(block, motion, model=model))
        summary = _summarize(response) | {"uplift_factor": uplift}
        history = _tabulate_history(response, block, length, {**about, **summary})
        history.to_netcdf(folder / "response.nc")
        write_table(history, folder / "response.csv")
        impacts = {
            "time": np.asarray(response.impact_times).tolist(),
            "velocity_before": np.asarray(response.impact_velocities).tolist(),
        }
        write_csv(folder / "impacts.csv", impacts, _UNITS, about)
        scene = _describe_scene(block_options, motion_options)
        _draw(response, scene, folder / "response.png")
        if animate:
            write_film(response, folder / "response.gif")
    lifts = _describe_uplift(response, uplift, motion_options.scale)
    text = f"{scene}\n{response}\n{lifts}"
    return Answer(text, summary, output, [out / name for name in names])


def _summarize(response: driven.Response) -> dict[str, str | int | float]:
    """Summarize a response as numbers, and its status as a word."""
    summary: dict[str, str | int | float] = {
        "status": Status(int(response.status)).name.lower()
    }
    for name in ("overturned", "impacts", "at_rest"):
        summary[name] = int(getattr(response, name))
    for name in _SUMMARY:
        summary[name] = float(getattr(response, name))
    return summary


def _tabulate_history(
    response: driven.Response, block: Block, length: float, about: dict[str, str | int | float]
) -> "xarray.Dataset":
    """Tabulate the motion over time."""
    times = np.linspace(0, length, 4001)
    rotation, velocity = response.history(times)
    ratio = {"long_name": "rotation over critical angle", "units": "1"}
    variables = {
        "rotation": ("time", rotation, {"long_name": "rotation", "units": "rad"}),
        "velocity": ("time", velocity, {"long_name": "angular velocity", "units": "rad s-1"}),
        "rotation_ratio": ("time", rotation / block.critical_angle, ratio),
    }
    time = {"time": ("time", times, {"long_name": "time", "units": "s"})}
    return make_dataset("Response of a rocking block", variables, time, about)


def _draw(response: driven.Response, title: str, path: Path) -> None:
    """Draw the motion over time and in the phase plane."""
    import matplotlib.pyplot as plt

    from ..plot import plot_phase, plot_response

    figure, (left, right) = plt.subplots(
        ncols=2, layout="constrained", figsize=(12, 4.8), width_ratios=(1.7, 1)
    )
    figure.suptitle(title, fontsize="medium")
    plot_response(response, left)
    plot_phase(response, right)
    save_picture(figure, path)


def _describe_scene(block_options: BlockOptions, options: MotionOptions) -> str:
    """Describe the block, its restitution, and the motion with its factor."""
    block = block_options.block
    sizes = f"{block.width:.4g} m wide, {block.height:.4g} m high"
    if options.record is None:
        size = f"{options.amplitude:.4g} m/s2, {options.pulse_duration:.4g} s"
        motion = f"{options.pulse} pulse of {size}"
    else:
        motion = "example record" if options.record == "example" else Path(options.record).name
        columns = [name for name in (options.column, options.vertical) if name is not None]
        if columns:
            motion = f"{motion} ({', '.join(columns)})"
    wall = ", one-sided" if block.one_sided else ""
    floor = ""
    if options.floor_period is not None:
        damping = options.floor_damping
        damping = FLOOR_DAMPING if damping is None else damping
        floor = f", on a floor of period {options.floor_period:g} s, damping {damping:g}"
        if options.floor_participation is not None:
            floor += f", participation {options.floor_participation:g}"
    scaled = f"scaled by {options.factor:g}"
    return f"{sizes}{wall}, {block_options.restitution_text}, {motion}, {scaled}{floor}"


def _describe_uplift(response: driven.Response, factor: float, scale: float | None) -> str:
    """Describe the factor on the motion from which on it lifts the block."""
    if math.isinf(factor):
        return "no factor on the motion lifts the block"
    # A motion that lifts the block after the duration does lift it.
    lifted = bool(response.peak_rotation > 0) or factor < 1
    begins = "the block lifts" if lifted else "the block is not lifted; it lifts"
    scaled = "" if scale in (None, 1.0) else f" (--scale {factor * scale:.4g})"
    return f"{begins} once the motion is multiplied by {factor:.4g} or more{scaled}"
