"""The command that fits measured impact times."""

import math
from pathlib import Path

import numpy as np

from ..calibration import FreeRockingFit, fit_free_rocking, read_impact_times
from ..host import write_whole
from ..tables import write_csv
from ..validation import POSITIVE, check
from .answers import Answer, describe_options, list_rows, save_picture
from .options import FileOutput, Folder, ModelName, SizeOptions, refuse
from .wrong_calls import naming_arguments

_FILES = ("fit.csv", "fit.png")
_UNITS = {
    **dict.fromkeys(("time", "residual"), "s"),
    **dict.fromkeys(("velocity_ratio", "restitution", "restitution_error"), "-"),
    **dict.fromkeys(("peak_rotation", "rotation_residual"), "rad"),
}
# What a remark of the library advises, and the option for it.
_ADVICE = ("frequency_known=False", "--frequency-unknown")
_SUMMARY = (
    *("time_noise", "rotation_noise", "restitution_change", "restitution_change_error"),
    *("restitution_change_p_value", "frequency_p_value", "degrees_of_freedom"),
)


def fit(  # noqa: PLR0913
    file: Path,
    *,
    frequency_unknown: bool = False,
    model: ModelName | None = None,
    time_noise: float | None = None,
    rotation_noise: float | None = None,
    no_repair: bool = False,
    size_options: SizeOptions = SizeOptions(),
    out: Folder = Path("fit"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Fit restitution, and if need be frequency parameter p, to impact times of a block.

    In a test the block is tilted and let go; a microphone or an accelerometer beside it hears
    the impacts. The file has a line for each impact below the names of its columns: time [s],
    or [ms], and optionally peak rotation [rad], or [deg], the largest one before the next
    impact. Without a width the block is unknown, and p is fitted too. Writes fit.csv, with a
    line for each time, and fit.png.

    Example: jaxrock fit times.csv

    Example: jaxrock fit times.csv --width 0.2 --height 1

    Parameters
    ----------
    file
        The file with the times of the impacts.
    frequency_unknown
        Fit p although the block is given; only its shape is used.
    model
        Equation of motion. By default nonlinear with a block; always linearized without one.
    time_noise
        Standard deviation of a measured time [s]; by default estimated from the residuals.
    rotation_noise
        Standard deviation of a measured rotation [rad]; by default estimated from the
        residuals.
    no_repair
        Do not search for missing impacts and wrong times.
    out
        Folder to write to; made if it is missing.
    """
    about = describe_options("fit", locals())
    block = None
    if size_options.width is not None:
        block = size_options.make_block(size_options.width)
    else:
        unknown = {"frequency_unknown": frequency_unknown or None, "model": model}
        refuse("--width", **vars(size_options), **unknown)
    for name, noise in (("time_noise", time_noise), ("rotation_noise", rotation_noise)):
        if noise is not None:
            check(name, noise, POSITIVE)
    times, peaks = read_impact_times(file)
    # Only the file says whether there are peaks, so it has to be read first.
    if peaks is None:
        refuse("peak rotations in the file", rotation_noise=rotation_noise)
    with write_whole("out", out, _FILES, output.force) as folder:
        from ..plot import plot_free_rocking_fit

        with naming_arguments(
            impact_times=f"times in {str(file)!r}", peak_rotations=f"peaks in {str(file)!r}"
        ):
            fitted = fit_free_rocking(
                times,
                block,
                peak_rotations=peaks,
                model=model,
                frequency_known=not frequency_unknown,
                time_noise=time_noise,
                rotation_noise=rotation_noise,
                repair=not no_repair,
            )
        columns = _collect_columns(fitted, peaks)
        write_csv(folder / "fit.csv", columns, _UNITS, about)
        save_picture(plot_free_rocking_fit(fitted), folder / "fit.png")
    data = {"model": fitted.model, **_summarize(fitted), "rows": list_rows(columns)}
    text = str(fitted).replace(*_ADVICE)
    return Answer(text, data, output, [out / name for name in _FILES])


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


def _summarize(fit: FreeRockingFit) -> dict[str, object]:
    """Summarize a fit in numbers, NaN for those that it does not determine."""
    values = {name: float(getattr(fit, name)) for name in fit.names}
    errors = {
        name: math.nan if math.isnan(value) else float(fit.standard_errors[name])
        for name, value in values.items()
    }
    summary = {name: float(getattr(fit, name)) for name in _SUMMARY}
    counts = {"impacts": fit.used.size, "used": int(fit.used.sum())}
    remarks = [remark.replace(*_ADVICE) for remark in fit.remarks]
    return {**counts, **values, "standard_errors": errors, **summary, "remarks": remarks}
