"""The command about the numbers that an answer depends on."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np

from .. import resonance
from ..block import Block
from ..driven import respond
from ..ground_motion import PULSES, Motion
from ..host import write_csv
from ..overturning import UNITS
from ..sensitivity import propagate, sensitivities, tornado, value_and_slopes
from ..validation import NON_NEGATIVE, POSITIVE, Number, Reals, check
from .command import Answer, Folder, ModelName, Steps, Writing, save_picture
from .options import BlockOptions, MotionOptions

AnswerName = Literal[
    "rotation-ratio", "rotation", "period", "amplification", "margin", "critical-intensity"
]

_UNITS_OF_ANSWERS = {"rotation": "rad", "period": "s", "critical-intensity": "m/s"}
_OF_BARS = ("low", "high", "at_low", "at_high")
_UNITS_OF_NUMBERS = {**UNITS, "intensity": "m/s", "pulse_duration": "s"}


class Sensitivity(MotionOptions, BlockOptions, Writing):
    """Dependence of an answer: slopes, elasticities, a tornado, the effect of scatter.

    Of the resonance under instantaneous pulses, or with a pulse or a record of the peak
    rotation over the critical angle or the margin at the end of the input. Writes
    sensitivity.csv and tornado.png, and without a pulse or record map.png: the elasticity to
    the restitution over slenderness and restitution.

    Example: jaxrock sensitivity --answer rotation-ratio --restitution 0.7
    """

    command = "sensitivity"

    answer: AnswerName | None = None
    """Answer to examine; by default the critical intensity, under a pulse or record the ratio."""
    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    model: ModelName | None = None
    """Equation of motion; by default nonlinear under a pulse or a record, else linearized."""
    relative_change: float = 0.1
    """Share by which the tornado lowers and raises numbers."""
    coefficient_of_variation: float = 0.05
    """Coefficient of variation of each number."""
    out: Folder = Path("sensitivity")

    @property
    def _answer(self) -> AnswerName:
        """The answer that is examined."""
        return self.answer or ("rotation-ratio" if self.shaken else "critical-intensity")

    def _collect_numbers(self) -> dict[str, float]:
        """Check the options, and collect the numbers that the answer depends on, by name."""
        block = self.block
        at = {"half_width": float(block.half_width), "slenderness": float(block.slenderness)}
        at["restitution"] = self.coefficient
        check("intensity", self.intensity, NON_NEGATIVE)
        check("relative_change", self.relative_change, POSITIVE)
        if self.relative_change >= 1:
            raise ValueError(
                f"relative_change must be less than 1, got {self.relative_change:g}"
            )
        check("coefficient_of_variation", self.coefficient_of_variation, POSITIVE)
        if not self.shaken:
            if self._answer == "critical-intensity":
                self.refuse(
                    "intensity", only_with="another answer than the critical intensity"
                )
                return at
            return at | {"intensity": self.intensity}
        self.refuse("intensity", only_with="instantaneous pulses")
        if self._answer not in ("rotation-ratio", "rotation", "margin"):
            raise ValueError(
                "answer must be rotation-ratio, rotation or margin under a pulse or a record,"
                f" got {self._answer}"
            )
        motion: Any = self.motion
        if self.pulse is None:
            return at | {"scale": self.scale}
        # The amplitude of the motion has the factor on it already.
        return at | {
            "amplitude": float(motion.amplitude),
            "pulse_duration": float(motion.duration),
        }

    @property
    def _model(self) -> ModelName:
        """The equation of motion."""
        return self.model or ("nonlinear" if self.shaken else "linearized")

    def _compute_answer(self, at: Mapping[str, Number]) -> Reals:
        """Compute the answer from the numbers that it depends on, which may be traced."""
        block = Block(at["half_width"], at["slenderness"], self.gravity, self.inertia_ratio)
        c = at["restitution"]
        model = self._model
        if not self.shaken:
            if self._answer == "critical-intensity":
                return resonance.critical_intensity(block, c, math.inf, model)
            return _OF_SCENE[self._answer](resonance.Scene(block, c, at["intensity"]), model)
        if self.pulse is None:
            motion: Motion = replace(self, scale=1.0).motion.scaled(at["scale"])
        else:
            motion = PULSES[self.pulse](at["amplitude"], at["pulse_duration"])
        # A peak may come after the input. The margin is known at its end, by energy.
        duration = motion.end + (0.0 if self._answer == "margin" else 10.0)
        response = respond(block, c, motion, duration, model=model)
        if self._answer == "margin":
            return response.margin
        # A block that has fallen lies where nothing changes: its peak is no answer.
        peak = jnp.where(response.overturned, jnp.nan, response.peak_rotation)
        return peak / block.critical_angle if self._answer == "rotation-ratio" else peak

    def _carry_out(self) -> Steps:
        at = self._collect_numbers()
        names = ("sensitivity.csv", "tornado.png")
        folder = yield names if self.shaken else (*names, "map.png")
        from ..plot import plot_tornado

        slopes = sensitivities(self._compute_answer, at)
        if not math.isfinite(slopes.value):
            given = f"restitution {at['restitution']:.4g}"
            given += "" if self.shaken else f" and {at['intensity']:g} m/s"
            raise ValueError(
                f"answer {self._answer} does not exist here: the block overturns at {given}"
            )
        low = 1 - self.relative_change
        high = 1 + self.relative_change
        ranges = {name: (value * low, value * high) for name, value in at.items()}
        # Beyond 1 an impact would give energy to the block.
        ranges["restitution"] = (at["restitution"] * low, min(at["restitution"] * high, 1.0))
        bars = tornado(self._compute_answer, at, ranges)
        samples = 200 if self.shaken else 1000  # each an integration under a pulse or a record
        variation = dict.fromkeys(at, self.coefficient_of_variation)
        scatter = propagate(self._compute_answer, at, variation, samples)
        # The bars begin with the longest, the slopes go by the order of the numbers.
        order = [bars.names.index(name) for name in slopes.names]
        columns = {
            "quantity": list(slopes.names),
            "unit": [_UNITS_OF_NUMBERS.get(name, "-") for name in slopes.names],
            "value": slopes.at,
            "slope": slopes.gradient,
            "elasticity": slopes.elasticity,
            **{name: np.asarray(getattr(bars, name))[order] for name in _OF_BARS},
            "share_of_variance": [scatter.shares[name] for name in slopes.names],
        }
        columns = {name: np.asarray(column).tolist() for name, column in columns.items()}
        rows = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        write_csv(folder / "sensitivity.csv", columns, {}, self.about)
        label = self._answer.replace("-", " ")
        unit = _UNITS_OF_ANSWERS.get(self._answer, "-")
        save_picture(plot_tornado(bars, label=f"{label} [{unit}]"), folder / "tornado.png")
        if not self.shaken:
            self._draw_map(at, folder / "map.png", label)
        text = (
            f"{self._answer} {slopes}\nby the {self._model} model;"
            f" with a coefficient of variation of {100 * self.coefficient_of_variation:g} % in"
            f" each: {scatter.mean:.6g} +- {scatter.standard_deviation:.3g}"
        )
        if not scatter.valid:
            text += ", NOT to be trusted: samples differ"
        moments = {
            name: getattr(scatter, name) for name in ("mean", "standard_deviation", "valid")
        }
        data = {"answer": self._answer, "model": self._model, "value": slopes.value, **moments}
        return Answer(text, data | {"rows": rows})

    def _draw_map(self, at: dict[str, float], path: Path, label: str) -> None:
        """Draw the elasticity with respect to the restitution, over it and the slenderness."""
        import xarray

        from ..plot import plot_sensitivity_map

        def compute_answer(c: Number, slenderness: Number) -> Reals:
            """Compute the answer at a restitution and a slenderness."""
            return self._compute_answer(at | {"restitution": c, "slenderness": slenderness})

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
        pulse = (
            "" if self._answer == "critical-intensity" else f"$I$ = {at['intensity']:g} m/s, "
        )
        title = f"{2 * at['half_width']:g} m wide, {pulse}{self._model}"
        ax.set_title(title, fontsize="medium")
        save_picture(ax, path)


_OF_SCENE = {
    "rotation-ratio": resonance.rotation_ratio,
    "rotation": resonance.stabilized_rotation,
    "period": resonance.stabilized_period,
    "amplification": resonance.amplification,
    "margin": resonance.overturning_margin,
}
