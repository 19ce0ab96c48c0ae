"""The command about an inventory of objects."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..ground_motion import MEASURES
from ..host import format_table, write_whole
from ..reports import list_remarks, name_theory, write_inventory_page
from ..risk import (
    EXAMPLE_FILES,
    MISSES,
    Hazard,
    Inventory,
    Site,
    assess_inventory,
    describe_place,
    describe_years,
    name_records,
    read_example_inventory,
    read_inventory,
    write_example_inventory,
    write_years,
)
from ..tables import write_csv
from ..validation import POSITIVE, check
from .answers import Answer, describe_options, save_picture
from .motion_options import SuiteOptions
from .options import FileOutput, Folder, ModelName, refuse_beside

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray

_FILES = ("inventory.nc", "inventory.csv", "inventory.png", "inventory.html")
# Relative distance of the levels at which outcomes are simulated: enough for a ranking.
_SPACING = 0.04
_PER_PAGE = 15  # objects of a picture that is printed as wide as a page
_LONGEST_NAME = 32  # letters of a name in the text; tables and pages have all of them
_EXAMPLE_PERIOD = 2475.0  # years, 2 % in 50 years
_EXAMPLE_HAZARD = "the one of the example, of no real place"


def inventory(  # noqa: PLR0913
    file: Path,
    *,
    target: float | None = None,
    target_return_period: float | None = None,
    measure: Literal["pgv", "pga"] = "pgv",
    no_required_width: bool = False,
    elasticities: bool = False,
    model: ModelName = "nonlinear",
    title: str | None = None,
    suite_options: SuiteOptions = SuiteOptions(),
    out: Folder = Path("inventory"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Rank objects of a museum or a building by their rates of overturning.

    The file has a line with the names of its columns, and below it a line for each object.
    Columns are name, width [m], height [m], and optionally depth [m], inertia ratio,
    restitution and restitution coefficient of variation, with lengths also in cm or mm; other
    columns are copied into inventory.csv.
    Objects against a wall have yes in a column one-sided. Objects on upper floors have a
    floor period [s] and optionally a floor damping. Give the hazard of the ground by --hazard.
    For each object the command gives the uplift intensity, the probability and the rate of
    overturning, and the width that it needs at this height: with it, and with any larger width,
    the rate stays below the target. Where no restitution is given, the command computes the rate
    with a low and with a high one.

    Writes inventory.nc, inventory.csv, inventory.png and inventory.html, a page to print.

    Give the word "example" instead of a file to try it: the command then also writes
    objects.csv and hazard.csv, assesses them, and you can replace their contents by your own.

    Example: jaxrock inventory objects.csv --hazard hazard.csv --target-return-period 2475

    Parameters
    ----------
    file
        The file with the objects, or "example".
    target
        The tolerated rate of overturning [1/yr]. Give this or its return period.
    target_return_period
        The return period of the tolerated rate, 1 over the target [yr].
    measure
        Peak ground velocity [m/s] or acceleration [m/s2].
    no_required_width
        Leave out the search for the width that each object needs, which takes most of the time.
    elasticities
        Compute by how many per cent the rate of each object changes if its width, its height or
        its restitution changes by 1 %.
    model
        Equation of motion.
    title
        Title of the page; by default the number of objects.
    out
        Folder to write to; made if it is missing.
    """
    about = describe_options("inventory", locals())
    # The datasets have a title of their own.
    about.pop("title", None)
    is_example = str(file) == "example"
    if is_example and target is None and target_return_period is None:
        target_return_period = _EXAMPLE_PERIOD
    if is_example:
        objects, hazard = _read_example(suite_options, measure)
        about["hazard"] = _EXAMPLE_HAZARD
        names = (*EXAMPLE_FILES, *_FILES)
    else:
        objects = read_inventory(file)
        hazard = suite_options.read_hazard(measure)
        names = _FILES
    rate = _read_target(target, target_return_period)
    if hazard is None:
        raise ValueError("--hazard must be given: a .csv file of levels and rates per year")
    if any(objects.one_sided) and suite_options.direction not in (None, "both"):
        raise ValueError(
            "direction must be both, or not given, where objects are one-sided, got"
            f" {suite_options.direction}"
        )
    site = Site(suite_options.read_suite(), hazard, measure, spacing=_SPACING)
    with write_whole("out", out, names, output.force) as folder:
        from ..plot import plot_inventory

        if is_example:
            write_example_inventory(folder)
        assessed = assess_inventory(
            objects,
            site,
            rate,
            required_width=not no_required_width,
            elasticities=elasticities,
            model=model,
        )
        assessed = assessed.assign_attrs(about)
        assessed.to_netcdf(folder / "inventory.nc")
        columns, units = _collect_columns(assessed)
        write_csv(folder / "inventory.csv", columns, units, about)
        save_picture(plot_inventory(assessed), folder / "inventory.png")
        starts = range(0, assessed.object.size, _PER_PAGE)
        parts = [assessed.isel(object=slice(k, k + _PER_PAGE)) for k in starts]
        pictures = [_draw_png(plot_inventory(part)) for part in parts]
        page = write_inventory_page(assessed, pictures, title=title)
        (folder / "inventory.html").write_text(page, encoding="utf-8")
    lines = [_write_table(assessed), *_describe_assumed(assessed), *list_remarks(assessed)]
    if is_example:
        lines += _describe_next_steps(out)
    return Answer("\n".join(lines), _collect_data(assessed), output, [out / n for n in names])


def _read_target(target: float | None, period: float | None) -> float:
    """Read the target as a rate [1/yr], from the rate or its return period."""
    if target is not None and period is not None:
        raise ValueError(
            f"target and target_return_period exclude each other, got {target:g} and"
            f" {period:g}: leave out one of them"
        )
    if period is not None:
        check("target_return_period", period, POSITIVE)
        return 1 / period
    if target is None:
        raise ValueError(
            "target or target_return_period must be given, got neither;"
            " --target-return-period 475 tolerates one overturning in 475 years"
        )
    check("target", target, POSITIVE)
    return target


def _read_example(suite_options: SuiteOptions, measure: str) -> tuple[Inventory, Hazard]:
    """Read the example, which has a hazard of its own."""
    refuse_beside(
        "example",
        hazard=suite_options.hazard,
        hazard_unit=suite_options.hazard_unit,
        hazard_site=suite_options.hazard_site,
    )
    if measure != "pgv":
        raise ValueError(f"measure must be pgv for the example, got {measure}")
    return read_example_inventory()


def _describe_next_steps(out: Path) -> list[str]:
    """Describe what to do with the files of the example."""
    objects, hazard = (str(out / name) for name in EXAMPLE_FILES)
    return [
        "",
        "This was an example: its objects and its hazard are made up. For yours:",
        f"1. Open {objects} in a spreadsheet or an editor. Replace the objects, and save as CSV.",
        f"2. Put the hazard curve of your site into {hazard} in the same way.",
        "3. Type (all in one line):",
        f"   jaxrock inventory {objects} --hazard {hazard}"
        f" --target-return-period {_EXAMPLE_PERIOD:.0f} --out my-objects",
        "4. Open my-objects/inventory.html in a browser, and print it.",
    ]


def _describe_assumed(assessed: "xarray.Dataset") -> list[str]:
    """Describe which restitutions were assumed, and what years they are given for."""
    values: dict[str, list[float]] = {}
    for k in np.flatnonzero(assessed.restitution_assumed.values):
        answer = assessed.isel(object=int(k))
        values.setdefault(name_theory(answer), []).append(float(answer.restitution))
    lines = []
    for theory, coefficients in values.items():
        ends = {f"{end:.3f}": None for end in (min(coefficients), max(coefficients))}
        number = len(coefficients)
        lines.append(
            f"C = {' to '.join(ends)} ({theory}, assumed) of {number} object{'s' * (number > 1)};"
            " once in: the years with this C and with a low one"
        )
    return lines


def _draw_png(ax: "matplotlib.axes.Axes") -> bytes:
    """Draw the figure that axes belong to as a PNG."""
    file = io.BytesIO()
    save_picture(ax, file)
    return file.getvalue()


def _collect_columns(
    assessed: "xarray.Dataset",
) -> tuple[dict[str, list[object]], dict[str, str]]:
    """Collect the columns of the ranked table, and their units."""
    columns: dict[str, list[object]] = {
        "rank": assessed["rank"].values.tolist(),
        "name": assessed.object.values.tolist(),
    }
    units: dict[str, str] = {}
    for name in map(str, assessed.data_vars):
        variable = assessed[name]
        unit = variable.attrs.get("units", "")
        # A column for each level and each parameter.
        for index, label in _label_entries(assessed, variable):
            head = f"{name}{label}"
            columns[head] = variable.values[(slice(None), *index)].tolist()
            units[head] = unit
    return columns, units


def _label_entries(
    assessed: "xarray.Dataset", variable: "xarray.DataArray"
) -> list[tuple[tuple[int, ...], str]]:
    """List the indices of a variable beside the objects, each with its label."""
    dims = variable.dims[1:]
    if not dims:
        return [((), "")]
    labels = map(str, assessed["written" if dims[0] == "level" else dims[0]].values)
    before = {"level": " at ", "parameter": " to ", "column": ": "}[str(dims[0])]
    return [((k,), f"{before}{word}") for k, word in enumerate(labels)]


def _write_table(assessed: "xarray.Dataset") -> str:
    """Write the ranked table."""
    unit = MEASURES[assessed.attrs["measure"]][1]
    target = assessed.attrs["target"]
    names = assessed.object.values.tolist()
    answers = [assessed.isel(object=k) for k in range(len(names))]
    places = {}
    if "one_sided" in assessed or "floor_period" in assessed:
        places["stands"] = [describe_place(answer) or "free" for answer in answers]
    columns = places | {
        "width [m]": assessed.width.values,
        "height [m]": assessed.height.values,
        "restitution": _list_restitutions(answers),
        f"uplift [{unit}]": assessed.uplift_intensity.values,
        f"median [{unit}]": assessed["median"].values,
        "rate [1/yr]": assessed.rate.values,
        "std. error": assessed.standard_error.values,
    }
    above = int((assessed.verdict == MISSES).sum())
    title = (
        f"{above} of {len(names)} objects overturn more often than {target:.4g} 1/yr, once in"
        f" {write_years(1 / target)} years, under {name_records(assessed)};"
        f" {assessed.attrs['hazard_curve']}"
    )
    short = [name[:_LONGEST_NAME] for name in names]
    table = format_table(title, short, **columns)
    # The last columns are as wide as their words.
    last = ["", "  once in [yr]; for the target"]
    last += [f"  {describe_years(answer)}; {answer.need.values}" for answer in answers]
    lines = zip(table.splitlines(), last, strict=True)
    return "\n".join(line + end for line, end in lines)


def _list_restitutions(answers: Sequence["xarray.Dataset"]) -> list[object]:
    """List the restitutions, with a word where they were assumed."""
    return [
        f"{float(answer.restitution):.3f} assumed"
        if bool(answer.restitution_assumed)
        else float(answer.restitution)
        for answer in answers
    ]


def _collect_data(assessed: "xarray.Dataset") -> dict[str, object]:
    """Collect the assessment of each object, in the order of their ranks."""
    objects = [
        {"name": name, "rank": k + 1}
        | {str(n): v.values[k].tolist() for n, v in assessed.data_vars.items()}
        for k, name in enumerate(assessed.object.values.tolist())
    ]
    return {
        "target": assessed.attrs["target"],
        "measure": assessed.attrs["measure"],
        "levels": assessed.level.values.tolist(),
        "objects": objects,
        **(
            {"parameters": assessed.parameter.values.tolist()}
            if "parameter" in assessed
            else {}
        ),
    }
