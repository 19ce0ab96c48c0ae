"""The command about the numbers that an answer depends on."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..sensitivity import (
    MomentEstimate,
    Uncertain,
    propagate,
    sensitivities,
    tornado,
    value_and_slopes,
)
from ..tables import write_csv
from ..validation import Number, Reals
from .command import Answer, Folder, Steps, save_picture
from .dependence_options import UNITS_OF_NUMBERS
from .driven_dependence import DrivenDependence

# Samples that check moments.
_SAMPLES = 1024
_OF_BARS = ("low", "high", "at_low", "at_high")


class Sensitivity(DrivenDependence):
    """Dependence of an answer: probabilities of outcomes, derivatives, a tornado.

    Of the resonance under instantaneous pulses: derivatives, elasticities, a tornado, the
    effect of uncertainty. Writes sensitivity.csv, tornado.png and map.png: the elasticity to
    the restitution over slenderness and restitution.

    With a pulse, a record or a suite: the probabilities that the block rocks and overturns,
    Sobol indices, and derivatives of the probabilities with respect to the median and the
    coefficient of variation of each parameter. Under one motion also a tornado, and derivatives
    of the answer where they are meaningful, as `jaxrock.sensitivity.local_dependence` decides.
    Writes sensitivity.csv, probabilities.csv, probabilities.png and tornado.png.

    With a height, the numbers are the width at this height and the height at this width. Else
    they are the half-width at this slenderness and the slenderness.

    Example: jaxrock sensitivity --answer rotation-ratio --restitution 0.7
    """

    command = "sensitivity"

    out: Folder = Path("sensitivity")

    def _carry_out(self) -> Steps:
        at = self.collect_numbers()
        if self.shaken:
            folder = yield self.name_driven_files()
            return self.answer_driven(at, folder)
        folder = yield ("sensitivity.csv", "tornado.png", "map.png")
        from ..plot import plot_tornado

        sides = self.name_sides()
        slopes = replace(sensitivities(self.compute_answer, at), sides=sides)
        if not math.isfinite(slopes.value):
            raise ValueError(self.refuse_answer(at))
        ranges = self.make_ranges(at)
        bars = replace(tornado(self.compute_answer, at, ranges), sides=sides)
        coefficients = dict.fromkeys(at, self.coefficient_of_variation)
        uncertain = Uncertain(coefficients, samples=_SAMPLES)
        moments = propagate(self.compute_answer, at, uncertain)
        # The bars begin with the longest, the slopes go by the order of the numbers.
        order = [bars.names.index(name) for name in slopes.names]
        columns = {
            "quantity": list(slopes.names),
            "unit": [UNITS_OF_NUMBERS.get(name, "-") for name in slopes.names],
            "value": slopes.at,
            "derivative": slopes.gradient,
            "elasticity": slopes.elasticity,
            **{name: np.asarray(getattr(bars, name))[order] for name in _OF_BARS},
            "fraction_of_variance": [
                moments.variance_fractions[name] for name in slopes.names
            ],
        }
        columns = {name: np.asarray(column).tolist() for name, column in columns.items()}
        rows = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        write_csv(folder / "sensitivity.csv", columns, {}, self.about)
        save_picture(plot_tornado(bars, label=self.axis_label), folder / "tornado.png")
        self._draw_map(at, folder / "map.png")
        text = (
            f"{self.answer_name} {slopes}\n{self.write_sizes()}; by the {self.model_name}"
            f" model;\n{self._write_moments(moments)}"
        )
        values = {
            name: getattr(moments, name) if moments.within_tolerance else None
            for name in ("mean", "standard_deviation")
        }
        data = {"answer": self.answer_name, "model": self.model_name, "value": slopes.value}
        return Answer(
            text, data | values | {"within_tolerance": moments.within_tolerance, "rows": rows}
        )

    def _write_moments(self, moments: MomentEstimate) -> str:
        """Write mean and standard deviation, or why there are none to be trusted."""
        given = f"with a coefficient of variation of {self.coefficient_of_variation:g} in each"
        if moments.within_tolerance:
            return f"{given}: {moments.mean:.6g} +- {moments.standard_deviation:.3g}"
        if moments.left_out:
            return f"{given}, {moments.left_out:.1%} of samples overturn: there is no mean"
        return f"{given}, slopes and curvatures do not describe the answer: no mean is given"

    def _draw_map(self, at: dict[str, float], path: Path) -> None:
        """Draw the elasticity with respect to the restitution, over it and the slenderness."""
        import xarray

        from ..plot import plot_sensitivity_map

        # Over the slenderness of blocks that are as wide, by whichever numbers they are given.
        half_width = float(self.block.half_width)
        others = {name: at[name] for name in ("intensity",) if name in at}
        label = self.answer_name.replace("-", " ")

        def compute_answer(c: Number, slenderness: Number) -> Reals:
            """Compute the answer at a restitution and a slenderness."""
            size = {"half_width": half_width, "slenderness": slenderness}
            return self.compute_answer({**size, "restitution": c, **others})

        c = np.linspace(0.3, 0.95, 521)
        slenderness = np.linspace(3, 10, 561)
        # So fine that the edge of the hatched area is a smooth line at the resolution of the
        # file.
        value, slope = value_and_slopes(compute_answer, mask_beyond=True)(
            c[:, None], slenderness[None]
        )
        elasticity = np.asarray(slope * c[:, None] / value)
        axes = [("restitution", c), ("slenderness", slenderness)]
        named = {
            "units": "1",
            "long_name": f"elasticity of {label} with respect to restitution",
        }
        ax = plot_sensitivity_map(xarray.DataArray(elasticity, axes, attrs=named))
        pulse = f"$I$ = {others['intensity']:g} m/s, " if others else ""
        title = f"{2 * half_width:g} m wide, {pulse}{self.model_name}"
        ax.set_title(title, fontsize="medium")
        save_picture(ax, path)
