"""One block, or one scene, assessed by both models: a result that is a nested dictionary."""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp

from .. import resonance
from ..block import Block, size_of
from ..host import Printed, format_table
from ..impact import (
    count_half_cycles,
    describe_scene,
    housner_restitution,
    one_sided_restitution,
)
from ..resonance import Linearized, Nonlinear, RockingModel, Scene
from ..validation import Number, check_concrete, check_kind

_HALF_CYCLES = {"1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "unlimited": math.inf}
_DURATIONS = (0.2, 0.5, 1.0)  # s, of steady pushes
_MODELS = {"linearized": Linearized(), "nonlinear": Nonlinear()}
# Parts of the answers that depend on the model.
_COMPARED = ("critical_velocity", "single_pulse", "stabilized", "critical_intensity")


class Assessment(Printed, dict[str, Any]):
    """Answers of `assess`: nested dictionaries of numbers.

    ``scene`` has the quantities that do not depend on the model, ``models`` the answers of each
    model, NaN where a quantity does not exist, and ``linearization_error`` the answers of
    `Linearized` over those of `Nonlinear`, minus 1.
    """

    def __init__(self, block: Block, answers: dict[str, Any]):
        super().__init__(answers)
        self.block = block

    def __str__(self) -> str:
        scene, answers = self["scene"], self["models"]["nonlinear"]
        assumed = scene.get("restitution_assumed", False)
        title = describe_scene(self.block, None if assumed else scene["restitution"])
        # Housner's rectangular pulse, doi:10.1785/BSSA0530020403, of a slender block.
        growths = {t: -math.expm1(-scene["frequency_parameter"] * t) for t in _DURATIONS}
        pushes = {
            t: scene["gravity"] * scene["critical_angle"] / x for t, x in growths.items()
        }
        critical = answers["critical_intensity"]
        lines = [
            title,
            f"lifts from {_write_acceleration(scene['gravity'] / scene['slenderness'])} on",
            *(
                f"overturns under {_write_acceleration(a)} held for {t:g} s"
                for t, a in pushes.items()
            ),
            f"overturns under one pulse of {critical['1']:.3g} m/s",
            f"overturns under pulses of {critical['unlimited']:.3g} m/s, one after each impact",
        ]
        if "single_pulse" in answers:
            peaks = [
                answers[name]["rotation_ratio"] for name in ("single_pulse", "stabilized")
            ]
            first, last = (f"{100 * x:.3g} % of the critical angle" for x in peaks)
            half_cycle = answers["overturning_half_cycle"]
            outcome = f"it stands, and settles at {last}"
            if math.isfinite(half_cycle):
                outcome = f"it overturns in half-cycle {half_cycle:.0f}"
            pulses = f"pulses of {scene['intensity']:.3g} m/s, one after each impact"
            lines.append(f"{pulses}: {first} after the first; {outcome}")
        return "\n".join(lines)

    def details(self) -> str:
        """Write all numbers, of both models side by side.

        Returns
        -------
        str
        """
        linearized, nonlinear = (_flatten(model) for model in self["models"].values())
        errors = _flatten(self["linearization_error"])
        names = [n for n in linearized if not math.isnan(linearized[n] * nonlinear[n])]
        columns = {
            "linearized": [linearized[name] for name in names],
            "nonlinear": [nonlinear[name] for name in names],
            "error": [f"{100 * errors[n]:+.2f} %" if n in errors else "" for n in names],
        }
        described = _flatten(self["scene"])
        scene = format_table("\nthe scene, in SI", list(described), value=described.values())
        labels = [name.replace("s:", "s of the rotation ratio:") for name in names]
        return f"{self}\n{scene}\n{format_table('', labels, **columns)}"


def assess(block: Block, restitution: Number, intensity: Number | None = None) -> Assessment:
    """Compute geometry, critical intensities and, for an intensity, the response to pulses.

    Parameters
    ----------
    block : Block
        A single block.
    restitution : float
        Coefficient of restitution C [-].
    intensity : float, optional
        Change of ground velocity in each pulse, I [m/s]. If given, the answer also has the
        first response, the stabilized phase and their sensitivities.

    Returns
    -------
    Assessment

    Raises
    ------
    ValueError
        If an argument is an array, or out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> answers = jr.reports.assess(block, 0.7)
    >>> print(f"{answers['models']['nonlinear']['critical_intensity']['1']:.2f} m/s")
    1.04 m/s
    >>> answers = jr.reports.assess(block, 0.7, intensity=0.15)
    >>> print(f"{answers['models']['nonlinear']['stabilized']['period']:.3f} s")
    1.111 s
    """
    check_kind("block", block, Block)
    # Without an intensity, nothing here reads that of the scene.
    scene = Scene(block, restitution, 0.0 if intensity is None else intensity)
    check_concrete(scene, "an assessment has plain numbers, which are printed")
    return _assess(scene, with_pulses=intensity is not None)


def _assess(scene: Scene, with_pulses: bool) -> Assessment:
    """Describe a single scene, compute the answers of both models, and compare these."""
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(scene)))
    if shape:
        raise ValueError(f"block must be single to be assessed, got an array of {shape}")
    answers = jax.tree.map(float, jax.device_get(_compute(scene, with_pulses)))
    for model in answers["models"].values():
        # JAX has sorted the labels as text: "10" stood before "2".
        by_label = model["critical_intensity"]
        model["critical_intensity"] = {label: by_label[label] for label in _HALF_CYCLES}
    simple, full = (
        {key: model[key] for key in _COMPARED if key in model}
        for model in answers["models"].values()
    )
    answers["linearization_error"] = jax.tree.map(
        lambda x, y: x / y - 1 if y else math.nan, simple, full
    )
    return Assessment(scene.block, answers)


@functools.partial(jax.jit, static_argnames="with_pulses")
def _compute(scene: Scene, with_pulses: bool) -> dict[str, Any]:
    """Compute all numbers in one program."""
    block = scene.block
    names = ("slenderness", "half_diagonal", "critical_angle", "frequency_parameter")
    described = {name: getattr(block, name) for name in (*names, "gravity", "inertia_ratio")}
    described |= {name: size_of(block, "sides")[name] for name in ("width", "height")}
    described["restitution"] = scene.restitution
    if block.one_sided:
        described["one_sided_restitution"] = one_sided_restitution(block)
    else:
        described["housner_restitution"] = housner_restitution(block)
    if with_pulses:
        described["intensity"] = scene.intensity
        described["launch_velocity"] = resonance.launch_velocity(scene)
        described["stabilized_velocity"] = resonance.stabilized_velocity(scene)
    compute = _compute_answers if with_pulses else _compute_limits
    models = {name: compute(scene, model) for name, model in _MODELS.items()}
    return {"scene": described, "models": models}


def _compute_limits(scene: Scene, model: RockingModel) -> dict[str, Any]:
    """Compute what just overturns the block, of one model."""
    half_cycles = jnp.asarray([*_HALF_CYCLES.values()])
    critical = resonance.critical_intensity(scene.block, scene.restitution, half_cycles, model)
    return {
        "critical_velocity": model.critical_velocity(scene.block),
        "critical_intensity": dict(zip(_HALF_CYCLES, critical, strict=True)),
    }


def _compute_answers(scene: Scene, model: RockingModel) -> dict[str, Any]:
    """Compute the answers of one model, NaN where a quantity does not exist."""
    block = scene.block
    ratio, gradient = jax.value_and_grad(resonance.rotation_ratio)(scene, model)
    margin = resonance.overturning_margin(scene, model)
    sizes = size_of(block, "sides")
    width, slenderness = sizes["width"], block.slenderness
    by_slenderness, by_half_width = gradient.block.slenderness, gradient.block.half_width
    # The sides are w = 2 b and h = lambda w. With a wider base at this height the slenderness
    # falls, and with more height at this width only the slenderness grows.
    slopes = {
        "restitution": (scene.restitution, gradient.restitution),
        "slenderness": (slenderness, by_slenderness),
        "half_width": (block.half_width, by_half_width),
        "intensity": (scene.intensity, gradient.intensity),
        "width_at_this_height": (
            width, by_half_width / 2 - by_slenderness * slenderness / width
        ),
        "height_at_this_width": (sizes["height"], by_slenderness / width),
    }  # fmt: skip
    # Beyond the overturning threshold the ratio is NaN, and its derivative 0 by convention.
    derivatives = {
        n: jnp.where(margin > 0, slope, jnp.nan) for n, (_, slope) in slopes.items()
    }
    peak = model.peak_rotation(block, resonance.launch_velocity(scene))
    # With a restitution of 0 the block rests after each half-cycle: its period consists of
    # half-cycles as after a single pulse. Both go through one program.
    restitutions = jnp.stack([jnp.zeros_like(scene.restitution), scene.restitution])
    periods = resonance.stabilized_period(Scene(block, restitutions, scene.intensity), model)
    return {
        **_compute_limits(scene, model),
        "single_pulse": {
            "peak_rotation": peak,
            "rotation_ratio": peak / block.critical_angle,
            "half_cycle_duration": periods[0] / count_half_cycles(block),
        },
        "overturning_margin": margin,
        "overturning_half_cycle": resonance.overturning_half_cycle(scene, model),
        "stabilized": {
            "peak_rotation": ratio * block.critical_angle,
            "rotation_ratio": ratio,
            "period": periods[1],
            "amplification": resonance.amplification(scene, model),
        },
        "derivatives": derivatives,
        "elasticities": {
            n: derivatives[n] * value / ratio for n, (value, _) in slopes.items()
        },
    }


def _flatten(nested: dict[str, Any], above: str = "") -> dict[str, float]:
    """List the numbers of nested answers by their paths, such as ``stabilized: period``."""
    flat: dict[str, float] = {}
    for key, value in nested.items():
        name = f"{above}{key.replace('_', ' ')}"
        flat |= _flatten(value, f"{name}: ") if isinstance(value, dict) else {name: value}
    return flat


def _write_acceleration(value: float) -> str:
    """Write an acceleration, also in g."""
    return f"{value:.3g} m/s2 ({value / 9.81:.3g} g)"
