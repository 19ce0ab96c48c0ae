"""The command about a table of objects."""

from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..ground_motion import MEASURES
from ..host import format_table
from ..reports import list_remarks, write_inventory_page
from ..risk import assess_inventory, read_inventory
from ..tables import write_csv
from ..validation import POSITIVE, as_real, check
from .command import Answer, Folder, Grid, ModelName, Steps, Writing, save_picture
from .options import SuiteOptions

if TYPE_CHECKING:
    import xarray


class AssessInventory(SuiteOptions, Writing):
    """Objects of a museum or a building, ranked by the yearly rate at which they overturn.

    The file has a line for each object below one line with the names of its columns: name,
    width [m], height [m], and perhaps depth [m], inertia ratio, restitution and restitution
    scatter, lengths also in cm or mm. Says for each what lifts it, how likely it overturns,
    what matters most, and the width at this height that brings the rate to the target.

    Writes inventory.nc, inventory.csv, inventory.png and inventory.html, a page to print.

    Example: jaxrock inventory objects.csv --hazard hazard.csv --target 1e-4
    """

    command = "inventory"

    file: Path = field(kw_only=False)
    """The file with the objects."""
    hazard: Path = field()
    """A .csv file with two columns, level of the measure and yearly rate of exceedance."""
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
        levels = None
        if self.level is not None:
            levels = np.array(self.read_numbers("level"))
            check("level", levels, POSITIVE)
            if (np.diff(levels) <= 0).any():
                raise ValueError("level must be increasing, got values that do not increase")
        hazard = self.read_hazard(self.measure)
        if hazard is None:
            raise ValueError("hazard must be given")
        suite = self.read_suite()
        # Every record must have some of the measure, or it could not be scaled to a level.
        suite.factors(1.0, self.measure)
        folder = yield [f"inventory.{kind}" for kind in ("nc", "csv", "png", "html")]
        from ..plot import plot_inventory

        found = assess_inventory(
            inventory,
            suite,
            hazard,
            self.target,
            measure=self.measure,
            levels=levels,
            model=self.model,
        )
        found = found.assign_attrs(self.about)
        found.to_netcdf(folder / "inventory.nc")
        columns, units = _collect_columns(found)
        write_csv(folder / "inventory.csv", columns, units, self.about)
        save_picture(plot_inventory(found), folder / "inventory.png")
        picture = (folder / "inventory.png").read_bytes()
        page = write_inventory_page(found, picture)
        (folder / "inventory.html").write_text(page, encoding="utf-8")
        return _make_answer(found)


def _collect_columns(
    found: "xarray.Dataset",
) -> tuple[dict[str, list[object]], dict[str, str]]:
    """Collect the columns of the ranked table, and their units."""
    columns: dict[str, list[object]] = {
        "rank": found["rank"].values.tolist(),
        "name": found.object.values.tolist(),
    }
    units: dict[str, str] = {}
    for name, variable in found.data_vars.items():
        unit = variable.attrs.get("units", "")
        # A column for each level and each parameter.
        for index, label in _label_entries(found, variable):
            head = f"{name}{label}"
            columns[head] = variable.values[(slice(None), *index)].tolist()
            units[head] = unit
    return columns, units


def _label_entries(
    found: "xarray.Dataset", variable: "xarray.DataArray"
) -> list[tuple[tuple[int, ...], str]]:
    """List the places of a variable beside the objects, and what each is called."""
    dims = variable.dims[1:]
    if not dims:
        return [((), "")]
    along = found[dims[0]]
    unit = MEASURES[found.attrs["measure"]][1] if dims[0] == "level" else ""
    words = [f"{x:.4g} {unit}" if unit else str(x) for x in along.values]
    return [((k,), f" at {word}" if unit else f" to {word}") for k, word in enumerate(words)]


def _make_answer(found: "xarray.Dataset") -> Answer:
    """Write the ranked table, and say why a width is as it is where there is none."""
    unit = MEASURES[found.attrs["measure"]][1]
    names = found.object.values.tolist()
    columns = {
        "width [m]": found.width.values,
        "height [m]": found.height.values,
        "restitution": found.restitution.values,
        f"lifted [{unit}]": found.uplift_level.values,
        f"median [{unit}]": found["median"].values,
        "rate [1/yr]": found.rate.values,
        "std. error": found.standard_error.values,
        "needs [m]": found.required_width.values,
    }
    above = int((found.rate > found.attrs["target"]).sum())
    lines = [
        format_table(
            f"{above} of {len(names)} objects overturn more often than"
            f" {found.attrs['target']:g} 1/yr, under {found.attrs['record_count']} records and a"
            f" {found.attrs['hazard_curve']}; needs: the width at this height",
            [name[:19] for name in names],
            **columns,
        )
    ]
    lines += list_remarks(found)
    data: dict[str, object] = {
        "target": found.attrs["target"],
        "measure": found.attrs["measure"],
        "levels": found.level.values.tolist(),
        "parameters": found.parameter.values.tolist(),
        "objects": [
            {"name": name, "rank": k + 1}
            | {str(n): v.values[k].tolist() for n, v in found.data_vars.items()}
            for k, name in enumerate(names)
        ],
    }
    return Answer("\n".join(lines), data)
