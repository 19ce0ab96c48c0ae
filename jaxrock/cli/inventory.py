"""The command about an inventory of objects."""

from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..ground_motion import MEASURES
from ..host import format_table
from ..reports import list_remarks, write_inventory_page
from ..risk import Site, assess_inventory, read_inventory
from ..tables import write_csv
from ..validation import POSITIVE, as_real, check, check_increasing
from .command import Answer, Folder, Grid, ModelName, Steps, Writing, save_picture
from .options import SuiteOptions

if TYPE_CHECKING:
    import xarray

# Relative distance of the levels at which outcomes are simulated: enough for a ranking.
_SPACING = 0.04


class AssessInventory(SuiteOptions, Writing):
    """Objects of a museum or a building, ranked by their rates of overturning.

    The file has a line for each object below one line with the names of its columns: name,
    width [m], height [m], and perhaps depth [m], inertia ratio, restitution and restitution
    coefficient of variation, lengths also in cm or mm. Gives the uplift intensity of each, the
    probability and the rate of overturning, the most important parameter, and the width at this
    height from which on the rate stays below the target.

    Writes inventory.nc, inventory.csv, inventory.png and inventory.html, a page to print.

    Example: jaxrock inventory objects.csv --hazard hazard.csv --target 1e-4
    """

    command = "inventory"

    file: Path = field(kw_only=False)
    """The file with the objects."""
    hazard: Path = field()
    """A .csv file with two columns, level of the measure and rate of exceedance [1/yr]."""
    target: float
    """The rate of overturning that is tolerated [1/yr]."""
    measure: Literal["pgv", "pga"] = "pgv"
    """Peak ground velocity [m/s] or acceleration [m/s2]."""
    level: Grid | None = None
    """Levels for probabilities; by default of the return periods 475 and 2,475 years."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    out: Folder = Path("inventory")

    def _carry_out(self) -> Steps:
        inventory = read_inventory(self.file)
        check("target", as_real("target", self.target), POSITIVE)
        reported_levels = None
        if self.level is not None:
            reported_levels = np.array(self.read_numbers("level"))
            check("level", reported_levels, POSITIVE)
            check_increasing("level", reported_levels)
        hazard = self.read_hazard(self.measure)
        if hazard is None:
            raise ValueError("hazard must be given")
        site = Site(self.read_suite(), hazard, self.measure, spacing=_SPACING)
        folder = yield [f"inventory.{kind}" for kind in ("nc", "csv", "png", "html")]
        from ..plot import plot_inventory

        assessed = assess_inventory(
            inventory, site, self.target, reported_levels=reported_levels, model=self.model
        )
        assessed = assessed.assign_attrs(self.about)
        assessed.to_netcdf(folder / "inventory.nc")
        columns, units = _collect_columns(assessed)
        write_csv(folder / "inventory.csv", columns, units, self.about)
        save_picture(plot_inventory(assessed), folder / "inventory.png")
        picture = (folder / "inventory.png").read_bytes()
        page = write_inventory_page(assessed, picture)
        (folder / "inventory.html").write_text(page, encoding="utf-8")
        return _make_answer(assessed)


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


def _make_answer(assessed: "xarray.Dataset") -> Answer:
    """Write the ranked table, and the reasons where no width suffices."""
    unit = MEASURES[assessed.attrs["measure"]][1]
    target = assessed.attrs["target"]
    names = assessed.object.values.tolist()
    columns = {
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
    table = format_table(title, [name[:19] for name in names], **columns)
    objects = [
        {"name": name, "rank": k + 1}
        | {str(n): v.values[k].tolist() for n, v in assessed.data_vars.items()}
        for k, name in enumerate(names)
    ]
    data: dict[str, object] = {
        "target": target,
        "measure": assessed.attrs["measure"],
        "levels": assessed.level.values.tolist(),
        "parameters": assessed.parameter.values.tolist(),
        "objects": objects,
    }
    return Answer("\n".join([table, *list_remarks(assessed)]), data)
