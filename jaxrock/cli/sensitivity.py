"""``jaxrock sensitivity``."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from .. import resonance
from ..block import Block
from ..dynamics import respond
from ..sensitivity import (
    MomentEstimate,
    Sensitivities,
    TornadoBars,
    propagate,
    sensitivities,
    tornado,
)
from ..validation import NON_NEGATIVE, POSITIVE, check
from .options import Answer, BlockOptions, ModelName, MotionOptions, Writing
from .output import Row, picture, rows_of, write_rows

if TYPE_CHECKING:
    import xarray

_Question = Callable[[Mapping[str, Any]], Any]  # the answer as a function of its numbers

_OF_SCENE = {
    "rotation-ratio": resonance.rotation_ratio,
    "rotation": resonance.stabilized_rotation,
    "period": resonance.stabilized_period,
    "amplification": resonance.amplification,
    "margin": resonance.overturning_margin,
}
_DRIVEN = ("rotation-ratio", "rotation", "margin")


@dataclass(frozen=True, kw_only=True)
class Sensitivity(MotionOptions, BlockOptions, Writing):
    """What an answer depends on: slopes, elasticities, a tornado, the effect of scatter.

    Of the resonance under instantaneous pulses, or with a pulse or a record of the peak
    rotation over the critical angle or the margin at the end of the input. Writes
    sensitivity.csv and tornado.png, and without a pulse or record map.png: the elasticity to
    the restitution over slenderness and restitution.

    Example: jaxrock sensitivity --answer rotation-ratio --swing 0.1
    """

    FILES = ("sensitivity.csv", "tornado.png")

    answer: Literal[
        "rotation-ratio", "rotation", "period", "amplification", "margin", "critical-intensity"
    ] = "rotation-ratio"
    """The quantity to examine."""
    restitution: float | None = 0.7
    """Velocity after an impact over velocity before it [-], 0 to 1."""
    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    model: ModelName | None = None
    """Equation of motion; by default nonlinear under a pulse or a record, else linearized."""
    swing: float = 0.1
    """Part of itself by which each number is lowered and raised in the tornado."""
    coefficient_of_variation: float = 0.05
    """Coefficient of variation of each number."""
    out: Path = Path("sensitivity")

    @property
    def names(self) -> Sequence[str]:
        """A map in closed form only, besides the files that are always written."""
        return self.FILES if self.shaken else [*self.FILES, "map.png"]

    @property
    def chosen_model(self) -> ModelName:
        """The equation of motion."""
        return self.model or ("nonlinear" if self.shaken else "linearized")

    def check(self) -> None:
        """The question, the ranges, the block and the files."""
        _ = self.coefficient  # which has a block
        check("intensity", self.intensity, NON_NEGATIVE)
        check("swing", self.swing, POSITIVE)
        if self.swing >= 1:
            raise ValueError(f"swing must be less than 1, got {self.swing:g}")
        check("coefficient_of_variation", self.coefficient_of_variation, POSITIVE)
        if not self.shaken:
            self.refuse_motion()
        else:
            self.refuse("intensity", only_with="instantaneous pulses")
            if self.answer not in _DRIVEN:
                raise ValueError(
                    f"answer must be {', '.join(_DRIVEN[:-1])} or {_DRIVEN[-1]} under a pulse or"
                    f" a record, got {self.answer}"
                )
            _ = self.motion
        super().check()

    def run(self) -> Answer:
        """Differentiate, swing and scatter."""
        at, question = self._question()
        slopes = sensitivities(question, at)
        if not math.isfinite(slopes.value):
            raise ValueError(f"answer {self.answer} does not exist here: the block overturns")
        low, high = 1 - self.swing, 1 + self.swing
        ranges = {name: (value * low, value * high) for name, value in at.items()}
        ranges["restitution"] = (ranges["restitution"][0], min(ranges["restitution"][1], 1.0))
        swings = tornado(question, at, ranges)
        samples = 200 if self.shaken else 1000  # each an integration under a pulse or a record
        variation = dict.fromkeys(at, self.coefficient_of_variation)
        scatter = propagate(question, at, variation, samples)
        rows = _rows(slopes, swings, scatter)
        self._write(rows, swings, question, at)
        data = {
            "answer": self.answer,
            "model": self.chosen_model,
            "value": slopes.value,
            "mean": scatter.mean,
            "standard_deviation": scatter.standard_deviation,
            "valid": scatter.valid,
            "rows": rows,
        }
        text = (
            f"{self.answer} {slopes}\nby the {self.chosen_model} model;"
            f" with a coefficient of variation of {100 * self.coefficient_of_variation:g} % in"
            f" each: {scatter.mean:.6g} +- {scatter.standard_deviation:.3g}"
        )
        if not scatter.valid:
            text += ", NOT to be trusted: samples differ"
        return self.finished(text, data)

    def _question(self) -> tuple[dict[str, float], _Question]:
        """The numbers that the answer depends on, and the answer as a function of them."""
        at = {
            "half_width": float(self.block.half_width),
            "slenderness": float(self.block.slenderness),
            "restitution": self.coefficient,
        }
        if not self.shaken:
            return at | {"intensity": self.intensity}, self._in_closed_form
        if self.pulse is None:
            record = replace(self, scale=1.0).motion
            at["scale"] = self.scale
            return at, lambda at: self._driven(at, record.scaled(at["scale"]))
        pulse: Any = self.motion
        at |= {"amplitude": float(pulse.amplitude), "pulse_duration": float(pulse.duration)}
        return at, lambda at: self._driven(at, type(pulse)(at["amplitude"], at["pulse_duration"]))

    def _in_closed_form(self, at: Mapping[str, Any]) -> Any:
        block = Block(at["half_width"], at["slenderness"], self.gravity)
        c, model = at["restitution"], self.chosen_model
        if self.answer == "critical-intensity":
            return resonance.critical_intensity(block, c, math.inf, model)
        return _OF_SCENE[self.answer](resonance.Scene(block, c, at["intensity"]), model)

    def _driven(self, at: Mapping[str, Any], motion: Any) -> Any:
        block = Block(at["half_width"], at["slenderness"], self.gravity)
        duration = motion.end + (0.0 if self.answer == "margin" else 10.0)
        response = respond(block, at["restitution"], motion, duration, model=self.chosen_model)
        if self.answer == "margin":
            return response.margin
        peak = jnp.where(response.overturned, jnp.nan, response.peak_rotation)
        return peak / block.critical_angle if self.answer == "rotation-ratio" else peak

    def _write(
        self, rows: list[Row], swings: TornadoBars, question: _Question, at: dict[str, float]
    ) -> None:
        from ..plot import plot_sensitivity_map, plot_tornado

        label = self.answer.replace("-", " ")
        with self.written() as scratch:
            write_rows(rows, scratch / "sensitivity.csv", list(rows[0]))
            picture(lambda ax: plot_tornado(swings, ax, label=label), scratch / "tornado.png")
            if not self.shaken:
                elasticity = _elasticity(question, at)
                elasticity.attrs["long_name"] = f"elasticity of {label} to the restitution"
                picture(lambda ax: plot_sensitivity_map(elasticity, ax), scratch / "map.png")


def _rows(slopes: Sensitivities, swings: TornadoBars, scatter: MomentEstimate) -> list[Row]:
    order = [swings.names.index(name) for name in slopes.names]  # the tornado has its own
    return rows_of(
        quantity=slopes.names,
        value=slopes.at,
        slope=slopes.gradient,
        elasticity=slopes.elasticity,
        low=swings.low[order],
        high=swings.high[order],
        at_low=swings.at_low[order],
        at_high=swings.at_high[order],
        share_of_variance=[scatter.shares[name] for name in slopes.names],
    )


def _elasticity(question: _Question, at: dict[str, float]) -> "xarray.DataArray":
    """The elasticity to the restitution over restitution and slenderness."""
    import xarray

    axes = {"restitution": np.linspace(0.3, 0.95, 66), "slenderness": np.linspace(3, 10, 71)}

    def elasticity(restitution: Any, slenderness: Any) -> Any:
        value, slope = jax.value_and_grad(
            lambda c: question(at | {"restitution": c, "slenderness": slenderness})
        )(restitution)
        return jnp.where(jnp.isfinite(value), slope * restitution / value, jnp.nan)

    over_both = jax.jit(jax.vmap(jax.vmap(elasticity, (None, 0)), (0, None)))
    table = over_both(*(jnp.asarray(axis) for axis in axes.values()))
    return xarray.DataArray(np.asarray(table), axes, tuple(axes), attrs={"units": "1"})
