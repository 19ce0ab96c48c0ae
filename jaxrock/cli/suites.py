"""The command about suites of records."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..grids import write_table
from ..ground_motion import MEASURES, Suite
from ..host import format_table
from ..risk import (
    Hazard,
    Site,
    fragility,
    name_thresholds,
    overturning_rate,
    rate_elasticities,
)
from ..sensitivity import Uncertain
from ..validation import POSITIVE, as_real, check, check_increasing
from .command import Answer, Count, Folder, Grid, ModelName, Steps, save_picture
from .options import BlockOptions, SuiteOptions
from .storing import Storing

if TYPE_CHECKING:
    import xarray


class Fragility(SuiteOptions, BlockOptions, Storing):
    """Fragility of a block under a suite of records; with a hazard, the rate of overturning.

    Writes fragility.nc, fragility.csv and fragility.png: the probability that each
    threshold is exceeded at each level, with intervals and lognormal curves.

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
    uncertain: tuple[str, ...] = ()
    """Coefficients of variation of uncertain parameters, as in restitution=0.05 width=0.02."""
    samples: Count = 64
    """Samples of uncertain parameters, a power of 2."""
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
            check_increasing("levels", levels)
        # Every record must have some of the measure, or it could not be scaled to a level.
        suite.factors(1.0, self.measure, block)
        hazard = self.read_hazard(self.measure)
        site = None if hazard is None else Site(suite, hazard, self.measure)
        uncertain = self._read_uncertain()
        options = {"tolerance": self.tolerance, "model": self.model, "uncertain": uncertain}
        curves_of = functools.partial(
            fragility, block, c, suite, levels, self.measure, thresholds, **options
        )
        answer = functools.partial(self._make_answer, suite, levels, site, uncertain)
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
        self,
        suite: Suite,
        levels: np.ndarray,
        site: Site | None,
        uncertain: Uncertain | None,
        curves: "xarray.Dataset",
    ) -> Answer:
        """Describe the curves, and with a hazard the rate as well."""
        chaotic = 1 - float(curves.within_tolerance.mean())
        medians = {
            "median": curves["lognormal_median"].values,
            "dispersion": curves["lognormal_dispersion"].values,
        }
        _, unit, _ = MEASURES[self.measure]
        names = [str(name) for name in curves.threshold.values]
        descriptions = [_describe_threshold(name) for name in names]
        unit = "" if unit == "1" else f" {unit}"
        lines = [
            f"{suite}, {levels.size} levels of {self.measure}, {levels[0]:.4g} to"
            f" {levels[-1]:.4g}{unit}",
            format_table(
                f"level of {self.measure} at which half of the records make the block ...",
                descriptions,
                **{f"median{unit and f' [{unit.strip()}]'}": medians["median"]},
                dispersion=medians["dispersion"],
            ),
        ]
        lines += [
            f"{words}: {remark}"
            for words, remark in zip(descriptions, curves.remark.values, strict=True)
            if remark
        ]
        if chaotic:
            lines.append(f"{chaotic:.1%} of the responses are not within the tolerance")
        data: dict[str, object] = {
            "records": len(suite),
            "thresholds": names,
            **{name: values.tolist() for name, values in medians.items()},
            "remarks": curves.remark.values.tolist(),
            "fraction_within_tolerance": 1 - chaotic,
        }
        if uncertain is not None:
            parts = {
                name.removeprefix("dispersion_"): curves[name].values
                for name in ("dispersion_of_records", "dispersion_of_parameters")
            }
            lines.append(format_table("dispersion by its causes", descriptions, **parts))
            data |= {f"dispersion_{name}": part.tolist() for name, part in parts.items()}
        if site is not None:
            text, rates = self._describe_rate(site, uncertain)
            lines.append(text)
            data |= rates
        return Answer("\n".join(lines), data)

    def _describe_rate(
        self, site: Site, uncertain: Uncertain | None
    ) -> tuple[str, dict[str, object]]:
        """Describe the rate of overturning, what it depends on, and its uncertainty."""
        block = self.block
        c = self.coefficient
        # Of a block that is given by its sides, these are what can be changed.
        by = "shape" if self.height is None else "sides"
        elasticities = rate_elasticities(block, c, site, model=self.model, by=by)
        rate = elasticities.rate
        lines = [f"{rate}\n{elasticities}"]
        assert isinstance(site.hazard, Hazard)
        if site.hazard.statistic:
            lines.insert(0, str(site.hazard))
        names = elasticities.names
        data: dict[str, object] = {
            "hazard": str(site.hazard),
            "rate": float(rate.rate),
            "standard_error": float(rate.standard_error),
            "not_detected": float(rate.not_detected),
            "complete": bool(rate.complete),
            "elasticities": dict(zip(names, elasticities.over_change.tolist(), strict=True)),
            "elasticities_at_point": dict(
                zip(names, elasticities.at_point.tolist(), strict=True)
            ),
        }
        if uncertain is not None:
            mean = overturning_rate(block, c, site, uncertain, model=self.model)
            lines.append(f"with uncertain parameters: {mean}")
            data["rate_with_uncertainty"] = float(mean.rate)
        return "\n".join(lines), data

    def _read_uncertain(self) -> Uncertain | None:
        """Read what is uncertain; None without any."""
        if not self.uncertain:
            self.refuse("samples", only_with="uncertain")
            return None
        coefficients = dict[str, float]()
        for word in self.uncertain:
            name, _, value = word.partition("=")
            try:
                coefficients[name] = float(value)
            except ValueError:
                raise ValueError(
                    f"uncertain must be NAME=NUMBER, such as restitution=0.05, got {word!r:.60}"
                ) from None
        uncertain = Uncertain(coefficients, samples=self.samples)
        # Drawn once here, so that a name that is none is refused before anything is computed.
        uncertain.draw(self.block, self.coefficient)
        return uncertain

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
