"""The commands of research: spectra, harmonic floors, measured errors, the paper."""

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from .. import spectra
from ..accuracy import measure_tradeoff
from ..block import RECTANGLE_INERTIA_RATIO
from ..grids import compute_overturned_fraction
from ..impact import describe_assumed_restitution, require_free_standing
from ..reports import paper as report_of_paper
from .answers import Answer
from .motion_options import MotionOptions
from .options import BlockOptions, Count, FileOutput, Grid, ModelName, read_axis, refuse


def spectrum(  # noqa: PLR0913
    *,
    slenderness: Grid = ("3:10:141",),
    width: Grid = (0.4, 0.6, 0.8, 1.0, 1.2),
    restitution: Grid | None = None,
    intensity: Grid = (0.15,),
    gravity: float = 9.81,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    model: Literal["linearized", "nonlinear", "auto"] = "linearized",
    output: FileOutput = FileOutput(),
) -> Answer:
    """Compute resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Give the values of the grid one by one,
    or as START:STOP:COUNT.

    Example: jaxrock spectrum --slenderness 3:10:15 --width 0.4 0.8 --restitution 0.7

    Parameters
    ----------
    slenderness
        Height over width [-].
    width
        Full widths 2b of the base [m].
    restitution
        Coefficients of restitution [-], 0 to 1. If not given 0.6, 0.7 and 0.8; against a wall
        0.4, 0.45 and 0.5.
    intensity
        Change of ground velocity in each pulse [m/s].
    gravity
        Acceleration of gravity [m/s2].
    inertia_ratio
        Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle.
    one_sided
        The blocks stand against a wall, and rock away from it only.
    model
        Equation of free rocking; auto takes the cheapest equation within a relative error of
        0.001 at each point.
    """
    default = (0.4, 0.45, 0.5) if one_sided else (0.6, 0.7, 0.8)
    given = {"slenderness": slenderness, "width": width, "restitution": restitution or default}
    axes = [read_axis(name, grid) for name, grid in (given | {"intensity": intensity}).items()]
    with output.write("spectrum") as files:
        from ..plot import plot_spectrum

        # Into the file, part by part: a large grid need not fit into memory.
        with spectra.resonance_spectrum(
            *axes,
            model=model,
            gravity=gravity,
            inertia_ratio=inertia_ratio,
            one_sided=one_sided,
            store=files.folder / "spectrum.nc",
        ) as dataset:
            files.write_dataset(dataset, plot_spectrum(dataset))
            overturned = compute_overturned_fraction(dataset)
            sizes = dict(dataset.sizes)
    text = f"{math.prod(sizes.values())} scenes, {100 * overturned:.1f} % of them overturn"
    assumed = f"\nC = {', '.join(f'{c:g}' for c in default)} (assumed)" * (restitution is None)
    data = {"sizes": sizes, "model": model, "overturned": overturned}
    return Answer(text + assumed, data, output, files.paths)


def rocking_spectrum(
    *,
    free_period: Grid = ("1:4:241", "4.05:8:80"),
    slenderness: Grid = (4.0, 6.0, 8.0),
    restitution: Grid | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    motion_options: MotionOptions = MotionOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Compute the rocking spectrum of a motion: peak rotation over the size of the block.

    Writes rocking_spectrum.nc, .csv and .png.

    Example: jaxrock rocking-spectrum --record example --scale 1.5

    Parameters
    ----------
    free_period
        2 pi / p of the blocks [s].
    slenderness
        Height over width [-].
    restitution
        Velocity after an impact over velocity before it [-], 0 to 1. If not given 0.9;
        against a wall computed from the size.
    inertia_ratio
        Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle.
    one_sided
        The blocks stand against a wall, and rock away from it only.
    """
    motion = motion_options.read()
    given = {"free_period": free_period, "slenderness": slenderness}
    if restitution is not None or not one_sided:
        given["restitution"] = restitution or (0.9,)
    axes: Any = {name: read_axis(name, grid) for name, grid in given.items()}
    axes |= {"inertia_ratio": inertia_ratio, "one_sided": one_sided}
    with output.write("rocking_spectrum") as files:
        from ..plot import plot_rocking_spectrum

        dataset = spectra.rocking_spectrum(motion, **axes)
        dataset = dataset.assign_attrs(motion=motion_options.text)
        files.write_dataset(dataset, plot_rocking_spectrum(dataset))
    overturned = 100 * float(dataset.overturned.mean())
    text = f"{dataset.overturned.size} blocks, {overturned:.1f} % of them overturn"
    if restitution is None:
        text += f"\nC {'from size against a wall' if one_sided else '= 0.9'} (assumed)"
    return Answer(text, {"sizes": dict(dataset.sizes)}, output, files.paths)


def harmonic(
    *,
    frequency_ratio: Grid = ("1:12:45",),
    amplitude_ratio: Grid | None = None,
    model: ModelName = "nonlinear",
    cycles: Count = 100,
    block_options: BlockOptions = BlockOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Map steady rocking on a harmonic floor, over its frequency and amplitude.

    The map shows where the block rocks steadily with one impact in every half period, whether
    this motion is stable, and how high the block rocks. Where it is not stable, the map shows
    the outcome of a launch near it. The files also have the outcome of a start from rest. With
    a width, the results have frequencies in Hz and amplitudes in m/s2. Without a width they are
    ratios, and the map holds for every size of block. Writes harmonic.nc, harmonic.csv and
    harmonic.png.

    Example: jaxrock harmonic --slenderness 5 --restitution 0.9 --frequency-ratio 1:12:45

    Example: jaxrock harmonic --width 0.4 --height 2

    Parameters
    ----------
    frequency_ratio
        Frequency of the floor over p [-].
    amplitude_ratio
        Amplitude of the floor over the amplitude that just lifts the block [-]. If not given,
        60 logarithmically spaced values from 0.05 to 12.
    model
        Equation of motion.
    cycles
        Number of simulated periods of the floor.
    """
    with_size = block_options.width is not None
    if not with_size:
        refuse("without --width", height=block_options.height)
        # Ratios do not depend on the size: 1 m stands in.
        slenderness = block_options.slenderness or 5.0
        block_options = replace(block_options, width=1.0, slenderness=slenderness)
    block = block_options.block
    frequencies = read_axis("frequency_ratio", frequency_ratio)
    amplitudes = np.geomspace(0.05, 12, 60)
    if amplitude_ratio is not None:
        amplitudes = read_axis("amplitude_ratio", amplitude_ratio)
    require_free_standing(block, "a harmonic spectrum")
    with output.write("harmonic") as files:
        from ..plot import plot_harmonic

        body = {n: float(getattr(block, n)) for n in ("slenderness", "inertia_ratio")}
        asked = {"restitution": block_options.restitution, "model": model, "cycles": cycles}
        dataset = spectra.harmonic_spectrum(frequencies, amplitudes, **body, **asked)
        if with_size:
            dataset = spectra.add_size(dataset, block)
        files.write_dataset(dataset, plot_harmonic(dataset))
    assumed = f"\n{describe_assumed_restitution(block)}" * (block_options.restitution is None)
    text = f"{spectra.describe_regions(dataset)}{assumed}"
    return Answer(text, spectra.tabulate_regions(dataset), output, files.paths)


def tradeoff(
    *,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Measure error and time of each equation, solver and precision on this machine.

    The block is under a pulse or a record. Writes tradeoff.nc, tradeoff.csv and tradeoff.png.

    Example: jaxrock tradeoff --width 0.8 --height 4 --record example
    """
    scene = block_options.block, block_options.coefficient, motion_options.read()
    with output.write("tradeoff") as files:
        from ..plot import plot_tradeoff

        dataset = measure_tradeoff(scene)
        files.write_dataset(dataset, plot_tradeoff(dataset))
    rows = dataset.to_dataframe()
    front = rows.query("front == 1 or default == 1")[["batch", "error", "seconds", "label"]]
    return Answer(front.to_string(), {"rows": rows.to_dict("records")}, output, files.paths)


def paper(*, output: FileOutput = FileOutput()) -> Answer:
    """Regenerate the paper's tables and figures and compare them with what it prints.

    Writes report.md, the tables as CSV and the figures as PNG. Exits with 1 if anything
    disagrees that is not a known fault of the paper.

    Example: jaxrock paper --out paper
    """
    with output.write("paper", *report_of_paper.FILES, dataset=False) as files:
        report = report_of_paper.regenerate()
        report_of_paper.write(report, files.folder)
    data = report.summarize()
    # By the exit code a test run can tell that something disagrees.
    return Answer(report, data, output, files.paths, code=1 if data["mismatches"] else 0)
