"""One block, or one scene, assessed by both models, as numbers and as text."""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from .. import resonance
from ..accuracy import choose
from ..block import RECTANGLE_INERTIA_RATIO, SIZES_IN_WORDS, Block, size_of
from ..host import map_in_threads
from ..impact import count_half_cycles, housner_restitution, one_sided_restitution
from ..resonance import Linearized, Nonlinear, RockingModel, Scene
from ..validation import Number, check_concrete, check_kind

_HALF_CYCLES = {"1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "unlimited": math.inf}
# Numbers and texts by their names, and more of these.
Answers = dict[str, Any]
Program = Callable[..., Answers]

_PARAMETERS = ("restitution", "slenderness", "half_width", "intensity")
# Heads of the columns.
_HEADS = f"{'':38}{'linearized':>14}{'nonlinear':>14}{'error':>10}"
# Labels of the text, and the places of their numbers in the answers; a heading has no place.
_ROWS = (
    ("half-diagonal R [m]", "scene.half_diagonal"),
    ("critical angle alpha_c [rad]", "scene.critical_angle"),
    ("frequency parameter p [1/s]", "scene.frequency_parameter"),
    ("Housner's restitution [-]", "scene.housner_restitution"),
    ("restitution by the wall [-]", "scene.one_sided_restitution"),
    ("launch velocity (Eq. 2) [rad/s]", "scene.launch_velocity"),
    (_HEADS, ""),
    ("critical velocity [rad/s]", "critical_velocity"),
    ("after one pulse", ""),
    ("peak rotation [rad]", "single_pulse.peak_rotation"),
    ("peak / alpha_c [-]", "single_pulse.rotation_ratio"),
    ("half-cycle [s]", "single_pulse.half_cycle_duration"),
    ("unlimited pulses, each right after an impact", ""),
    ("overturning margin [-]", "overturning_margin"),
    ("overturns in half-cycle [-]", "overturning_half_cycle"),
    ("peak rotation [rad]", "stabilized.peak_rotation"),
    ("rotation ratio [-]", "stabilized.rotation_ratio"),
    ("period T* [s]", "stabilized.period"),
    ("amplification zeta [-]", "stabilized.amplification"),
    ("pulses that just overturn it, in half-cycles", ""),
    *((f"{count} [m/s]", f"critical_intensity.{count}") for count in _HALF_CYCLES),
)
# Sizes of a block, by which the answers are differentiated: labels, and units of derivatives.
_SHAPE = {
    "slenderness": ("slenderness at this width", "-"),
    "half_width": (SIZES_IN_WORDS["half_width"], "1/m"),
}
_SIDES = {
    "width_at_this_height": (SIZES_IN_WORDS["width"], "1/m"),
    "height_at_this_width": (SIZES_IN_WORDS["height"], "1/m"),
}


def assess_block(block: Block, restitution: Number) -> Answers:
    """Compute geometry and critical intensities of a block, without a given intensity.

    Parameters
    ----------
    block : Block
        A single block.
    restitution : float
        Coefficient of restitution [-].

    Returns
    -------
    dict
        The dictionary of `assess`, except answers that depend on the intensity of the pulses.

    Raises
    ------
    ValueError
        If the block or the restitution are arrays.

    Examples
    --------
    >>> import jaxrock as jr
    >>> answers = jr.reports.assess_block(jr.Block(half_width=0.4, slenderness=5.0), 0.7)
    >>> print(f"{answers['models']['nonlinear']['critical_intensity']['1']:.2f} m/s")
    1.04 m/s
    """
    check_kind("block", block, Block)
    # An intensity that nothing here reads.
    scene = Scene(block, restitution, 0.0)
    _require_single("block and restitution", scene)
    return _run_programs(scene, _describe_block, _compute_limits)


def assess(scene: Scene, tolerance: float | None = None) -> Answers:
    """Compute geometry, first response, stabilized phase, critical intensities, sensitivities.

    Parameters
    ----------
    scene : Scene
        A single scene: all its values are numbers.
    tolerance : float, optional
        Allowed relative error. If given, the answer also names the cheapest equation and
        precision within this error; see `choose`.

    Returns
    -------
    dict
        A nested dictionary of numbers, NaN where a quantity does not exist. ``scene`` has the
        quantities that do not depend on the model, ``models`` the answers of each model, and
        ``linearization_error`` the answers of `Linearized` over those of `Nonlinear`, minus 1.
        With a tolerance there is ``choice``, which has text as well.

    Raises
    ------
    ValueError
        If `scene` holds arrays.

    See Also
    --------
    jaxrock.reports.assess_block : without pulses of a given intensity.

    Examples
    --------
    >>> import jaxrock as jr
    >>> answers = jr.assess(jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15))
    >>> print(f"{answers['models']['nonlinear']['stabilized']['period']:.3f} s")
    1.111 s
    """
    check_kind("scene", scene, Scene)
    check_concrete(scene, "an assessment has plain numbers, which are printed")
    _require_single("scene", scene)
    result = _run_programs(scene, _describe_scene, _compute_answers)
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


def _require_single(name: str, scene: Scene) -> None:
    """Raise `ValueError` for a scene that holds arrays."""
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(scene)))
    if shape:
        raise ValueError(f"{name} must be single to be assessed, got an array of {shape}")


def _run_programs(scene: Scene, describe: Program, compute: Program) -> Answers:
    """Describe a scene, compute the answers of both models, and compare these."""
    programs = _compile_programs(jax.tree.map(jax.typeof, scene), describe, compute)
    answers = [program(scene) for program in programs]
    described, *models = jax.tree.map(float, jax.device_get(answers))
    # JAX has sorted the labels as text: "10" stood before "2".
    for model in models:
        by_label = model["critical_intensity"]
        model["critical_intensity"] = {label: by_label[label] for label in _HALF_CYCLES}
    compared = ("critical_velocity", "single_pulse", "stabilized", "critical_intensity")
    return {
        "scene": described,
        "models": dict(zip(("linearized", "nonlinear"), models, strict=True)),
        "linearization_error": jax.tree.map(
            lambda simple, full: simple / full - 1 if full else math.nan,
            *({key: model[key] for key in compared if key in model} for model in models),
        ),
    }


@functools.cache
def _compile_programs(scene: Scene, describe: Program, compute: Program) -> list[Program]:
    """Compile side by side the programs for a scene whose leaves are types.

    A program is kept: a second scene of the same types is assessed at once.
    """
    models = (functools.partial(compute, model=model) for model in (Linearized(), Nonlinear()))
    lowered = [jax.jit(part).lower(scene) for part in (describe, *models)]
    # Each program runs for an instant: the time that it takes to compile counts, and not how
    # fast it is then. Without optimization and fusion XLA is done soonest.
    options: Any = {"xla_backend_optimization_level": 0, "xla_disable_hlo_passes": "fusion"}
    return map_in_threads(
        lambda part: part.compile(compiler_options=options), lowered, len(lowered)
    )


def _describe_block(scene: Scene) -> Answers:
    """Collect the block and its restitution, which the models have in common."""
    block = scene.block
    names = (
        "slenderness",
        "half_diagonal",
        "critical_angle",
        "frequency_parameter",
        "gravity",
        "inertia_ratio",
    )
    by_size = (
        {"one_sided_restitution": one_sided_restitution(block)}
        if block.one_sided
        else {"housner_restitution": housner_restitution(block)}
    )
    return {
        **{name: size_of(block, "sides")[name] for name in ("width", "height")},
        **{name: getattr(block, name) for name in names},
        "restitution": scene.restitution,
        **by_size,
    }


def _describe_scene(scene: Scene) -> Answers:
    """Collect what the models have in common: the block, the pulses, velocities after them."""
    return {
        **_describe_block(scene),
        "intensity": scene.intensity,
        "launch_velocity": resonance.launch_velocity(scene),
        "stabilized_velocity": resonance.stabilized_velocity(scene),
    }


def _compute_limits(scene: Scene, model: RockingModel) -> Answers:
    """Compute what just overturns the block, of one model."""
    half_cycles = jnp.asarray([*_HALF_CYCLES.values()])
    critical = resonance.critical_intensity(scene.block, scene.restitution, half_cycles, model)
    return {
        "critical_velocity": model.critical_velocity(scene.block),
        "critical_intensity": dict(zip(_HALF_CYCLES, critical, strict=True)),
    }


def _compute_answers(scene: Scene, model: RockingModel) -> Answers:
    """Compute the answers of one model, NaN where a quantity does not exist."""
    block = scene.block
    ratio, gradient = jax.value_and_grad(resonance.rotation_ratio)(scene, model)
    margin = resonance.overturning_margin(scene, model)
    derivatives = {}
    elasticities = {}
    for name in _PARAMETERS:
        # A parameter belongs to the scene or to its block; the gradient is a scene as well.
        value, derivative = (
            getattr(tree if hasattr(tree, name) else tree.block, name)
            for tree in (scene, gradient)
        )
        # Beyond the overturning threshold the ratio is NaN, and its derivative 0 by
        # convention.
        derivatives[name] = jnp.where(margin > 0, derivative, jnp.nan)
        elasticities[name] = derivatives[name] * value / ratio
    # The sides are w = 2 b and h = lambda w. With a wider base at this height the slenderness
    # falls, and with more height at this width only the slenderness grows.
    width = size_of(block, "sides")["width"]
    slenderness = block.slenderness
    of_slenderness = derivatives["slenderness"]
    derivatives["width_at_this_height"] = (
        derivatives["half_width"] / 2 - of_slenderness * slenderness / width
    )
    derivatives["height_at_this_width"] = of_slenderness / width
    elasticities["width_at_this_height"] = (
        elasticities["half_width"] - elasticities["slenderness"]
    )
    elasticities["height_at_this_width"] = elasticities["slenderness"]
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
        "elasticities": elasticities,
    }


def write_text(result: Answers, *, by_sides: bool = False, restitution: str = "") -> str:
    """Write the answers of `assess` or `assess_block` as a page to read.

    Rows of which no model has an answer are left out.

    Parameters
    ----------
    result : dict
        From `assess` or `assess_block`.
    by_sides : bool
        Whether sensitivities are with respect to width and height, each while the other
        stays, instead of half-width and slenderness.
    restitution : str
        The restitution in words. The number alone if not given.

    Returns
    -------
    str
    """
    scene = result["scene"]
    models = result["models"]
    # What the models have in common stands in the first column only.
    columns = ({"scene": scene} | models["linearized"], models["nonlinear"])
    *columns, errors = map(_flatten, (*columns, result["linearization_error"]))
    lines = [_write_title(scene, restitution or f"C = {scene['restitution']:.6g}"), ""]
    heading = None
    for label, place in (*_ROWS, *_list_sensitivity_rows(by_sides)):
        if not place:
            # It is written with the first row below it, if there is one.
            heading = label
            continue
        numbers = [column[place] for column in columns if place in column]
        if all(map(math.isnan, numbers)):
            continue
        if heading is not None:
            lines += ["", heading] if heading == _HEADS else [heading]
            heading = None
        line = f"  {label:36}"
        for number in numbers:
            never = place == "overturning_half_cycle" and math.isinf(number)
            shown = "never" if never else "none" if math.isnan(number) else f"{number:.6g}"
            line += f"{shown:>14}"
        # Some rows have no errors, and errors of what does not exist are NaN: nothing is
        # printed.
        error = errors.get(place, math.nan)
        lines.append(line + (f"{f'{100 * error:+.2f} %':>10}" if math.isfinite(error) else ""))
    lines += ["", _write_verdict(models["nonlinear"])]
    if "choice" in result:
        lines += ["", f"To {result['choice']['tolerance']:g}: {result['choice']['reason']}"]
    return "\n".join(lines)


def _write_title(scene: Answers, restitution: str) -> str:
    """Write which block this is, its restitution, and the pulses if there are any."""
    # Only of a rectangle the height is known; of another body, the centre of mass.
    outline = f"{scene['height']:.6g} m high (slenderness {scene['slenderness']:.6g})"
    if not math.isclose(scene["inertia_ratio"], RECTANGLE_INERTIA_RATIO, rel_tol=1e-6):
        outline = (
            f"centre of mass {scene['height'] / 2:.6g} m high"
            f" (slenderness {scene['slenderness']:.6g}), inertia ratio {scene['inertia_ratio']:.6g}"
        )
    wall = ", one-sided" if "one_sided_restitution" in scene else ""
    pulses = f", pulses of {scene['intensity']:.6g} m/s" if "intensity" in scene else ""
    return f"Block {scene['width']:.6g} m wide, {outline}{wall}, {restitution}{pulses}"


def _write_verdict(answers: Answers) -> str:
    """Write the outcome under the pulses; without any, which pulses overturn the block."""
    if "overturning_half_cycle" not in answers:
        critical = answers["critical_intensity"]
        return (
            f"A single pulse overturns it above {critical['1']:.3g} m/s (nonlinear). Unlimited"
            f" pulses do above {critical['unlimited']:.3g} m/s, each right after an impact."
        )
    half_cycle = answers["overturning_half_cycle"]
    if math.isinf(half_cycle):
        percentage = 100 * answers["stabilized"]["rotation_ratio"]
        return (
            f"Stands (nonlinear): the rocking settles at {percentage:.3g} % of the critical"
            " angle."
        )
    return f"Overturns in half-cycle {half_cycle:.0f} (nonlinear): no stabilized phase."


def _list_sensitivity_rows(by_sides: bool) -> list[tuple[str, str]]:
    """List the rows of derivatives and elasticities, as those of `_ROWS`."""
    parameters = {
        "restitution": ("restitution C", "-"),
        **(_SIDES if by_sides else _SHAPE),
        "intensity": ("intensity I", "s/m"),
    }
    rows = [("derivative of the rotation ratio with respect to", "")]
    rows += [
        (f"{label} [{unit}]", f"derivatives.{n}") for n, (label, unit) in parameters.items()
    ]
    rows.append(("elasticity of the rotation ratio with respect to", ""))
    rows += [(f"{label} [-]", f"elasticities.{n}") for n, (label, _) in parameters.items()]
    return rows


def _flatten(nested: Answers) -> dict[str, float]:
    """List the numbers of nested answers by their places, such as ``stabilized.period``."""
    leaves = jax.tree.leaves_with_path(nested)
    return {jax.tree_util.keystr(at, simple=True, separator="."): leaf for at, leaf in leaves}
