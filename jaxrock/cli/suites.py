"""The command about suites of records."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..grids import write_table
from ..ground_motion import MEASURES, Suite
from ..host import format_table
from ..risk import Hazard, fragility, name_thresholds, overturning_rate, rate_elasticities
from ..sensitivity import Uncertain
from ..validation import POSITIVE, as_real, check
from .command import Answer, Count, Folder, Grid, ModelName, Steps, save_picture
from .options import BlockOptions, SuiteOptions
from .storing import Storing

if TYPE_CHECKING:
    import xarray


class Fragility(SuiteOptions, BlockOptions, Storing):
    """Fragility of a block under a suite of records; with a hazard, the yearly rate of overturning.

    Writes fragility.nc, fragility.csv and fragility.png: the share of records that exceed each
    threshold at each level, with intervals and lognormal curves.

    Example: jaxrock fragility --records example --width 0.6 --height 2.4 --restitution 0.8
    """

    command = "fragility"

    measure: Literal["pgv", "pga", "pgv_ratio", "pga_ratio"] = "pgv"
    """Peak ground velocity [m/s] or acceleration [m/s2], or their ratios to those of the block."""
    levels: Grid | None = None
    """Increasing levels of the measure for the curves; by default by the size of the block."""
    threshold: tuple[str, ...] = ("uplift", "0.5", "1", "overturning")
    """Rotation ratios alpha_max / alpha_c [-], "uplift", "overturning"."""
    tolerance: float = 1e-3
    """Relative error of peak rotations that is allowed."""
    scatter: tuple[str, ...] = ()
    """Coefficients of variation of uncertain numbers, as in restitution=0.05 width=0.02."""
    samples: Count = 64
    """Samples of uncertain numbers, a power of 2."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    out: Folder = Path("fragility")

    def _carry_out(self) -> Steps:
        block = self.block
        c = self.coefficient
        suite = self.read_suite()
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
        hazard = self.read_hazard(self.measure)
        drawing = self._read_scatter()
        options = {"tolerance": self.tolerance, "model": self.model, **drawing}
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
        names = [str(name) for name in curves.threshold.values]
        said = [_describe_threshold(name) for name in names]
        unit = "" if unit == "1" else f" {unit}"
        lines = [
            f"{suite}, {levels.size} levels of {self.measure}, {levels[0]:.4g} to"
            f" {levels[-1]:.4g}{unit}",
            format_table(
                f"level of {self.measure} at which half of the records make the block ...",
                said,
                **{f"median{unit and f' [{unit.strip()}]'}": medians["median"]},
                dispersion=medians["dispersion"],
            ),
        ]
        lines += [
            f"{words}: {remark}"
            for words, remark in zip(said, curves.remark.values, strict=True)
            if remark
        ]
        if chaotic:
            lines.append(f"{chaotic:.1%} of the responses are not within the tolerance")
        data: dict[str, object] = {
            "records": len(suite),
            "thresholds": names,
            **{name: values.tolist() for name, values in medians.items()},
            "remarks": curves.remark.values.tolist(),
            "share_within_tolerance": 1 - chaotic,
        }
        if self.scatter:
            parts = {
                name.removeprefix("dispersion_"): curves[name].values
                for name in ("dispersion_of_records", "dispersion_of_parameters")
            }
            title = "dispersion that is due to the scatter"
            lines.append(format_table(title, said, **parts))
            data |= {f"dispersion_{name}": part.tolist() for name, part in parts.items()}
        if hazard is not None:
            block = self.block
            c = self.coefficient
            # Of a block that is given by its sides, these are what can be changed.
            sides = self.height is not None
            about = rate_elasticities(
                block, c, suite, hazard, self.measure, model=self.model, sides=sides
            )
            found = about.found
            if hazard.statistic:
                lines.append(str(hazard))
            lines.append(f"{found}\n{about}")
            data |= {
                "hazard": str(hazard),
                "rate": float(found.rate),
                "standard_error": float(found.standard_error),
                "unseen": float(found.unseen),
                "complete": bool(found.complete),
                "elasticities": dict(
                    zip(about.names, about.differences.tolist(), strict=True)
                ),
                "slopes": dict(zip(about.names, about.slopes.tolist(), strict=True)),
            }
            if self.scatter:
                drawing = self._read_scatter()
                uncertain = overturning_rate(
                    block, c, suite, hazard, self.measure, model=self.model, **drawing
                )
                lines.append(f"with uncertain numbers: {uncertain}")
                data["rate_with_scatter"] = float(uncertain.rate)
        return Answer("\n".join(lines), data)

    def _read_scatter(self) -> dict[str, Any]:
        """Read the coefficients of variation, as arguments; none without any."""
        if not self.scatter:
            self.refuse("samples", only_with="scatter")
            return {}
        scatter = dict[str, float]()
        for word in self.scatter:
            name, _, value = word.partition("=")
            try:
                scatter[name] = float(value)
            except ValueError:
                raise ValueError(
                    f"scatter must be NAME=NUMBER, such as restitution=0.05, got {word!r:.60}"
                ) from None
        # Drawn once here, so that a name that is none is refused before anything is computed.
        Uncertain(scatter, samples=self.samples).draw(self.block, self.coefficient)
        return {"scatter": scatter, "samples": self.samples}

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


def _describe_threshold(name: str) -> str:
    """Describe what a block does beyond a threshold, in words that need no formula."""
    words = {"uplift": "lift off an edge", "overturning": "overturn"}
    words["1"] = "rock to the critical angle"
    return words.get(name, f"rock to {name} of the critical angle")
