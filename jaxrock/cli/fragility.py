"""The command about suites of records: fragility, and the rate of overturning at a site."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .. import risk
from ..grids import write_table
from ..ground_motion import MEASURES
from ..host import format_table, write_whole
from ..risk import (
    OverturningRate,
    Site,
    name_thresholds,
    overturning_rate,
    rate_elasticities,
)
from ..sensitivity import Uncertain
from .answers import Answer, describe_options, save_picture
from .motion_options import SuiteOptions
from .options import (
    BlockOptions,
    Count,
    FileOutput,
    Folder,
    Grid,
    ModelName,
    read_numbers,
    refuse,
)
from .wrong_calls import naming_arguments, suggest_number

if TYPE_CHECKING:
    import xarray

_FILES = ("fragility.nc", "fragility.csv", "fragility.png")


def fragility(  # noqa: PLR0913
    *,
    measure: Literal["pgv", "pga", "pgv_ratio", "pga_ratio"] = "pgv",
    levels: Grid | None = None,
    threshold: tuple[str, ...] = ("uplift", "0.5", "1", "overturning"),
    uncertain: tuple[str, ...] = (),
    samples: Count | None = None,
    elasticities: bool = False,
    model: ModelName = "nonlinear",
    suite_options: SuiteOptions = SuiteOptions(),
    block_options: BlockOptions = BlockOptions(),
    out: Folder | None = None,
    output: FileOutput = FileOutput(),
) -> Answer:
    """Compute the fragility of a block under records; with a hazard, the rate of overturning.

    Writes fragility.nc, fragility.csv and fragility.png: the probability that each
    threshold is exceeded at each level, with intervals and lognormal curves.

    Example: jaxrock fragility --records example --width 0.6 --height 2.4 --restitution 0.8

    Parameters
    ----------
    measure
        Intensity measure: peak ground velocity [m/s] or acceleration [m/s2], or one of them as
        a ratio, p PGV / (g tan(alpha_c)) or PGA / (g tan(alpha_c)) [-].
    levels
        Increasing levels of the measure for the curves. If not given, 25 levels that suit the
        size of the block.
    threshold
        Rotation ratios alpha_max / alpha_c [-], or the words "uplift" and "overturning".
    uncertain
        Coefficients of variation of uncertain parameters, as in restitution=0.05 width=0.02.
        Names are restitution, gravity, inertia_ratio, floor_period, floor_damping, and one
        pair for the size: width and height, half_width and slenderness, or critical_angle and
        frequency_parameter.
    samples
        Number of samples of uncertain parameters, a power of 2. 64 if not given.
    elasticities
        With a hazard: by how many per cent the rate changes if a parameter changes by 1 %.
    model
        Equation of motion.
    out
        Folder to write to; made if it is missing. "fragility" if not given.
    """
    options = dict(locals())
    block = block_options.block
    c = block_options.coefficient
    suite = suite_options.read_suite(block.one_sided)
    thresholds = [_read_threshold(word) for word in threshold]
    with naming_arguments(thresholds="--threshold"):
        name_thresholds(thresholds)
    # Every record must have some of the measure, or it could not be scaled to a level.
    suite.factors(1.0, measure, block)
    hazard = suite_options.read_hazard(measure)
    if hazard is None:
        refuse("--hazard", elasticities=elasticities or None)
    site = None if hazard is None else Site(suite, hazard, measure)
    uncertainty = _read_uncertain(uncertain, samples)
    if uncertainty is not None:
        options["samples"] = uncertainty.samples
        # Drawn once here, so that a name that is none is refused before anything is computed.
        with naming_arguments(coefficients_of_variation="--uncertain"):
            uncertainty.draw(block, c, on_floor=suite.floor is not None)
    about = describe_options("fragility", options)
    target = out or Path("fragility")
    with write_whole("out", target, _FILES, output.force) as folder:
        from ..plot import plot_fragility

        curves = risk.fragility(
            block,
            c,
            suite,
            None if levels is None else read_numbers("levels", levels),
            measure,
            thresholds,
            uncertain=uncertainty,
            model=model,
        ).assign_attrs(about)
        curves.to_netcdf(folder / "fragility.nc")
        # A table has columns of one length: fits of whole curves are in the other files.
        over_level = [n for n in curves if curves[n].dims == ("level", "threshold")]
        write_table(curves[over_level], folder / "fragility.csv")
        save_picture(plot_fragility(curves), folder / "fragility.png")
        lines, data = _describe_curves(curves, str(suite))
        lines.insert(0, block_options.scene_text)
        if suite.source:
            lines.insert(2, f"records: {suite.source}")
            data["record_source"] = suite.source
        if block_options.restitution is None:
            data["restitution"] = block_options.restitution_text
        if site is not None:
            rate = overturning_rate(block, c, site, uncertainty, model=model)
            lines.append(str(rate))
            data |= _list_rate(site, rate)
            # A rate that is not known has no elasticities.
            if elasticities and rate.rate >= rate.last_rate:
                # Of a block that is given by its sides, these are what can be changed.
                by = "shape" if block_options.height is None else "sides"
                changes = rate_elasticities(block, c, site, model=model, by=by)
                lines.append(str(changes))
                pairs = zip(changes.names, changes.elasticity.tolist(), strict=True)
                data["elasticities"] = dict(pairs)
    files = [target / name for name in _FILES]
    return Answer("\n".join(lines), data, output, files)


def _read_threshold(word: str) -> float | str:
    """Read a threshold: a number, or a word that `name_thresholds` checks."""
    try:
        return float(word)
    except ValueError:
        return word


def _read_uncertain(words: tuple[str, ...], samples: int | None) -> Uncertain | None:
    """Read what is uncertain; None without any."""
    if not words:
        refuse("--uncertain", samples=samples)
        return None
    coefficients = dict[str, float]()
    for word in words:
        name, _, value = word.partition("=")
        try:
            coefficients[name] = float(value)
        except ValueError:
            raise ValueError(
                f"--uncertain must be NAME=NUMBER, such as restitution=0.05, got {word!r:.60}"
                f"{suggest_number(value)}"
            ) from None
    return Uncertain(coefficients, samples=64 if samples is None else samples)


def _describe_curves(
    curves: "xarray.Dataset", suite: str
) -> tuple[list[str], dict[str, object]]:
    """Describe medians and dispersions of the curves: lines of text, and data."""
    measure = curves.attrs["measure"]
    median = curves["lognormal_median"].values
    dispersion = curves["lognormal_dispersion"].values
    unit = MEASURES[measure][1]
    unit = "" if unit == "1" else unit
    names = [str(name) for name in curves.threshold.values]
    descriptions = [_describe_threshold(name) for name in names]
    levels = curves.level.values
    # The levels may not reach a median; uplift is located below them as well.
    shown = [
        x if x <= levels[-1] and (name == "uplift" or x >= levels[0]) else "-"
        for name, x in zip(names, median.tolist(), strict=True)
    ]
    lines = [
        f"{suite}, {levels.size} levels of {measure}, {levels[0]:.4g} to"
        f" {levels[-1]:.4g}{unit and f' {unit}'}",
        format_table(
            f"lognormal curves of the level of {measure} from which on the block would ...",
            descriptions,
            **{f"median{unit and f' [{unit}]'}": shown},
            dispersion=dispersion,
        ),
    ]
    for words, remark in zip(descriptions, curves.remark.values, strict=True):
        if remark:
            lines.append(f"{words}: {remark}")
    data: dict[str, object] = {
        "records": curves.sizes["record"],
        "thresholds": names,
        "median": median.tolist(),
        "dispersion": dispersion.tolist(),
        "remarks": curves.remark.values.tolist(),
    }
    return lines, data


def _describe_threshold(name: str) -> str:
    """Describe what a block does beyond a threshold, in words that need no formula."""
    words = {
        "uplift": "lift off an edge",
        "overturning": "overturn",
        "1": "rock to the critical angle",
    }
    return words.get(name, f"rock to {name} of the critical angle")


def _list_rate(site: Site, rate: OverturningRate) -> dict[str, object]:
    """List the data of a rate of overturning."""
    return {
        "hazard": str(site.hazard),
        "rate": float(rate.rate),
        "standard_error": float(rate.standard_error),
        "not_detected": float(rate.not_detected),
        "complete": bool(rate.complete),
    }
