"""The command about an inventory of objects."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..ground_motion import MEASURES
from ..host import format_table, write_whole
from ..reports import list_remarks, write_inventory_page
from ..risk import Site, assess_inventory, read_inventory
from ..tables import write_csv
from ..validation import POSITIVE, check, check_increasing
from .answers import Answer, describe_options, save_picture
from .motion_options import SuiteOptions
from .options import FileOutput, Folder, Grid, ModelName, read_numbers

if TYPE_CHECKING:
    import xarray

_FILES = ("inventory.nc", "inventory.csv", "inventory.png", "inventory.html")
# Relative distance of the levels at which outcomes are simulated: enough for a ranking.
_SPACING = 0.04


def inventory(
    file: Path,
    *,
    target: float,
    measure: Literal["pgv", "pga"] = "pgv",
    level: Grid | None = None,
    model: ModelName = "nonlinear",
    suite_options: SuiteOptions = SuiteOptions(),
    out: Folder = Path("inventory"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Rank objects of a museum or a building by their rates of overturning.

    The file has a line with the names of its columns, and below it a line for each object.
    Columns are name, width [m], height [m], and optionally depth [m], inertia ratio,
    restitution and restitution coefficient of variation, with lengths also in cm or mm.
    Objects against a wall have yes in a column one-sided. Objects on upper floors have a
    floor period [s] and optionally a floor damping. A hazard of the ground must be given. For
    each object the command gives the uplift intensity, the probability and the rate of
    overturning, the most important parameter, and the width at this height from which on the
    rate stays below the target.

    Writes inventory.nc, inventory.csv, inventory.png and inventory.html, a page to print.

    Example: jaxrock inventory objects.csv --hazard hazard.csv --target 1e-4

    Parameters
    ----------
    file
        The file with the objects.
    target
        The rate of overturning that is tolerated [1/yr].
    measure
        Peak ground velocity [m/s] or acceleration [m/s2].
    level
        Levels for probabilities. By default the levels with return periods of 475 and 2,475
        years.
    model
        Equation of motion.
    out
        Folder to write to; made if it is missing.
    """
    about = describe_options("inventory", locals())
    objects = read_inventory(file)
    check("target", target, POSITIVE)
    reported_levels = None
    if level is not None:
        reported_levels = np.array(read_numbers("level", level))
        check("level", reported_levels, POSITIVE)
        check_increasing("level", reported_levels)
    hazard = suite_options.read_hazard(measure)
    if hazard is None:
        raise ValueError("hazard must be given")
    if any(objects.one_sided) and suite_options.direction not in (None, "both"):
        raise ValueError(
            "direction must be both, or not given, where objects are one-sided, got"
            f" {suite_options.direction}"
        )
    site = Site(suite_options.read_suite(), hazard, measure, spacing=_SPACING)
    with write_whole("out", out, _FILES, output.force) as folder:
        from ..plot import plot_inventory

        assessed = assess_inventory(
            objects, site, target, reported_levels=reported_levels, model=model
        )
        assessed = assessed.assign_attrs(about)
        assessed.to_netcdf(folder / "inventory.nc")
        columns, units = _collect_columns(assessed)
        write_csv(folder / "inventory.csv", columns, units, about)
        save_picture(plot_inventory(assessed), folder / "inventory.png")
        picture = (folder / "inventory.png").read_bytes()
        page = write_inventory_page(assessed, picture)
        (folder / "inventory.html").write_text(page, encoding="utf-8")
    text = "\n".join([_write_table(assessed), *list_remarks(assessed)])
    return Answer(text, _collect_data(assessed), output, [out / name for name in _FILES])


def _collect_columns(
    assessed: "xarray.Dataset",
) -> tuple[dict[str, list[object]], dict[str, str]]:
    """Collect the columns of the ranked table, and their units."""
    columns: dict[str, list[object]] = {
        "rank": assessed["rank"].values.tolist(),
        "name": assessed.object.values.tolist(),
    }
    units: dict[str, str] = {}
    for name, variable in assessed.data_vars.items():
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
    along = assessed[dims[0]]
    unit = MEASURES[assessed.attrs["measure"]][1] if dims[0] == "level" else ""
    words = [f"{x:.4g} {unit}" if unit else str(x) for x in along.values]
    return [((k,), f" at {word}" if unit else f" to {word}") for k, word in enumerate(words)]


def _write_table(assessed: "xarray.Dataset") -> str:
    """Write the ranked table."""
    unit = MEASURES[assessed.attrs["measure"]][1]
    target = assessed.attrs["target"]
    names = assessed.object.values.tolist()
    places: dict[str, Iterable[object]] = {}
    if "one_sided" in assessed:
        places["one-sided"] = ["yes" if kind else "no" for kind in assessed.one_sided.values]
    if "floor_period" in assessed:
        places["floor [s]"] = assessed.floor_period.values
    columns = places | {
        "width [m]": assessed.width.values,
        "height [m]": assessed.height.values,
        "restitution": assessed.restitution.values,
        f"uplift [{unit}]": assessed.uplift_intensity.values,
        f"median [{unit}]": assessed["median"].values,
        "rate [1/yr]": assessed.rate.values,
        "std. error": assessed.standard_error.values,
        "needs [m]": assessed.required_width.values,
    }
    above = int((assessed.rate > target).sum())
    title = (
        f"{above} of {len(names)} objects overturn more often than {target:g} 1/yr, under"
        f" {assessed.attrs['record_count']} records and a {assessed.attrs['hazard_curve']};"
        " needs: the width at this height for the target"
    )
    return format_table(title, [name[:19] for name in names], **columns)


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
        "parameters": assessed.parameter.values.tolist(),
        "objects": objects,
    }
