"""Everything about one scene, by both models, as numbers and as text."""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ..accuracy import choose
from ..host import mapped
from ..impact import housner_restitution
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
        Relative; adds which equation and precision keep it; see `choose`.

    Returns
    -------
    dict
        Nested, of numbers, NaN where a quantity does not exist: ``scene``, which the models
        share, ``models`` with the answers of each, ``linearization_error``, the ratio of
        `Linearized` to `Nonlinear` less 1, and with a tolerance ``choice``, also of text.

    Raises
    ------
    ValueError
        If `scene` holds arrays.
    """
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(scene)))
    if shape:
        raise ValueError(f"scene must be a single one to be assessed, got an array of {shape}")
    types = tuple(jax.typeof(leaf) for leaf in jax.tree.leaves(scene))
    answers = [program(scene) for program in _programs(types, jax.tree.structure(scene))]
    described, linearized, nonlinear = jax.tree.map(float, jax.device_get(answers))
    for model in (linearized, nonlinear):  # whose labels JAX has sorted as text
        by_label = model["critical_intensity"]
        model["critical_intensity"] = {label: by_label[label] for label in HALF_CYCLES}
    compared = ("critical_velocity", "single_pulse", "stabilized", "critical_intensity")
    result: dict[str, Any] = {
        "scene": described,
        "models": {"linearized": linearized, "nonlinear": nonlinear},
        "linearization_error": {
            key: jax.tree.map(
                lambda simple, full: simple / full - 1 if full else math.nan,
                linearized[key],
                nonlinear[key],
            )
            for key in compared
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


@functools.cache
def _programs(types: tuple[Any, ...], structure: Any) -> list[Callable[[Scene], Any]]:
    """The programs for a scene of these types, compiled side by side.

    Each runs once, so what counts is how long it takes to compile.
    """
    scene = jax.tree.unflatten(structure, types)
    parts = [
        _described,
        *(functools.partial(_answers, model=m) for m in (Linearized(), Nonlinear())),
    ]
    lowered = [jax.jit(part).lower(scene) for part in parts]
    options: Any = {"xla_backend_optimization_level": 0, "xla_disable_hlo_passes": "fusion"}
    return mapped(lambda part: part.compile(compiler_options=options), lowered, len(lowered))


def _described(scene: Scene) -> dict[str, Any]:
    block = scene.block
    names = ["slenderness", "half_diagonal", "critical_angle", "frequency_parameter", "gravity"]
    return {
        "width": 2 * block.half_width,
        "height": 2 * block.half_height,
        **{name: getattr(block, name) for name in names},
        "restitution": scene.restitution,
        "housner_restitution": housner_restitution(block),
        "intensity": scene.intensity,
        "launch_velocity": launch_velocity(scene),
        "stabilized_velocity": stabilized_velocity(scene),
    }


def _answers(scene: Scene, model: RockingModel) -> dict[str, Any]:
    block, velocity = scene.block, launch_velocity(scene)
    ratio, slopes = jax.value_and_grad(rotation_ratio)(scene, model)
    margin = overturning_margin(scene, model)
    derivatives, elasticities = {}, {}
    for name, value, slope in (
        ("restitution", scene.restitution, slopes.restitution),
        ("slenderness", block.slenderness, slopes.block.slenderness),
        ("half_width", block.half_width, slopes.block.half_width),
        ("intensity", scene.intensity, slopes.intensity),
    ):
        derivatives[name] = jnp.where(margin > 0, slope, jnp.nan)
        elasticities[name] = jnp.where(margin > 0, slope * value / ratio, jnp.nan)
    peak = model.peak_rotation(block, velocity)
    half_cycles = jnp.asarray([float(n.replace("unlimited", "inf")) for n in HALF_CYCLES])
    critical = critical_intensity(block, scene.restitution, half_cycles, model)
    # A single pulse is what is left of all without restitution; compiled once for both.
    restitutions = jnp.stack([jnp.zeros_like(scene.restitution), scene.restitution])
    periods = stabilized_period(Scene(block, restitutions, scene.intensity), model)
    return {
        "critical_velocity": model.critical_velocity(block),
        "single_pulse": {
            "peak_rotation": peak,
            "rotation_ratio": peak / block.critical_angle,
            "half_cycle_duration": periods[0] / 2,
        },
        "overturning_margin": margin,
        "overturning_half_cycle": overturning_half_cycle(scene, model),
        "stabilized": {
            "peak_rotation": ratio * block.critical_angle,
            "rotation_ratio": ratio,
            "period": periods[1],
            "amplification": amplification(scene, model),
        },
        "critical_intensity": dict(zip(HALF_CYCLES, critical, strict=True)),
        "derivatives": derivatives,
        "elasticities": elasticities,
    }


def text(result: dict[str, Any]) -> str:
    """The answers of `assess` as a page to read."""
    scene, models = result["scene"], result["models"]
    columns = (models["linearized"], models["nonlinear"], result["linearization_error"])
    lines = [
        f"Block {scene['width']:.6g} m wide, {scene['height']:.6g} m high"
        f" (slenderness {scene['slenderness']:.6g}), C = {scene['restitution']:.6g},"
        f" pulses of {scene['intensity']:.6g} m/s",
        "",
    ]
    lines += [f"  {label:32}{_number(scene[key]):>14}" for label, key in _SCENE_ROWS]
    lines += ["", f"{'':34}{'linearized':>14}{'nonlinear':>14}{'error':>10}"]
    for label, *path in _ROWS:
        if not path:
            lines.append(label)
            continue
        values = [_at(column, path) for column in columns]
        numbers = [_number(value) for value in values[:2]]
        if path == ["overturning_half_cycle"]:
            numbers = [number.replace("inf", "never") for number in numbers]
        error = f"{100 * values[2]:+.2f} %" if math.isfinite(values[2]) else ""
        lines.append(f"  {label:32}{numbers[0]:>14}{numbers[1]:>14}{error:>10}".rstrip())
    lines += ["", _verdict(models["nonlinear"])]
    if "choice" in result:
        lines += ["", f"To {result['choice']['tolerance']:g}: {result['choice']['reason']}"]
    return "\n".join(lines)


_SCENE_ROWS = (
    ("half-diagonal R [m]", "half_diagonal"),
    ("critical angle alpha_c [rad]", "critical_angle"),
    ("frequency parameter p [1/s]", "frequency_parameter"),
    ("Housner's restitution [-]", "housner_restitution"),
    ("launch velocity (Eq. 2) [rad/s]", "launch_velocity"),
)
# Label and where in the answers of a model; headings without.
_ROWS = (
    ("critical velocity [rad/s]", "critical_velocity"),
    ("after one pulse",),
    ("peak rotation [rad]", "single_pulse", "peak_rotation"),
    ("peak / alpha_c [-]", "single_pulse", "rotation_ratio"),
    ("half-cycle [s]", "single_pulse", "half_cycle_duration"),
    ("pulses without end",),
    ("overturning margin [-]", "overturning_margin"),
    ("overturns in half-cycle [-]", "overturning_half_cycle"),
    ("peak rotation [rad]", "stabilized", "peak_rotation"),
    ("rotation ratio [-]", "stabilized", "rotation_ratio"),
    ("period T* [s]", "stabilized", "period"),
    ("amplification zeta [-]", "stabilized", "amplification"),
    ("critical intensity, in half-cycles",),
    *((f"{count} [m/s]", "critical_intensity", count) for count in HALF_CYCLES),
    ("derivative of the rotation ratio with respect to",),
    ("restitution C [-]", "derivatives", "restitution"),
    ("slenderness lambda [-]", "derivatives", "slenderness"),
    ("half_width b [1/m]", "derivatives", "half_width"),
    ("intensity I [s/m]", "derivatives", "intensity"),
    ("elasticity of the rotation ratio with respect to",),
    ("restitution C [-]", "elasticities", "restitution"),
    ("slenderness lambda [-]", "elasticities", "slenderness"),
    ("half_width b [-]", "elasticities", "half_width"),
    ("intensity I [-]", "elasticities", "intensity"),
)


def _at(values: Any, path: list[str]) -> float:
    """The value at a path in nested answers; NaN if there is none."""
    for key in path:
        values = values.get(key, {})
    return values if isinstance(values, float) else math.nan


def _number(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.6g}"


def _verdict(answers: dict[str, Any]) -> str:
    half_cycle = answers["overturning_half_cycle"]
    if math.isfinite(half_cycle):
        return f"Overturns in half-cycle {half_cycle:.0f} (nonlinear): no stabilized phase."
    ratio = answers["stabilized"]["rotation_ratio"]
    return f"Stands (nonlinear): the rocking settles at {100 * ratio:.3g} % of the critical angle."
