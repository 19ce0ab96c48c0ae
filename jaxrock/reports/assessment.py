"""Everything about one scene, by both models, as numbers and as text."""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ..accuracy import choose
from ..block import housner_restitution
from ..host import mapped
from ..resonance import (
    Linearized,
    Nonlinear,
    RockingModel,
    Scene,
    amplification,
    critical_intensity,
    launch_velocity,
    overturning_half_cycle,
    overturning_margin,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)

HALF_CYCLES = ("1", "2", "5", "10", "unlimited")


def assess(scene: Scene, tolerance: float | None = None) -> dict[str, Any]:
    """Geometry, single pulse, stabilized phase, critical intensities and sensitivities.

    Parameters
    ----------
    scene : Scene
        A single scene: all its values are numbers.
    tolerance : float, optional
        Say as well which equation and precision keep it; see `choose`.

    Returns
    -------
    dict
        Nested, of numbers with NaN where a quantity does not exist; ``scene`` holds what both
        models share, ``models`` the answers of each, ``linearization_error`` what `Linearized`
        says relative to `Nonlinear`, less 1; with a tolerance ``choice``, of numbers and text.

    Raises
    ------
    ValueError
        If `scene` holds arrays.
    """
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(scene)))
    if shape:
        raise ValueError(f"scene must be a single one to be assessed, got an array of {shape}")
    form = tuple(jax.typeof(leaf) for leaf in jax.tree.leaves(scene))
    found = [program(scene) for program in _programs(form, jax.tree.structure(scene))]
    given, linearized, nonlinear = jax.tree.map(float, jax.device_get(found))
    for answers in (linearized, nonlinear):
        by_label = answers["critical_intensity"]  # which JAX has sorted as text
        answers["critical_intensity"] = {label: by_label[label] for label in HALF_CYCLES}
    compared = ("critical_velocity", "single_pulse", "stabilized", "critical_intensity")
    result: dict[str, Any] = {
        "scene": given,
        "models": {"linearized": linearized, "nonlinear": nonlinear},
        "linearization_error": {
            key: jax.tree.map(_apart, linearized[key], nonlinear[key]) for key in compared
        },
    }
    if tolerance is not None:
        choice = choose(scene, tolerance)
        result["choice"] = {
            "tolerance": tolerance,
            "level": choice.setting.level,
            "bits": choice.setting.bits,
            "predicted_error": float(choice.error),
            "within_tolerance": bool(choice.within_tolerance),
            "reason": str(choice),
        }
    return result


def _apart(ours: float, full: float) -> float:
    return ours / full - 1 if full else math.nan


@functools.cache
def _programs(form: tuple[Any, ...], structure: Any) -> list[Callable[[Scene], Any]]:
    """What there is to compute about a scene of this form, compiled side by side.

    It runs once: what counts is how long it takes to compile.
    """
    scene = jax.tree.unflatten(structure, form)
    parts = [_given, *(functools.partial(_answers, model=m) for m in (Linearized(), Nonlinear()))]
    lowered = [jax.jit(part).lower(scene) for part in parts]
    options: Any = {"xla_backend_optimization_level": 0, "xla_disable_hlo_passes": "fusion"}
    return mapped(lambda part: part.compile(compiler_options=options), lowered, len(lowered))


def _given(scene: Scene) -> dict[str, Any]:
    block = scene.block
    return {
        "width": 2 * block.half_width,
        "height": 2 * block.half_height,
        "slenderness": block.slenderness,
        "half_diagonal": block.half_diagonal,
        "critical_angle": block.critical_angle,
        "frequency_parameter": block.frequency_parameter,
        "gravity": block.gravity,
        "restitution": scene.restitution,
        "housner_restitution": housner_restitution(block),
        "intensity": scene.intensity,
        "launch_velocity": launch_velocity(scene),
        "stabilized_velocity": stabilized_velocity(scene),
    }


def _answers(scene: Scene, model: RockingModel) -> dict[str, Any]:
    block, velocity = scene.block, launch_velocity(scene)
    ratio, slopes = jax.value_and_grad(rotation_ratio)(scene, model)
    quantities = {
        "restitution": (scene.restitution, slopes.restitution),
        "slenderness": (block.slenderness, slopes.block.slenderness),
        "half_width": (block.half_width, slopes.block.half_width),
        "intensity": (scene.intensity, slopes.intensity),
    }
    stands = overturning_margin(scene, model) > 0
    half_cycles = jnp.asarray([float(n.replace("unlimited", "inf")) for n in HALF_CYCLES])
    critical = critical_intensity(block, scene.restitution, half_cycles, model)
    # A single pulse is what is left of all without restitution; compiled once for both.
    restitutions = jnp.stack([jnp.zeros_like(scene.restitution), scene.restitution])
    periods = stabilized_period(Scene(block, restitutions, scene.intensity), model)
    return {
        "critical_velocity": model.critical_velocity(block),
        "single_pulse": {
            "peak_rotation": model.peak_rotation(block, velocity),
            "rotation_ratio": model.peak_rotation(block, velocity) / block.critical_angle,
            "half_cycle_duration": periods[0] / 2,
        },
        "overturning_margin": overturning_margin(scene, model),
        "overturning_half_cycle": overturning_half_cycle(scene, model),
        "stabilized": {
            "peak_rotation": ratio * block.critical_angle,
            "rotation_ratio": ratio,
            "period": periods[1],
            "amplification": amplification(scene, model),
        },
        "critical_intensity": dict(zip(HALF_CYCLES, critical, strict=True)),
        "derivatives": {
            name: jnp.where(stands, slope, jnp.nan) for name, (_, slope) in quantities.items()
        },
        "elasticities": {
            name: jnp.where(stands, slope * value / ratio, jnp.nan)
            for name, (value, slope) in quantities.items()
        },
    }


def text(result: dict[str, Any]) -> str:
    """The answers of `assess` as a page to read."""
    given, models = result["scene"], result["models"]
    lines = [
        f"Block {given['width']:.6g} m wide, {given['height']:.6g} m high"
        f" (slenderness {given['slenderness']:.6g}), C = {given['restitution']:.6g},"
        f" pulses of {given['intensity']:.6g} m/s",
        "",
        *_rows(
            [
                ("half-diagonal R", given["half_diagonal"], "m"),
                ("critical angle alpha_c", given["critical_angle"], "rad"),
                ("frequency parameter p", given["frequency_parameter"], "1/s"),
                ("Housner's restitution", given["housner_restitution"], "-"),
                ("launch velocity (Eq. 2)", given["launch_velocity"], "rad/s"),
            ]
        ),
        "",
        f"{'':34}{'linearized':>14}{'nonlinear':>14}{'error':>10}",
    ]

    def row(label: str, *path: str, units: str = "-") -> None:
        found = []
        for values in (models["linearized"], models["nonlinear"], result["linearization_error"]):
            for key in path:
                values = values.get(key, math.nan) if isinstance(values, dict) else math.nan
            found.append(values)
        error = f"{100 * found[2]:+.2f} %" if math.isfinite(found[2]) else ""
        numbers = (_number(value) for value in found[:2])
        if path == ("overturning_half_cycle",):
            numbers = (number.replace("inf", "never") for number in numbers)
        columns = "".join(f"{number:>14}" for number in numbers) + f"{error:>10}"
        lines.append(f"  {f'{label} [{units}]':32}{columns}".rstrip())

    row("critical velocity", "critical_velocity", units="rad/s")
    lines.append("after one pulse")
    row("peak rotation", "single_pulse", "peak_rotation", units="rad")
    row("peak / alpha_c", "single_pulse", "rotation_ratio")
    row("half-cycle", "single_pulse", "half_cycle_duration", units="s")
    lines.append("pulses without end")
    row("overturning margin", "overturning_margin")
    row("overturns in half-cycle", "overturning_half_cycle")
    row("peak rotation", "stabilized", "peak_rotation", units="rad")
    row("rotation ratio", "stabilized", "rotation_ratio")
    row("period T*", "stabilized", "period", units="s")
    row("amplification zeta", "stabilized", "amplification")
    lines.append("critical intensity, in half-cycles")
    for n in HALF_CYCLES:
        row(n, "critical_intensity", n, units="m/s")
    lines.append("derivative of the rotation ratio to")
    symbols = {"restitution": "C", "slenderness": "lambda", "half_width": "b", "intensity": "I"}
    units = {"half_width": "1/m", "intensity": "s/m"}
    for name, symbol in symbols.items():
        row(f"{name} {symbol}", "derivatives", name, units=units.get(name, "-"))
    lines.append("elasticity of the rotation ratio to")
    for name, symbol in symbols.items():
        row(f"{name} {symbol}", "elasticities", name)
    lines.append("")
    lines.append(_verdict(models["nonlinear"]))
    if "choice" in result:
        lines += ["", f"To {result['choice']['tolerance']:g}: {result['choice']['reason']}"]
    return "\n".join(lines)


def _rows(rows: list[tuple[str, float, str]]) -> list[str]:
    return [f"  {f'{label} [{units}]':32}{_number(value):>14}" for label, value, units in rows]


def _number(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.6g}"


def _verdict(answers: dict[str, Any]) -> str:
    half_cycle = answers["overturning_half_cycle"]
    if math.isfinite(half_cycle):
        return f"Overturns in half-cycle {half_cycle:.0f} (nonlinear): no stabilized phase."
    ratio = answers["stabilized"]["rotation_ratio"]
    return f"Stands (nonlinear): the rocking settles at {100 * ratio:.3g} % of the critical angle."
