"""The commands about many motions or many blocks: fragility, inventories."""

from pathlib import Path
from typing import Literal

from .. import risk
from ..sensitivity import Uncertain
from ..validation import POSITIVE, check
from .answers import Answer
from .motion_options import SuiteOptions
from .options import (
    BlockOptions,
    Count,
    FileOutput,
    Grid,
    ModelName,
    read_numbers,
    refuse,
)

_NEXT_STEPS = """
This was an example: its objects and its hazard are made up. For yours, replace the contents of
{0} and {1} in a spreadsheet, save as CSV, and type:
   jaxrock inventory {0} --hazard {1} --target-return-period 2475 --out my-objects"""


def fragility(  # noqa: PLR0913
    *,
    measure: Literal["pgv", "pga", "pgv_ratio", "pga_ratio"] | None = None,
    levels: Grid | None = None,
    thresholds: tuple[float | str, ...] = ("uplift", 0.5, 1.0, "overturning"),
    uncertain: tuple[str, ...] = (),
    samples: Count = 64,
    target_return_period: float | None = None,
    model: ModelName = "nonlinear",
    suite_options: SuiteOptions = SuiteOptions(),
    block_options: BlockOptions = BlockOptions(),
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
        a ratio, p PGV / (g tan(alpha_c)) or PGA / (g tan(alpha_c)) [-]. If not given, the one
        that the hazard states, or pgv.
    levels
        Increasing levels of the measure for the curves. If not given, 25 levels that suit the
        size of the block.
    thresholds
        Rotation ratios alpha_max / alpha_c [-], or the words "uplift" and "overturning".
    uncertain
        Coefficients of variation of uncertain parameters, as in restitution=0.05 width=0.02.
        Names are restitution, gravity, inertia_ratio, floor_period, floor_damping, and one
        pair for the size: width and height, half_width and slenderness, or critical_angle and
        frequency_parameter.
    samples
        Number of samples of uncertain parameters, a power of 2.
    target_return_period
        With a hazard: find the width at this height from which on the block overturns at most
        once in so many years [yr].
    model
        Equation of motion.
    """
    block, c = block_options.block, block_options.coefficient
    target = None if target_return_period is None else _read_target(target_return_period)
    suite = suite_options.read_suite(block.one_sided)
    hazard = suite_options.read_hazard(measure)
    site = None if hazard is None else risk.Site(suite, hazard, measure)
    if site is None:
        refuse("without --hazard", target_return_period=target)
    uncertainty = _read_uncertain(uncertain, samples)
    with output.write("fragility") as files:
        from ..plot import plot_fragility

        examined = None if levels is None else read_numbers("levels", levels)
        scaled = (suite, examined, site.measure if site else measure or "pgv", thresholds)
        curves = risk.fragility(block, c, *scaled, uncertain=uncertainty, model=model)
        curves = curves.assign_attrs(scene=block_options.text)
        # A table has columns of one length: fits of whole curves are in the other files.
        over_level = [n for n in curves if curves[n].dims == ("level", "threshold")]
        files.write_dataset(curves, plot_fragility(curves), table=curves[over_level])
        texts: list[object] = [block_options.text, suite, risk.describe_fragility(curves)]
        data = risk.tabulate_fragility(curves)
        if site is not None:
            rate = risk.overturning_rate(block, c, site, uncertainty, model=model)
            texts.append(rate)
            data |= {"hazard": str(hazard), **rate.table()}
            if target is not None:
                required = risk.required_value(block, c, site, target, model=model)
                texts.append(required)
                data["required_width"] = float(required.value)
    return Answer("\n".join(map(str, texts)), data, output, files.paths)


def _read_uncertain(words: tuple[str, ...], samples: int) -> Uncertain | None:
    """Read what is uncertain; None without any."""
    if not words:
        return None
    pairs = [word.partition("=") for word in words]
    try:
        coefficients = {name: float(value) for name, _, value in pairs}
    except ValueError:
        raise ValueError(
            f"--uncertain must be NAME=NUMBER, such as restitution=0.05, got {' '.join(words)}"
        ) from None
    return Uncertain(coefficients, samples=samples)


def inventory(
    file: Path,
    *,
    target_return_period: float | None = None,
    measure: Literal["pgv", "pga"] | None = None,
    no_required_width: bool = False,
    model: ModelName = "nonlinear",
    suite_options: SuiteOptions = SuiteOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Rank objects of a museum or a building by their rates of overturning.

    The file has a line with the names of its columns, and below it a line for each object.
    Columns are name, width [m], height [m], and optionally depth [m], inertia ratio,
    restitution and restitution coefficient of variation, with lengths also in cm or mm; other
    columns are copied into inventory.csv.
    Objects against a wall have yes in a column one-sided. Objects on upper floors have a
    floor period [s] and optionally a floor damping. Give the hazard of the ground by --hazard.
    For each object the command gives the uplift intensity, the rate of overturning, and the
    width that it needs at this height: with it, and with any larger width, the rate stays below
    the target. Where no restitution is given, the command computes the rate
    with a low and with a high one.

    Writes inventory.nc, inventory.csv, inventory.png and inventory.html, a page to print.

    Give the word "example" instead of a file to try it: the command then also writes
    objects.csv and hazard.csv, assesses them, and you can replace their contents by your own.

    Example: jaxrock inventory objects.csv --hazard hazard.csv --target-return-period 2475

    Parameters
    ----------
    file
        The file with the objects, or "example".
    target_return_period
        Each object may overturn once in so many years [yr].
    measure
        Peak ground velocity [m/s] or acceleration [m/s2]; by default the one of the hazard.
    no_required_width
        Leave out the search for the width that each object needs, which takes most of the time.
    model
        Equation of motion.
    """
    is_example = str(file) == "example"
    if is_example:
        objects, hazard = risk.read_example_inventory()
        target_return_period = target_return_period or 2475.0  # 2 % in 50 years
    else:
        objects, hazard = risk.read_inventory(file), suite_options.read_hazard(measure)
    if hazard is None or target_return_period is None:
        raise ValueError(
            "--hazard and --target-return-period must be given, as in --hazard hazard.csv"
            " --target-return-period 475"
        )
    target = _read_target(target_return_period)
    # Levels 4 % apart are enough for a ranking.
    site = risk.Site(suite_options.read_suite(), hazard, measure, spacing=0.04)
    examples = risk.EXAMPLE_FILES if is_example else ()
    with output.write("inventory", "inventory.html", *examples) as files:
        from ..plot import plot_inventory

        if is_example:
            risk.write_example_inventory(files.folder)
        assessed = risk.assess_inventory(
            objects, site, target, required_width=not no_required_width, model=model
        )
        table = risk.tabulate_inventory(assessed)
        files.write_dataset(assessed, plot_inventory(assessed), table=table)
        picture = (files.folder / "inventory.png").read_bytes()
        page = risk.write_inventory_page(assessed, [picture])
        (files.folder / "inventory.html").write_text(page, encoding="utf-8")
    text = risk.describe_inventory(assessed)
    if is_example:
        text += _NEXT_STEPS.format(*files.paths[-2:])
    rows = table.to_dataframe().reset_index()
    data = {"target": target, "measure": site.measure, "objects": rows.to_dict("records")}
    return Answer(text, data, output, files.paths)


def _read_target(period: float) -> float:
    """Read the tolerated rate [1/yr] from its return period [yr]."""
    check("target_return_period", period, POSITIVE)
    return 1 / period
