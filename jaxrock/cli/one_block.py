"""The commands about one block: assessed, shaken, and its limits."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import driven, overturning, resonance
from ..ground_motion import PULSES, Record, describe_strength
from ..host import Status
from ..reports import assess as assess_block
from .answers import Answer, list_rows
from .motion_options import MotionOptions
from .options import BlockOptions, FileOutput, Grid, ModelName, Output, read_numbers, refuse

_SUMMARY = (
    *("overturned", "impacts", "at_rest", "peak_rotation", "peak_time", "overturning_time"),
    *("margin", "final_rotation", "final_velocity", "friction_demand", "normal_force"),
    "contact_loss_time",
)


def assess(
    *,
    intensity: float | None = None,
    details: bool = False,
    block_options: BlockOptions = BlockOptions(),
    output: Output = Output(),
) -> Answer:
    """Assess one block: what lifts it, what overturns it, and how far pulses make it rock.

    Pulses come at the worst moments, right after each impact. With an intensity, the command
    also computes the response to one pulse of this intensity, and the stabilized phase or the
    half-cycle in which the block overturns.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7 --intensity 0.15

    Parameters
    ----------
    intensity
        Change of ground velocity in each pulse [m/s].
    details
        Print all answers, of the linearized and the nonlinear equation side by side, with
        sensitivities to the restitution, the size and the intensity.
    """
    block, c = block_options.block, block_options.coefficient
    answers = assess_block(block, c, intensity)
    answers["scene"]["restitution_assumed"] = block_options.restitution is None
    text = answers.details() if details else answers
    return Answer(text, answers, output)


def respond(
    *,
    duration: float | None = None,
    model: ModelName = "nonlinear",
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Simulate the response of one block to a pulse or a record, through every impact.

    Writes response.csv and response.nc (rotation over time), impacts.csv and response.png
    (ground and rotation while the block moves). Prints the peak for factors of 0.9 to 1.1 on
    the motion, and the smallest factor that lifts the block.

    Example: jaxrock respond --width 0.8 --height 4 --pulse sine --amplitude 4 --pulse-duration 0.5

    Parameters
    ----------
    duration
        Simulated time [s]; by default 10 s beyond the input.
    model
        Equation of motion.
    """
    block, c = block_options.block, block_options.coefficient
    motion = motion_options.read()
    title = f"{block_options.text}, {motion_options.text}"
    with output.write("response", "impacts.csv") as files:
        length = float(motion.end) + 10 if duration is None else duration
        response = driven.respond(block, c, motion, length, model=model)
        status = Status(int(response.status))
        # No file is written of a motion that breaks off: half of it would look like all.
        driven.require_complete(np.array(status not in (Status.STOPPED, Status.INVALID)))
        uplift = float(overturning.uplift_factor(block, motion, model=model))
        # A response to a record may be irregular: the peaks around it say how many digits it has.
        scaled = motion.scaled(np.linspace(0.9, 1.1, 41))
        nearby = driven.respond_batch(block, c, scaled, length, model=model)
        history = response.table(np.linspace(0, length, 4001)).assign_attrs(scene=title)
        files.write_dataset(history, response.plot(), title)
        times, velocities = response.impact_times, response.impact_velocities
        columns = {"time": times.tolist(), "velocity_before": velocities.tolist()}
        files.write_csv("impacts.csv", columns, scene=title)
    data = {"status": status.name.lower(), "uplift_factor": uplift}
    data |= {name: np.asarray(getattr(response, name)).item() for name in _SUMMARY}
    strength = describe_strength(motion) if isinstance(motion, Record) else str(motion)
    lines = [title, strength, str(response)]
    ratios = np.asarray(nearby.peak_rotation / block.critical_angle)[~nearby.overturned]
    peaks = f"overturns at {41 - ratios.size} of 41"
    if ratios.size:
        peaks = f"{ratios.min():.2g} to {ratios.max():.2g} of the critical angle, {peaks}"
    lines.append(f"peaks for factors of 0.9 to 1.1 on the motion: {peaks}")
    lifts = f"the motion multiplied by {uplift:.4g} just lifts the block"
    lines.append(lifts if np.isfinite(uplift) else "no factor on the motion lifts the block")
    return Answer("\n".join(lines), data, output, files.paths)


def critical(
    *,
    intensity: float | None = None,
    half_cycles: tuple[float, ...] | None = None,
    along: str | None = None,
    values: Grid | None = None,
    model: ModelName | None = None,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Find the limits at which a block overturns: in resonance, under one pulse or a record.

    Without a pulse or a record, the command computes, in closed form and by both equations,
    the critical intensities of pulses right after each impact, and the sizes and the
    restitution with which the given intensity just overturns the block. With a pulse or a
    record, it finds the amplitude or factor that just lifts the block, and every boundary
    between standing and overturning along a quantity. With --out it writes critical.csv and
    critical.png.

    Example: jaxrock critical --width 0.2 --height 1 --pulse sine --pulse-duration 0.5

    Parameters
    ----------
    intensity
        Change of ground velocity in each instantaneous pulse [m/s]. 0.15 if not given.
    half_cycles
        Numbers of half-cycles within which instantaneous pulses just overturn the block. 1, 2,
        5 and inf if not given.
    along
        Quantity whose boundaries are sought: amplitude or duration of a pulse, factor, width,
        height, half_width, slenderness, inertia_ratio or restitution. By default the amplitude
        of a pulse, or the factor on a record.
    values
        Values to examine. If not given, factors from 1 to 50 times the one that just lifts the
        block, or amplitudes from 1 to 10 times the one that just lifts it, and from 10 to 100
        times if there is no boundary among these.
    model
        Equation of motion under a pulse or a record; nonlinear if not given.
    """
    if motion_options.given:
        refuse("with a pulse or a record", intensity=intensity, half_cycles=half_cycles)
        title, found, lines, data, picture = _find_boundaries(
            block_options, motion_options, along, values, model or "nonlinear"
        )
    else:
        motion_options.refuse("without --pulse or --record")
        refuse("without --pulse or --record", along=along, values=values, model=model)
        scene, title = (block_options.block, block_options.coefficient), block_options.text
        pulse = 0.15 if intensity is None else intensity
        found = resonance.critical_values(
            *scene, pulse, half_cycles or (1.0, 2.0, 5.0, math.inf)
        )
        lines, data = [found], {}
        picture = ("plot_critical_intensity", (*scene, pulse), {})
    paths: Sequence[Path] = ()
    if output.out is not None:
        from .. import plot

        with output.write("critical", "critical.csv", "critical.png", dataset=False) as files:
            files.write_csv("critical.csv", found.table(), scene=title)
            drawn = getattr(plot, picture[0])(*picture[1], **picture[2])
            files.save_picture("critical.png", drawn, title if motion_options.given else "")
        paths = files.paths
    data = {"rows": list_rows(found.table()), **data}
    return Answer("\n".join(map(str, lines)), data, output, paths)


def _find_boundaries(
    block_options: BlockOptions,
    options: MotionOptions,
    along: str | None,
    values: Grid | None,
    model: ModelName,
) -> tuple[str, overturning.Boundaries, list[Any], dict[str, Any], tuple[str, Any, Any]]:
    """Find what lifts the block, and the boundaries along a quantity; name their picture."""
    block, c = block_options.block, block_options.coefficient
    title = f"{block_options.text}; {options.text}"
    along = along or ("amplitude" if options.pulse else "factor")
    strength = "amplitude" if along == "amplitude" else "factor"
    replaced = {"amplitude": "amplitude", "duration": "pulse_duration"}.get(along)
    if replaced and options.pulse:
        scale = options.scale if along == "amplitude" else None
        refuse("where it is sought", **{replaced: getattr(options, replaced)}, scale=scale)
        # A pulse needs a value of the quantity sought, which the search replaces: 1 stands in.
        options = replace(options, **{replaced: 1.0})
    motion = options.read()
    known: Any = {"model": model}
    # The motion has 1 m/s2 where the amplitude is sought: this factor is the amplitude then.
    uplift = float(overturning.uplift_factor(block, motion, **known))
    if values is None and along == "amplitude" and options.pulse:
        shape, duration = PULSES[str(options.pulse)], options.pulse_duration or math.nan
        # High amplitudes, of short pulses, if there is no boundary among the lower ones.
        for ratios in ((1.0, 10.0), (10.0, 100.0)):
            limits = (uplift, ratios[1] * uplift)
            found = overturning.critical_amplitude(block, c, shape, duration, ratios, **known)
            if found.count:
                break
    else:
        if values is None and along == "factor":
            if np.isinf(uplift):
                raise ValueError("no factor on the motion lifts the block")
            # Outcomes under a record change so often that windows of 0.25 % are sought.
            examined = uplift * np.geomspace(1, 50, 1568)
        else:
            examined = read_numbers("values", values or ())
        limits = (examined[0], examined[-1])
        found = overturning.overturning_boundaries(block, c, motion, along, examined, **known)
    # A boundary may be hidden among values that were given up: a table with gaps would mislead.
    driven.require_complete(
        found.complete, **{along: f"between {limits[0]:g} and {limits[1]:g}"}
    )
    lifts = f"{strength} {overturning.format_value(strength, uplift)} just lifts the block"
    data = {f"uplift_{strength}": uplift, "along": along, "examined": limits, **known}
    mark = {"uplift": uplift} if strength == along else {}
    lines = [title, lifts, found, f"examined: {along} from {limits[0]:.4g} to {limits[1]:.4g}"]
    return title, found, lines, data, ("plot_boundaries", (found, limits), mark)
