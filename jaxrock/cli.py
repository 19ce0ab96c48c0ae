"""The command line: ``jaxrock assess``, ``spectrum``, ``respond``, and so on."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
import tyro

_Grid = tuple[str, ...]
_Model = Literal["linearized", "nonlinear"]
_Rung = Literal["linearized", "nonlinear", "auto"]
_Pulse = Literal["rectangular", "half-sine", "sine", "cosine", "ricker"]
_Along = Literal["amplitude", "duration", "factor", "half_width", "slenderness", "restitution"]
_Answer = Literal[
    "rotation-ratio", "rotation", "period", "amplification", "margin", "critical-intensity"
]
_Force = Annotated[bool, tyro.conf.FlagCreatePairsOff]
_Json = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(name="json")]


def assess(
    width: float = 0.8,
    height: float | None = None,
    slenderness: float | None = None,
    restitution: float | None = None,
    intensity: float = 0.15,
    gravity: float = 9.81,
    tolerance: float | None = None,
    as_json: _Json = False,
) -> None:
    """Assess one block under pulses timed to its impacts.

    Geometry, the response to one pulse, the stabilized phase or the half-cycle in which the
    block overturns, critical pulse intensities and sensitivities, by the linearized and the
    nonlinear equation side by side.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7

    Args:
        width: Full width 2b of the base [m].
        height: Full height 2a [m]. Give this or the slenderness.
        slenderness: Height over width [-]. 5 if neither is given.
        restitution: Velocity after an impact over velocity before it [-], 0 to 1.
            Housner's value for the block if not given.
        intensity: Change of ground velocity in each pulse [m/s].
        gravity: Acceleration of gravity [m/s2].
        tolerance: Say which equation and precision are good enough for this relative error.
        as_json: Print JSON; null stands for what does not exist or never happens.
    """
    from . import assessment
    from .arguments import POSITIVE, check
    from .block import Block, housner_restitution
    from .resonance import Scene

    check("width", width, POSITIVE)
    if height is not None and slenderness is not None:
        raise ValueError("height and slenderness exclude each other, got both")
    if height is not None:
        block = Block.from_size(width, height, gravity)
    else:
        block = Block(width / 2, 5.0 if slenderness is None else slenderness, gravity)
    if restitution is None:
        restitution = float(housner_restitution(block))
        if restitution < 0:
            raise ValueError(
                f"restitution must be given for a block this stocky: Housner's is"
                f" {restitution:.3g}, and it must be between 0 and 1"
            )
    result = assessment.assess(Scene(block, restitution, intensity), tolerance)
    print(_dumps(result) if as_json else assessment.text(result))


def spectrum(
    out: Path = Path("spectrum"),
    slenderness: _Grid = ("3:10:141",),
    width: _Grid = ("0.4", "0.6", "0.8", "1.0", "1.2"),
    restitution: _Grid = ("0.6", "0.7", "0.8"),
    intensity: _Grid = ("0.15",),
    gravity: float = 9.81,
    model: _Rung = "linearized",
    tolerance: float = 1e-3,
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Values of the grid are given one by
    one, or as START:STOP:COUNT.

    Example: jaxrock spectrum --slenderness 3:10:15 --width 0.4 0.8 --restitution 0.7

    Args:
        out: Folder to write to; made if it is missing.
        slenderness: Height over width [-].
        width: Full widths 2b of the base [m].
        restitution: Coefficients of restitution [-], 0 to 1.
        intensity: Change of ground velocity in each pulse [m/s].
        gravity: Acceleration of gravity [m/s2].
        model: Equation of free rocking between the impacts; auto takes at each point the
            cheapest that keeps the tolerance.
        tolerance: For auto: relative error that is allowed.
        force: Overwrite existing files.
        as_json: Print the list of files and the size of the grid as JSON.
    """
    from .files import written_whole
    from .free import Linearized, Nonlinear
    from .spectra import overturned_share, resonance_spectrum, write_table

    grid: dict[str, Any] = {
        "slenderness": _values("slenderness", slenderness),
        "width": _values("width", width),
        "restitution": _values("restitution", restitution),
        "intensity": _values("intensity", intensity),
    }
    if len(grid["intensity"]) == 1:
        grid["intensity"] = grid["intensity"][0]
    rungs = {"nonlinear": Nonlinear(), "linearized": Linearized(), "auto": "auto"}
    names = ("spectrum.nc", "spectrum.csv", "spectrum.png")
    with written_whole("out", out, names, force) as scratch:
        store = scratch / names[0]
        with resonance_spectrum(
            **grid, model=rungs[model], tolerance=tolerance, gravity=gravity, store=store
        ) as dataset:
            write_table(dataset, scratch / names[1])
            _plot_spectrum(dataset, scratch / names[2])
            sizes = {str(name): size for name, size in dataset.sizes.items()}
            overturned = overturned_share(dataset)
    written = [str(out / name) for name in names]
    if as_json:
        summary = {"files": written, "sizes": sizes, "model": model, "overturned": overturned}
        print(_dumps(summary))
    else:
        print(f"{math.prod(sizes.values())} scenes, {100 * overturned:.1f} % of them overturn")
        print("\n".join(written))


def respond(
    pulse: _Pulse | None = None,
    amplitude: float | None = None,
    pulse_duration: float | None = None,
    record: str | None = None,
    unit: str | None = None,
    column: str | None = None,
    vertical: str | None = None,
    time_step: float | None = None,
    scale: float = 1.0,
    width: float = 0.8,
    slenderness: float = 5.0,
    restitution: float | None = None,
    gravity: float = 9.81,
    duration: float | None = None,
    linearized: _Force = False,
    out: Path = Path("response"),
    animate: _Force = False,
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Response of one block to a pulse or a record, through every impact.

    Writes response.csv and response.nc (rotation over time), impacts.csv and response.png
    (rotation over time and phase portrait).

    Example: jaxrock respond --pulse sine --amplitude 4 --pulse-duration 0.5

    Args:
        pulse: Shape of the pulse. Give this or a record.
        amplitude: Largest acceleration of the pulse [m/s2].
        pulse_duration: Duration of the pulse [s].
        record: A file .AT2 or .csv, or "example" for the one that comes along.
        unit: Unit of the record.
        column: Column of the horizontal acceleration in a .csv.
        vertical: Column, or file .AT2, of the vertical acceleration.
        time_step: Time between samples of a .csv without times [s].
        scale: Factor on the ground motion.
        width: Full width 2b of the base [m].
        slenderness: Height over width [-].
        restitution: Velocity after an impact over velocity before it [-]. Housner's value
            for the block if not given.
        gravity: Acceleration of gravity [m/s2].
        duration: Time to follow the block for [s]. 10 s beyond the input if not given.
        linearized: Linearize the equation of motion.
        out: Folder to write to; made if it is missing.
        animate: Write response.gif as well.
        force: Overwrite existing files.
        as_json: Print the answers as JSON.
    """
    import numpy as np

    from . import response as driven
    from .block import Block, housner_restitution
    from .files import written_whole

    motion = _motion(pulse, amplitude, pulse_duration, record, unit, column, vertical, time_step)
    motion = motion.scaled(scale)
    block = Block(width / 2, slenderness, gravity)
    c = float(housner_restitution(block)) if restitution is None else restitution
    length = float(motion.end) + 10 if duration is None else duration
    answer = driven.respond(block, c, motion, length, linearized=linearized)
    names = ["response.csv", "impacts.csv", "response.nc", "response.png"]
    with written_whole("out", out, names + ["response.gif"] * animate, force) as scratch:
        times = np.linspace(0, length, 4001)
        dataset = _history(answer, times)
        dataset.to_dataframe().to_csv(scratch / names[0])
        impacts = np.stack([answer.impact_times, answer.impact_velocities], axis=1)
        header = "time_s,velocity_before_rad_per_s"
        np.savetxt(scratch / names[1], impacts, delimiter=",", header=header, comments="")
        dataset.to_netcdf(scratch / names[2])
        _plot_response(answer, scratch / names[3])
        if animate:
            from .plot import animate as write

            write(answer, scratch / "response.gif")
    written = [str(out / name) for name in names + ["response.gif"] * animate]
    if as_json:
        print(_dumps({**dataset.attrs, "files": written}))
    else:
        print(answer)
        print("\n".join(written))


def rocking_spectrum(
    record: str = "example",
    unit: str | None = None,
    column: str | None = None,
    vertical: str | None = None,
    time_step: float | None = None,
    scale: float = 1.0,
    period: _Grid = ("1:8:71",),
    slenderness: _Grid = ("4", "6", "8"),
    restitution: _Grid = ("0.9",),
    out: Path = Path("rocking_spectrum"),
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Rocking spectrum of a record: peak rotation over the size of the block.

    Writes rocking_spectrum.nc, .csv and .png.

    Example: jaxrock rocking-spectrum --record example --scale 1.5

    Args:
        record: A file .AT2 or .csv, or "example" for the one that comes along.
        unit: Unit of the record.
        column: Column of the horizontal acceleration in a .csv.
        vertical: Column, or file .AT2, of the vertical acceleration.
        time_step: Time between samples of a .csv without times [s].
        scale: Factor on the ground motion.
        period: 2 pi / p of the blocks [s].
        slenderness: Height over width [-].
        restitution: Velocity after an impact over velocity before it [-].
        out: Folder to write to; made if it is missing.
        force: Overwrite existing files.
        as_json: Print the list of files and the size of the grid as JSON.
    """
    from .files import written_whole
    from .spectra_driven import rocking_spectrum as computed

    motion = _motion(None, None, None, record, unit, column, vertical, time_step).scaled(scale)
    dataset = computed(
        motion,
        _values("period", period),
        _values("slenderness", slenderness),
        _values("restitution", restitution),
    )
    names = [f"rocking_spectrum.{kind}" for kind in ("nc", "csv", "png")]
    with written_whole("out", out, names, force) as scratch:
        dataset.to_netcdf(scratch / names[0])
        dataset.to_dataframe().to_csv(scratch / names[1])
        _plot_rocking(dataset, scratch / names[2])
    written = [str(out / name) for name in names]
    if as_json:
        sizes = {str(name): size for name, size in dataset.sizes.items()}
        print(_dumps({"files": written, "sizes": sizes}))
    else:
        share = float(dataset.overturned.mean())
        print(f"{dataset.overturned.size} blocks, {100 * share:.1f} % of them overturn")
        print("\n".join(written))


def critical(
    width: float = 0.8,
    slenderness: float = 5.0,
    restitution: float | None = None,
    intensity: float = 0.15,
    half_cycles: tuple[float, ...] = (1.0, 2.0, 5.0, math.inf),
    gravity: float = 9.81,
    pulse: _Pulse | None = None,
    amplitude: float = 1.0,
    pulse_duration: float | None = None,
    record: str | None = None,
    unit: str | None = None,
    column: str | None = None,
    vertical: str | None = None,
    time_step: float | None = None,
    along: _Along | None = None,
    tried: _Grid | None = None,
    linearized: _Force = False,
    out: Path | None = None,
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """What just overturns a block: pulses timed to its impacts, a pulse that lasts, a record.

    Without a pulse or a record: critical intensities in closed form, by both equations, and
    the width, slenderness and restitution with which the given intensity just overturns.
    With one: every boundary between standing and overturning along a quantity.

    Example: jaxrock critical --width 0.2 --pulse sine --pulse-duration 0.5

    Args:
        width: Full width 2b of the base [m].
        slenderness: Height over width [-].
        restitution: Velocity after an impact over velocity before it [-]. Housner's value
            for the block if not given.
        intensity: Change of ground velocity in each instantaneous pulse [m/s].
        half_cycles: In how many half-cycles instantaneous pulses are to overturn the block.
        gravity: Acceleration of gravity [m/s2].
        pulse: Shape of a pulse that lasts.
        amplitude: Largest acceleration of the pulse [m/s2], if not sought.
        pulse_duration: Duration of the pulse [s]. Not needed if sought.
        record: A file .AT2 or .csv, or "example" for the one that comes along.
        unit: Unit of the record.
        column: Column of the horizontal acceleration in a .csv.
        vertical: Column, or file .AT2, of the vertical acceleration.
        time_step: Time between samples of a .csv without times [s].
        along: What to seek: the amplitude of a pulse and the factor on a record if not given.
        tried: Values to try, one by one or START:STOP:COUNT. For the amplitude 1 to 10 times
            what just lifts the block if not given, for the factor 0.05:5:397.
        linearized: Linearize the equation of motion under a pulse or a record.
        out: Folder for critical.csv; none is written if not given.
        force: Overwrite existing files.
        as_json: Print JSON; null stands for what does not exist.
    """
    import numpy as np

    from .block import Block, housner_restitution
    from .boundaries import overturning_boundaries
    from .critical_driven import critical_amplitude
    from .files import written_whole
    from .motion import Pulse

    block = Block(width / 2, slenderness, gravity)
    c = float(housner_restitution(block)) if restitution is None else restitution
    if pulse is None and record is None:
        if along is not None or tried is not None or linearized:
            raise ValueError("along, tried and linearized go with a pulse or a record")
        rows, text = _closed_form(block, c, intensity, half_cycles)
        names = list(rows[0]) if rows else []
    else:
        sought = along or ("amplitude" if pulse else "factor")
        length = 1.0 if sought == "duration" and pulse_duration is None else pulse_duration
        motion = _motion(pulse, amplitude, length, record, unit, column, vertical, time_step)
        if sought == "amplitude" and tried is None and isinstance(motion, Pulse):
            found = critical_amplitude(
                block, c, type(motion), motion.duration, linearized=linearized
            )
        elif tried is None and sought != "factor":
            raise ValueError(f"tried must be given along {sought}")
        else:
            values = _values("tried", tried or ("0.05:5:397",))
            found = overturning_boundaries(
                block, c, motion, sought, np.asarray(values), linearized=linearized
            )
        if not bool(found.complete):
            raise ValueError("motion could not be followed to its end for every value tried")
        text = str(found)
        names = [sought, "overturns_beyond", "impacts", "flat"]
        columns = (found.value, found.overturns_beyond, found.impacts, found.flat)
        table = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
        rows = [dict(zip(names, row, strict=True)) for row in table]
    written = []
    if out is not None:
        with written_whole("out", out, ["critical.csv"], force) as scratch:
            _write_rows(rows, scratch / "critical.csv", names)
        written = [str(out / "critical.csv")]
    if as_json:
        print(_dumps({"rows": rows, "files": written}))
    else:
        print("\n".join([text, *written]))


def sensitivity(
    answer: _Answer = "rotation-ratio",
    width: float = 0.8,
    slenderness: float = 5.0,
    restitution: float = 0.7,
    intensity: float = 0.15,
    gravity: float = 9.81,
    model: _Model = "linearized",
    pulse: _Pulse | None = None,
    amplitude: float | None = None,
    pulse_duration: float | None = None,
    record: str | None = None,
    unit: str | None = None,
    column: str | None = None,
    vertical: str | None = None,
    time_step: float | None = None,
    scale: float = 1.0,
    swing: float = 0.1,
    variation: float = 0.05,
    out: Path = Path("sensitivity"),
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """What an answer depends on: slopes, elasticities, a tornado, the effect of scatter.

    Of the resonance under instantaneous pulses, or with a pulse or a record of the peak
    rotation over the critical angle or the margin at the end of the input. Writes
    sensitivity.csv and tornado.png, and without a pulse or record map.png: the elasticity to
    the restitution over slenderness and restitution.

    Example: jaxrock sensitivity --answer rotation-ratio --swing 0.1

    Args:
        answer: What is asked for.
        width: Full width 2b of the base [m].
        slenderness: Height over width [-].
        restitution: Velocity after an impact over velocity before it [-].
        intensity: Change of ground velocity in each instantaneous pulse [m/s].
        gravity: Acceleration of gravity [m/s2].
        model: Equation of motion.
        pulse: Shape of a pulse that lasts.
        amplitude: Largest acceleration of the pulse [m/s2].
        pulse_duration: Duration of the pulse [s].
        record: A file .AT2 or .csv, or "example" for the one that comes along.
        unit: Unit of the record.
        column: Column of the horizontal acceleration in a .csv.
        vertical: Column, or file .AT2, of the vertical acceleration.
        time_step: Time between samples of a .csv without times [s].
        scale: Factor on the record.
        swing: Part of itself by which each number is lowered and raised in the tornado.
        variation: Coefficient of variation of each number.
        out: Folder to write to; made if it is missing.
        force: Overwrite existing files.
        as_json: Print the answers as JSON.
    """
    from .arguments import POSITIVE, check
    from .files import written_whole
    from .sensitivity import propagate, sensitivities, tornado

    check("swing", swing, POSITIVE)
    check("variation", variation, POSITIVE)
    at: dict[str, Any] = {
        "half_width": width / 2,
        "slenderness": slenderness,
        "restitution": restitution,
    }
    closed = pulse is None and record is None
    if closed:
        at["intensity"] = intensity
        asked = _closed_form_answer(answer, gravity, model)
    else:
        motion = _motion(
            pulse, amplitude, pulse_duration, record, unit, column, vertical, time_step
        )
        if pulse is not None:
            at |= {"amplitude": amplitude, "pulse_duration": pulse_duration}
        else:
            at["scale"] = scale
        asked = _driven_answer(answer, gravity, model, motion)
    slopes = sensitivities(asked, at)
    if not math.isfinite(slopes.value):
        raise ValueError(f"answer {answer} does not exist here: the block overturns")
    ranges = {name: (value * (1 - swing), value * (1 + swing)) for name, value in at.items()}
    ranges["restitution"] = (ranges["restitution"][0], min(ranges["restitution"][1], 1.0))
    swings = tornado(asked, at, ranges)
    scatter = propagate(asked, at, dict.fromkeys(at, variation))
    order = [swings.names.index(name) for name in slopes.names]
    rows = [
        {
            "quantity": name,
            "value": float(slopes.at[k]),
            "slope": float(slopes.gradient[k]),
            "elasticity": float(slopes.elasticity[k]),
            "low": float(swings.low[order[k]]),
            "high": float(swings.high[order[k]]),
            "at_low": float(swings.at_low[order[k]]),
            "at_high": float(swings.at_high[order[k]]),
            "share_of_variance": scatter.shares[name],
        }
        for k, name in enumerate(slopes.names)
    ]
    names = ["sensitivity.csv", "tornado.png"] + ["map.png"] * closed
    with written_whole("out", out, names, force) as scratch:
        _write_rows(rows, scratch / names[0], list(rows[0]))
        _plot_sensitivity(swings, answer, scratch / names[1])
        if closed:
            _plot_map(asked, at, answer, scratch / names[2])
    written = [str(out / name) for name in names]
    if as_json:
        summary = {
            "answer": answer,
            "value": slopes.value,
            "mean": scatter.mean,
            "standard_deviation": scatter.deviation,
            "scatter_holds": scatter.holds,
            "rows": rows,
            "files": written,
        }
        print(_dumps(summary))
    else:
        print(f"{answer} {slopes}")
        print(
            f"with {100 * variation:g} % of scatter in each: {scatter.mean:.6g}"
            f" +- {scatter.deviation:.3g}"
            + ("" if scatter.holds else ", NOT to be trusted: the answer bends too much")
        )
        print("\n".join(written))


def tradeoff(
    width: float = 0.8,
    slenderness: float = 5.0,
    restitution: float = 0.7,
    intensity: float | None = None,
    gravity: float = 9.81,
    pulse: _Pulse | None = None,
    amplitude: float | None = None,
    pulse_duration: float | None = None,
    record: str | None = None,
    unit: str | None = None,
    column: str | None = None,
    vertical: str | None = None,
    time_step: float | None = None,
    scale: float = 1.0,
    repeats: int = 15,
    out: Path = Path("tradeoff"),
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Speed against accuracy on this machine: every dial turned, errors and times measured.

    Of a block under a pulse or a record, with --intensity under the pulses of resonance, by
    default under a short half-sine pulse. Writes tradeoff.nc, tradeoff.csv and tradeoff.png.

    Example: jaxrock tradeoff --record example

    Args:
        width: Full width 2b of the base [m].
        slenderness: Height over width [-].
        restitution: Velocity after an impact over velocity before it [-].
        intensity: Change of ground velocity in each instantaneous pulse [m/s].
        gravity: Acceleration of gravity [m/s2].
        pulse: Shape of a pulse that lasts.
        amplitude: Largest acceleration of the pulse [m/s2].
        pulse_duration: Duration of the pulse [s].
        record: A file .AT2 or .csv, or "example" for the one that comes along.
        unit: Unit of the record.
        column: Column of the horizontal acceleration in a .csv.
        vertical: Column, or file .AT2, of the vertical acceleration.
        time_step: Time between samples of a .csv without times [s].
        scale: Factor on the record.
        repeats: How many times each setting is timed.
        out: Folder to write to; made if it is missing.
        force: Overwrite existing files.
        as_json: Print the table as JSON.
    """
    from .block import Block
    from .fidelity import DrivenScene
    from .files import written_whole
    from .resonance import Scene
    from .tradeoff import default_scene, measure_tradeoff

    block = Block(width / 2, slenderness, gravity)
    if intensity is not None:
        if pulse or record:
            raise ValueError("intensity excludes a pulse or a record")
        measured: Any = Scene(block, restitution, intensity)
    elif pulse or record:
        motion = _motion(
            pulse, amplitude, pulse_duration, record, unit, column, vertical, time_step
        )
        measured = DrivenScene(block, restitution, motion.scaled(scale))
    else:
        measured = DrivenScene(block, restitution, default_scene().motion)
    names = [f"tradeoff.{kind}" for kind in ("nc", "csv", "png")]
    with written_whole("out", out, names, force) as scratch:
        found = measure_tradeoff(measured, repeats=repeats)
        found.dataset.to_netcdf(scratch / names[0])
        found.dataset.to_dataframe().to_csv(scratch / names[1], index=False)
        _plot_tradeoff(found, scratch / names[2])
    written = [str(out / name) for name in names]
    if as_json:
        rows = found.dataset.to_dataframe().to_dict("records")
        summary = {"rows": rows, "sentence": found.sentence(), "notes": found.notes()}
        print(_dumps({**summary, "files": written}))
    else:
        print("\n".join([str(found), *written]))


def paper(
    out: Path = Path("paper"),
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Regenerate the paper's tables and figures and compare them with what it prints.

    Writes report.md, the tables as CSV and Figs. 3 to 8 as PNG. Exits with 1 if anything
    disagrees that is not a known fault of the paper.

    Args:
        out: Folder to write to; made if it is missing.
        force: Overwrite existing files.
        as_json: Print the outcome as JSON.
    """
    from . import paper as regenerated
    from .files import written_whole

    with written_whole("out", out, regenerated.FILES, force) as scratch:
        report = regenerated.regenerate()
        regenerated.write(report, scratch)
    agreeing = sum(entry.agrees for entry in report.entries)
    if as_json:
        outcome = {
            "printed": len(report.entries),
            "agreeing": agreeing,
            "known_faults_in_tables": sum(bool(entry.fault) for entry in report.entries),
            "claims_that_hold": sum(claim.holds for claim in report.claims),
            "claims": len(report.claims),
            "faults_reproduced": sum(fault.holds for fault in report.faults),
            "faults": len(report.faults),
            "mismatches": report.mismatches,
            "files": [str(out / name) for name in regenerated.FILES],
        }
        print(_dumps(outcome))
    else:
        print(regenerated.summary(report))
        for line in report.mismatches:
            print(f"mismatch: {line}")
        print(out / "report.md")
    if report.mismatches:
        raise SystemExit(1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; an argument that is not allowed ends it with exit code 2."""
    jax.config.update("jax_enable_x64", True)
    try:
        tyro.extras.subcommand_cli_from_dict(
            {
                "assess": assess,
                "spectrum": spectrum,
                "respond": respond,
                "rocking-spectrum": rocking_spectrum,
                "critical": critical,
                "sensitivity": sensitivity,
                "tradeoff": tradeoff,
                "paper": paper,
            },
            prog="jaxrock",
            description="Rocking of rigid blocks: will it rock, how far, and what overturns it.",
            args=arguments,
        )
    except ValueError as error:
        print(f"jaxrock: error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def _values(name: str, given: _Grid) -> list[float]:
    import numpy as np

    values: list[float] = []
    for word in given:
        parts = word.split(":")
        try:
            if len(parts) == 3 and int(parts[2]) > 0:
                start, stop = float(parts[0]), float(parts[1])
                if not math.isfinite(start) or not math.isfinite(stop):
                    raise ValueError
                values += np.linspace(start, stop, int(parts[2])).tolist()
            elif len(parts) == 1:
                values.append(float(word))
            else:
                raise ValueError
        except ValueError:
            raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {word!r}") from None
    return values


def _motion(
    pulse: str | None,
    amplitude: float | None,
    pulse_duration: float | None,
    record: str | None,
    unit: str | None,
    column: str | None,
    vertical: str | None,
    time_step: float | None,
) -> Any:
    from . import motion as shapes
    from .records import example_record, read_record

    if (pulse is None) == (record is None):
        raise ValueError("pulse or record must be given, one of the two")
    if record == "example":
        if unit or time_step or vertical not in (None, "up"):
            raise ValueError(
                'the record "example" has its unit and time step; its column may be "north" or'
                ' "east", and vertical "up"'
            )
        return example_record(column or "north", vertical=vertical is not None)
    if record is not None:
        return read_record(record, unit=unit, column=column, vertical=vertical, time_step=time_step)
    if amplitude is None or pulse_duration is None:
        raise ValueError("amplitude and pulse_duration must be given with a pulse")
    of = {
        "rectangular": shapes.Rectangular,
        "half-sine": shapes.HalfSine,
        "sine": shapes.Sine,
        "cosine": shapes.Cosine,
        "ricker": shapes.Ricker,
    }
    return of[str(pulse)](amplitude, pulse_duration)


def _closed_form(
    block: Any, restitution: float, intensity: float, half_cycles: Sequence[float]
) -> tuple[list[dict[str, Any]], str]:
    from . import critical as inverse
    from .free import Linearized, Nonlinear
    from .resonance import Scene

    scene = Scene(block, restitution, intensity)
    rows = []
    for number in half_cycles:
        for model in (Linearized(), Nonlinear()):
            row: dict[str, Any] = {
                "half_cycles": number,
                "equation": type(model).__name__.lower(),
                "critical_intensity": inverse.critical_intensity(block, restitution, number, model),
                "critical_width": inverse.critical_width(scene, number, model),
                "critical_slenderness": inverse.critical_slenderness(scene, number, model),
                "critical_restitution": inverse.critical_restitution(scene, number, model),
            }
            rows.append({k: v if isinstance(v, str) else float(v) for k, v in row.items()})
    lines = [
        f"restitution {restitution:.6g}; width, slenderness and restitution are those that"
        f" {intensity:g} m/s just overturn",
        "half-cycles  equation     intensity [m/s]  width [m]  slenderness  restitution",
    ]
    for row in rows:
        number, equation, *values = row.values()
        lines.append(
            f"{number:<11g}  {equation:<11}  {values[0]:<15.6g}  {values[1]:<9.5g}"
            f"  {values[2]:<11.5g}  {values[3]:.6g}"
        )
    return rows, "\n".join(lines)


def _closed_form_answer(answer: str, gravity: float, model: str) -> Any:
    from . import critical as inverse
    from . import resonance
    from .block import Block
    from .free import Linearized, Nonlinear

    rung = Nonlinear() if model == "nonlinear" else Linearized()
    of_scene = {
        "rotation-ratio": resonance.rotation_ratio,
        "rotation": resonance.stabilized_rotation,
        "period": resonance.stabilized_period,
        "amplification": resonance.amplification,
        "margin": resonance.overturning_margin,
    }

    def asked(at: Any) -> Any:
        block = Block(at["half_width"], at["slenderness"], gravity)
        if answer == "critical-intensity":
            return inverse.critical_intensity(block, at["restitution"], math.inf, rung)
        scene = resonance.Scene(block, at["restitution"], at["intensity"])
        return of_scene[answer](scene, rung)

    return asked


def _driven_answer(answer: str, gravity: float, model: str, motion: Any) -> Any:
    from .block import Block
    from .response import respond

    if answer not in ("rotation-ratio", "rotation", "margin"):
        raise ValueError(
            "answer must be rotation-ratio, rotation or margin under a pulse or a record,"
            f" got {answer}"
        )

    def asked(at: Any) -> Any:
        block = Block(at["half_width"], at["slenderness"], gravity)
        if "scale" in at:
            shaking = motion.scaled(at["scale"])
        else:
            shaking = type(motion)(at["amplitude"], at["pulse_duration"])
        rests = shaking.end + (0.0 if answer == "margin" else 10.0)
        response = respond(
            block, at["restitution"], shaking, rests, linearized=model == "linearized"
        )
        peak = response.peak_rotation
        if answer == "margin":
            return response.margin
        return peak / block.critical_angle if answer == "rotation-ratio" else peak

    return asked


def _write_rows(rows: list[dict[str, Any]], path: Path, names: Sequence[str]) -> None:
    import csv

    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=names)
        writer.writeheader()
        writer.writerows(rows)


def _plot_sensitivity(swings: Any, answer: str, path: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from .plot_design import plot_tornado

    figure, ax = plt.subplots(layout="constrained")
    plot_tornado(swings, ax, label=answer.replace("-", " "))
    figure.savefig(path, dpi=150)


def _plot_map(asked: Any, at: dict[str, Any], answer: str, path: Path) -> None:
    import jax.numpy as jnp
    import matplotlib
    import numpy as np
    import xarray

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from .plot_design import plot_sensitivity_map

    axes = {"restitution": np.linspace(0.3, 0.95, 66), "slenderness": np.linspace(3, 10, 71)}

    def elasticity(restitution: Any, slenderness: Any) -> Any:
        def of(c: Any) -> Any:
            return asked(at | {"restitution": c, "slenderness": slenderness})

        value, slope = jax.value_and_grad(of)(restitution)
        return jnp.where(jnp.isfinite(value), slope * restitution / value, jnp.nan)

    table = jax.vmap(jax.vmap(elasticity, (None, 0)), (0, None))
    values = jax.jit(table)(*(jnp.asarray(axis) for axis in axes.values()))
    name = f"elasticity of {answer.replace('-', ' ')} to the restitution"
    array = xarray.DataArray(np.asarray(values), axes, tuple(axes), attrs={"long_name": name})
    figure, ax = plt.subplots(layout="constrained")
    plot_sensitivity_map(array, ax)
    figure.savefig(path, dpi=150)


def _history(answer: Any, times: Any) -> Any:
    import xarray

    from .response import Status

    rotation, velocity = answer.history(times)
    ratio = rotation / answer.scene.block.critical_angle
    scalars = {
        "status": Status(int(answer.status)).name.lower(),
        "overturned": int(answer.overturned),
        "impacts": int(answer.impacts),
        "at_rest": int(answer.at_rest),
    }
    for name in (
        "peak_rotation",
        "peak_time",
        "overturning_time",
        "margin",
        "final_rotation",
        "final_velocity",
        "friction_demand",
        "normal_force",
    ):
        scalars[name] = float(getattr(answer, name))
    return xarray.Dataset(
        {
            "rotation": ("time", rotation, {"long_name": "rotation", "units": "rad"}),
            "velocity": ("time", velocity, {"long_name": "angular velocity", "units": "rad s-1"}),
            "rotation_ratio": (
                "time",
                ratio,
                {"long_name": "rotation over critical angle", "units": "1"},
            ),
        },
        {"time": ("time", times, {"long_name": "time", "units": "s"})},
        scalars,
    )


def _plot_response(answer: Any, path: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from .plot import plot_phase, plot_response

    figure, panels = plt.subplots(
        1, 2, figsize=(11, 4), layout="constrained", width_ratios=(1.6, 1)
    )
    plot_response(answer, panels[0])
    plot_phase(answer, panels[1])
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _plot_rocking(dataset: Any, path: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    from .plot import plot_rocking_spectrum

    plot_rocking_spectrum(dataset).savefig(path, dpi=150)


def _plot_tradeoff(found: Any, path: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from .plot_design import plot_tradeoff

    figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
    plot_tradeoff(found.dataset, ax)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _plot_spectrum(dataset: Any, path: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    from .plot import plot_spectrum

    plot_spectrum(dataset).savefig(path, dpi=150)


def _dumps(value: Any) -> str:
    def plain(item: Any) -> Any:
        if isinstance(item, dict):
            return {key: plain(inner) for key, inner in item.items()}
        if isinstance(item, list):
            return [plain(inner) for inner in item]
        return None if isinstance(item, float) and not math.isfinite(item) else item

    return json.dumps(plain(value), indent=2, allow_nan=False)
