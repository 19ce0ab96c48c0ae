"""The commands that compute spectra of many blocks."""

import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..block import RECTANGLE_INERTIA_RATIO
from ..grids import compute_overturned_fraction, write_table
from ..host import write_whole
from ..spectra import resonance_spectrum
from ..spectra import rocking_spectrum as compute_rocking_spectrum
from .answers import Answer, describe_options, save_picture
from .motion_options import RecordOptions
from .options import (
    FileOutput,
    Folder,
    Grid,
    StoreOptions,
    read_axis,
    refuse,
    warn_of_intensity,
)
from .stores import write_store

if TYPE_CHECKING:
    import xarray

_FILES = ("spectrum.nc", "spectrum.csv", "spectrum.png")
_ROCKING_FILES = ("rocking_spectrum.nc", "rocking_spectrum.csv", "rocking_spectrum.png")


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
    tolerance: float | None = None,
    out: Folder | None = None,
    output: FileOutput = FileOutput(),
    store_options: StoreOptions = StoreOptions(),
) -> Answer:
    """Compute resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Give the values of the grid one by one,
    or as START:STOP:COUNT. For many million points use --store: several processes compute the
    points, and the same command continues an unfinished store.

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
        Equation of free rocking; auto takes the cheapest equation within the tolerance at
        each point.
    tolerance
        Allowed relative error, for the model auto. 1e-3 if not given.
    out
        Folder to write to; made if it is missing. "spectrum" if not given.
    """
    assumption = ""
    if restitution is None:
        restitution = (0.4, 0.45, 0.5) if one_sided else (0.6, 0.7, 0.8)
        assumption = f"\nC = {', '.join(f'{c:g}' for c in restitution)} (assumed)"
    about = describe_options("spectrum", locals())
    if model != "auto":
        refuse("--model auto", tolerance=tolerance)
    relative_error = 1e-3 if tolerance is None else tolerance
    intensities = read_axis("intensity", intensity)
    warn_of_intensity(float(intensities.max()))
    compute = functools.partial(
        resonance_spectrum,
        read_axis("slenderness", slenderness),
        read_axis("width", width),
        read_axis("restitution", restitution),
        intensities,
        model=model,
        tolerance=relative_error,
        gravity=gravity,
        inertia_ratio=inertia_ratio,
        one_sided=one_sided,
    )

    def answer(
        dataset: "xarray.Dataset", overturned: float, files: Sequence[Path] = ()
    ) -> Answer:
        """Say how many scenes there are, and which fraction of them overturns."""
        count = math.prod(dataset.sizes.values())
        text = f"{count} scenes, {100 * overturned:.1f} % of them overturn{assumption}"
        data = {"sizes": dict(dataset.sizes), "model": model, "overturned": overturned}
        return Answer(text, data, output, files)

    if store_options.wants_store(out, output.force):
        return write_store(
            compute(chunks="auto").assign_attrs(about),
            store_options,
            lambda dataset: answer(dataset, float((dataset.overturning_margin <= 0).mean())),
        )
    target = out or Path("spectrum")
    files = [target / name for name in _FILES]
    with write_whole("out", target, _FILES, output.force) as folder:
        from ..plot import plot_spectrum

        # Into the file, part by part: a large grid need not fit into memory.
        with compute(store=folder / "spectrum.nc") as dataset:
            write_table(dataset, folder / "spectrum.csv")
            save_picture(plot_spectrum(dataset), folder / "spectrum.png")
            return answer(dataset, compute_overturned_fraction(dataset), files)


def rocking_spectrum(  # noqa: PLR0913
    *,
    free_period: Grid = ("1:4:241", "4.05:8:80"),
    slenderness: Grid = (4.0, 6.0, 8.0),
    restitution: Grid | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    record_options: RecordOptions = RecordOptions(),
    out: Folder | None = None,
    output: FileOutput = FileOutput(),
    store_options: StoreOptions = StoreOptions(),
) -> Answer:
    """Compute the rocking spectrum of a record: peak rotation over the size of the block.

    Without --record it uses the example record. Writes rocking_spectrum.nc, .csv and .png.

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
    out
        Folder to write to; made if it is missing. "rocking_spectrum" if not given.
    """
    assumption = ""
    if restitution is None:
        restitution = None if one_sided else (0.9,)
        assumption = f"\nC {'from size against a wall' if one_sided else '= 0.9'} (assumed)"
    about = describe_options("rocking-spectrum", locals())
    compute = functools.partial(
        compute_rocking_spectrum,
        record_options.read(),
        read_axis("free_period", free_period),
        read_axis("slenderness", slenderness),
        None if restitution is None else read_axis("restitution", restitution),
        inertia_ratio=inertia_ratio,
        one_sided=one_sided,
    )

    def answer(dataset: "xarray.Dataset", files: Sequence[Path] = ()) -> Answer:
        """Say how many blocks there are, and which fraction of them overturns."""
        overturned = 100 * float(dataset.overturned.mean())
        blocks = f"{dataset.overturned.size} blocks, {overturned:.1f} % of them overturn"
        text = f"{blocks}{assumption}"
        return Answer(text, {"sizes": dict(dataset.sizes)}, output, files)

    if store_options.wants_store(out, output.force):
        return write_store(compute(chunks="auto").assign_attrs(about), store_options, answer)
    target = out or Path("rocking_spectrum")
    files = [target / name for name in _ROCKING_FILES]
    with write_whole("out", target, _ROCKING_FILES, output.force) as folder:
        from ..plot import plot_rocking_spectrum

        dataset = compute().assign_attrs(about)
        dataset.to_netcdf(folder / "rocking_spectrum.nc")
        write_table(dataset, folder / "rocking_spectrum.csv")
        save_picture(plot_rocking_spectrum(dataset), folder / "rocking_spectrum.png")
        return answer(dataset, files)
