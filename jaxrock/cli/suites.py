"""The command about suites of records."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..grids import write_table
from ..ground_motion import MEASURES, Suite, example_suite, read_suite
from ..host import format_table
from ..risk import Hazard, fragility, name_thresholds, rate_elasticities, read_hazard
from ..validation import POSITIVE, as_real, check
from .command import Answer, Folder, Grid, ModelName, Steps, save_picture
from .options import BlockOptions, refuse_stated_units
from .storing import Storing

if TYPE_CHECKING:
    import xarray


class Fragility(BlockOptions, Storing):
    """Fragility of a block under a suite of records; with a hazard, the yearly rate of overturning.

    Writes fragility.nc, fragility.csv and fragility.png: the share of records that exceed each
    threshold at each level, with intervals and lognormal curves.

    Example: jaxrock fragility --records example --width 0.6 --height 2.4 --restitution 0.8
    """

    command = "fragility"

    records: str = "example"
    """A folder of .AT2 and .csv files, or "example" for the twenty that come with jaxrock."""
    unit: str | None = None
    """Unit of the records, where the files do not state it."""
    time_step: float | None = None
    """Time between samples of .csv files without times [s]."""
    with_vertical: bool = False
    """Include the vertical component of each record."""
    measure: Literal["pgv", "pga", "pgv_ratio", "pga_ratio"] = "pgv"
    """Peak ground velocity [m/s] or acceleration [m/s2], or their ratios to those of the block."""
    levels: Grid | None = None
    """Increasing levels of the measure for the curves; by default by the size of the block."""
    threshold: tuple[str, ...] = ("uplift", "0.5", "1", "overturning")
    """Rotation ratios alpha_max / alpha_c [-], "uplift", "overturning"."""
    tolerance: float = 1e-3
    """Relative error of peak rotations that is allowed."""
    hazard: Path | None = None
    """A .csv file with two columns, level of the measure and yearly rate of exceedance."""
    hazard_unit: str | None = None
    """Unit of these levels, where the file does not state it."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    out: Folder = Path("fragility")

    def _carry_out(self) -> Steps:
        block = self.block
        c = self.coefficient
        suite = self._read_suite()
        check("tolerance", as_real("tolerance", self.tolerance), POSITIVE)
        thresholds = [_read_threshold(word) for word in self.threshold]
        name_thresholds(thresholds)
        if self.levels is None:
            levels = self._choose_levels()
        else:
            levels = np.array(self.read_numbers("levels"))
            check("levels", levels, POSITIVE)
            if (np.diff(levels) <= 0).any():
                raise ValueError("levels must be increasing, got values that do not increase")
        # Every record must have some of the measure, or it could not be scaled to a level.
        suite.factors(1.0, self.measure, block)
        hazard = None
        if self.hazard is None:
            self.refuse("hazard_unit", only_with="a hazard")
        if self.hazard is not None:
            if self.measure not in ("pgv", "pga"):
                raise ValueError(
                    f"hazard goes with the measures pgv and pga, not {self.measure}"
                )
            hazard = read_hazard(self.hazard, unit=self.hazard_unit, measure=self.measure)
        options = {"tolerance": self.tolerance, "model": self.model}
        curves_of = functools.partial(
            fragility, block, c, suite, levels, self.measure, thresholds, **options
        )
        answer = functools.partial(self._make_answer, suite, levels, hazard)
        if self.store:
            lazy = curves_of(chunks=self.lengths)
            yield ()
            return self.write_store(lazy, answer)
        folder = yield [f"fragility.{kind}" for kind in ("nc", "csv", "png")]
        from ..plot import plot_fragility

        curves = curves_of().assign_attrs(self.about)
        curves.to_netcdf(folder / "fragility.nc")
        # A table has columns of one length: fits of whole curves are in the other files.
        over_level = [n for n in curves if curves[n].dims == ("level", "threshold")]
        write_table(curves[over_level], folder / "fragility.csv")
        save_picture(plot_fragility(curves), folder / "fragility.png")
        return answer(curves)

    def _make_answer(
        self, suite: Suite, levels: np.ndarray, hazard: Hazard | None, curves: "xarray.Dataset"
    ) -> Answer:
        """Describe the curves, and with a hazard the rate as well."""
        chaotic = 1 - float(curves.within_tolerance.mean())
        medians = {
            "median": curves["lognormal_median"].values,
            "dispersion": curves["lognormal_dispersion"].values,
        }
        _, unit, _ = MEASURES[self.measure]
        lines = [
            format_table(
                f"{suite}, {levels.size} levels of {self.measure},"
                f" {levels[0]:.4g} to {levels[-1]:.4g} {'' if unit == '1' else unit}".rstrip(),
                [str(name) for name in curves.threshold.values],
                **medians,
            )
        ]
        names = curves.threshold.values
        lines += [f"{n}: {r}" for n, r in zip(names, curves.remark.values, strict=True) if r]
        if chaotic:
            lines.append(f"{chaotic:.1%} of the responses are not within the tolerance")
        data: dict[str, object] = {
            "records": len(suite),
            "thresholds": [str(name) for name in names],
            **{name: values.tolist() for name, values in medians.items()},
            "remarks": curves.remark.values.tolist(),
            "share_within_tolerance": 1 - chaotic,
        }
        if hazard is not None:
            block = self.block
            c = self.coefficient
            about = rate_elasticities(block, c, suite, hazard, self.measure, model=self.model)
            found = about.found
            lines.append(f"{found}\n{about}")
            data |= {
                "rate": float(found.rate),
                "standard_error": float(found.standard_error),
                "unseen": float(found.unseen),
                "complete": bool(found.complete),
                "elasticities": dict(
                    zip(about.names, about.differences.tolist(), strict=True)
                ),
                "slopes": dict(zip(about.names, about.slopes.tolist(), strict=True)),
            }
        return Answer("\n".join(lines), data)

    def _read_suite(self) -> Suite:
        """Read the records of a folder, or take those that come with jaxrock."""
        if self.records != "example":
            options = {
                "unit": self.unit,
                "time_step": self.time_step,
                "vertical": self.with_vertical,
            }
            return read_suite(self.records, **options)
        refuse_stated_units('records "example" have their', self.unit, self.time_step)
        return example_suite(vertical=self.with_vertical)

    def _choose_levels(self) -> np.ndarray:
        """Choose levels around the intensities that lift and overturn a block of this size."""
        block = self.block
        uplift = float(block.gravity / block.slenderness)
        if self.measure.startswith("pga"):
            return (1.0 if self.measure == "pga_ratio" else uplift) * np.geomspace(0.5, 8, 25)
        # Velocities scale with 1 / p: it takes a faster ground to overturn a larger block.
        unit = uplift / float(block.frequency_parameter)
        return (1.0 if self.measure == "pgv_ratio" else unit) * np.geomspace(0.1, 3, 25)


def _read_threshold(word: str) -> float | str:
    """Read a threshold: a number, or a word that `fragility` checks."""
    try:
        return float(word)
    except ValueError:
        return word
