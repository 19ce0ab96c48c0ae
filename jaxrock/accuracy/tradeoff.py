"""Speed against accuracy, measured on the machine at hand.

A work-precision diagram shows error against time. The dials are the level of fidelity, the
precision, the size of the batch, the adaptive solver, and the tolerance of both. Errors are
relative to the nonlinear closed form where there is one, and else to the adaptive integrator
at a tolerance so strict that a stricter one changes nothing.
"""

import functools
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import respond, respond_batch
from ..ground_motion import HalfSine, Motion, Pulse, Rectangular
from ..host import make_dataset, show_progress
from ..impact import count_half_cycles
from ..resonance import (
    RockingModel,
    Scene,
    as_model,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)
from ..validation import AT_LEAST_ONE, Number, Reals, check
from .cheapest_setting import CLOSED, Setting
from .model_errors import model_error

if TYPE_CHECKING:
    import xarray

_SAMPLE = 8  # scenes by which errors are taken: a single one may be right by chance
_TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-11)
_BATCH_TOLERANCES = {64: (*_TOLERANCES, 1e-13), 32: (1e-3, 1e-5)}
_BATCH = tuple(
    Setting("batch", bits, rtol) for bits, many in _BATCH_TOLERANCES.items() for rtol in many
)
_ADAPTIVE = (
    *(Setting("adaptive", 64, rtol, "Tsit5") for rtol in _TOLERANCES),
    *(Setting("adaptive", 64, rtol, "Dopri8") for rtol in _TOLERANCES),
    *(Setting("adaptive", 32, rtol, "Tsit5") for rtol in (1e-3, 1e-4, 1e-5)),
)
_DEFAULTS = (  # of the functions that compute so, in arrays where these are faster
    replace(CLOSED[0], batch=100_000),
    Setting("batch", 64, 1e-9, batch=1000),
    Setting("adaptive", 64, 1e-8, "Tsit5"),
    Setting("adaptive", 32, 1e-5, "Tsit5"),
)


class _Driven(NamedTuple):
    """What `respond` takes first."""

    block: Block
    restitution: Number
    motion: Motion


def measure_tradeoff(
    scene: Scene | tuple | None = None, *, repeats: int = 15
) -> "xarray.Dataset":
    """Measure the error and the time of every combination of level, solver and precision.

    Parameters
    ----------
    scene : Scene or tuple, optional
        A single scene, or the block, restitution and motion of `respond`. By default a block
        under a short half-sine pulse.
    repeats : int
        Number of times that each setting is timed, after compilation.

    Returns
    -------
    xarray.Dataset
        Has the dimension setting and the variables label, level, bits, rtol, solver, batch,
        default, error, seconds (median time per answer), spread (interquartile range
        of the time over its median), behind and front. ``behind`` compares a setting with all
        settings of its batch that are at least as accurate: it is the time of the setting
        over the shortest of their times. ``front`` is 1 where
        ``behind`` is 1 and the error is finite.

    Raises
    ------
    ValueError
        If JAX is not set to 64 bits, or if the scene holds arrays or does not rock.

    Notes
    -----
    The error is the largest over eight scenes whose sizes differ by up to 5 %. It is the
    error of rotation ratio and period for a `Scene`, and of the peak rotation under a
    motion. A single pulse that changes the ground velocity is also treated as
    instantaneous, in closed form. Progress is shown if standard error is a terminal.
    """
    if jnp.result_type(float) != jnp.float64:
        raise ValueError("JAX must be set to 64 bits, which are the reference, got 32 bits")
    check("repeats", repeats, AT_LEAST_ONE)
    # By default a pulse so short that every level of fidelity can tell of it.
    given = cast(Scene | tuple, scene or (Block(0.4, 5.0), 0.7, HalfSine(40.0, 0.01)))
    scene = given if isinstance(given, Scene) else _Driven(*given)
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((scene.block, scene.restitution))):
        raise ValueError("scene must be a single scene, got arrays of numbers")
    # The truth first: a scene that does not rock is refused before anything else compiles.
    truth, floor = _compute_truth(scene)
    if not (np.isfinite(truth) & (truth > 0)).all():
        raise ValueError("scene must be one in which the block rocks and does not overturn")
    settings = _list_settings(scene)
    calls: list[Callable[[], object]] = []
    errors: list[float] = []
    for setting in show_progress(settings, "compiling"):
        (timed,) = _vary_size(scene, setting, setting.batch)
        calls.append(
            functools.partial(_compute_answer, setting, _choose_duration(scene), timed)
        )
        _measure_seconds(calls[-1])
        error = float(np.max(np.abs(_compute_sample(setting, scene) / truth - 1)))
        # Nothing is known to be more accurate than the truth; an answer that is not finite is
        # wrong.
        errors.append(max(error, floor) if math.isfinite(error) else math.inf)
    # In turn, so that what else the machine does meets all alike.
    rounds = show_progress(range(repeats), "timing")
    seconds = np.array([[_measure_seconds(call) for call in calls] for _ in rounds])
    dataset = tabulate_tradeoff(settings, np.array(errors), seconds)
    return dataset.assign_attrs(scene=type(scene).__name__.strip("_"), reference_error=floor)


def _measure_seconds(call: Callable[[], object]) -> float:
    """Measure how long a call takes [s]."""
    begin = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - begin


def _list_settings(scene: Scene | _Driven) -> list[Setting]:
    """List every setting that the scene has."""
    if isinstance(scene, Scene):
        pairs = itertools.product((1, 1000, 100_000), CLOSED)
    else:
        has_area = isinstance(scene.motion, Pulse) and type(scene.motion).area
        pairs = itertools.product((1, 1000), (*(CLOSED if has_area else ()), *_BATCH))
    return [*(replace(setting, batch=size) for size, setting in pairs), *_ADAPTIVE]


def _choose_duration(scene: Scene | _Driven) -> float:
    """Choose how long to follow the block [s]."""
    # Of a `Scene` until its half-cycle is over for sure; after a pulse until the block has
    # come to rest, or has at least passed its peak; of other motions to their end.
    rate = scene.block.frequency_parameter
    if isinstance(scene, Scene):
        return float(1000 / rate)
    return float(scene.motion.end + (20 / rate if isinstance(scene.motion, Pulse) else 0))


def _compute_sample(setting: Setting, scene: Scene | _Driven) -> np.ndarray:
    """Compute the answers for scenes of slightly different sizes."""
    compute = functools.partial(_compute_answer, setting, _choose_duration(scene))
    answers = [compute(varied) for varied in _vary_size(scene, setting, _SAMPLE)]
    return np.stack(answers, axis=-1, dtype=float).reshape(-1, _SAMPLE)


def _compute_answer(
    setting: Setting, duration: float, scene: Scene | _Driven
) -> Reals | np.ndarray:
    """Compute rotation ratio and period of a `Scene`, or peak rotation under a motion."""
    if setting.level not in ("batch", "adaptive"):
        return _compute_closed_form(scene, as_model(setting.level))
    if isinstance(scene, _Driven):
        given = scene.block, scene.restitution, scene.motion, duration
        if setting.level == "batch":
            return respond_batch(*given, rtol=setting.rtol).peak_rotation
        response = respond(*given, rtol=setting.rtol, solver=setting.solver)
        return np.where(response.overturned, np.nan, response.peak_rotation)
    # The half-cycle begins at the stabilized velocity on ground that stands still. With C = 0
    # no other one follows it.
    zero = jnp.zeros_like(scene.restitution)
    given = scene.block, zero, Rectangular(zero, zero + 1), duration
    options = {"rtol": setting.rtol, "solver": setting.solver}
    response = respond(*given, velocity=stabilized_velocity(scene), **options)
    period = count_half_cycles(scene.block) * response.impact_times[0]
    return np.stack([response.peak_rotation / scene.block.critical_angle, period])


@functools.partial(jax.jit, static_argnames="model")
def _compute_closed_form(scene: Scene | _Driven, model: RockingModel) -> Reals:
    """Compute the same answers in closed form; a pulse is taken as instantaneous."""
    if isinstance(scene, Scene):
        return jnp.stack([rotation_ratio(scene, model), stabilized_period(scene, model)])
    intensity = cast(Pulse, scene.motion).intensity
    return model.peak_rotation(scene.block, scene.block.pulse_velocity(intensity))


def _vary_size(scene: Scene | _Driven, setting: Setting, number: int) -> list[Scene | _Driven]:
    """Vary the size of the block by up to 5 %: in one scene, or for the integrator in many."""
    factors = np.linspace(0.95, 1.05, number)
    scene = jax.tree.map(lambda leaf: jnp.asarray(leaf, f"float{setting.bits}"), scene)
    widths = scene.block.half_width * jnp.asarray(factors, scene.block.half_width.dtype)
    parts = widths if setting.level == "adaptive" else [widths]
    return [eqx.tree_at(lambda s: s.block.half_width, scene, part) for part in parts]


def _compute_truth(scene: Scene | _Driven) -> tuple[np.ndarray, float]:
    """Compute the answers about the sample, and the error below which none is told apart."""
    if isinstance(scene, Scene):
        rounding = model_error(scene).rounding["nonlinear"][64]
        floor = max(float(rounding.rotation_ratio), float(rounding.period))
        return _compute_sample(Setting("nonlinear", 64), scene), floor
    # A stricter tolerance changes as much as rounding does.
    settings = (Setting("adaptive", 64, rtol, "Tsit5") for rtol in (1e-11, 1e-12))
    before, truth = (_compute_sample(setting, scene) for setting in settings)
    return truth, max(
        float(np.max(np.abs(before / truth - 1))), 4 * float(np.finfo(float).eps)
    )


def tabulate_tradeoff(
    settings: Sequence[Setting], error: np.ndarray, calls: np.ndarray
) -> "xarray.Dataset":
    """Tabulate settings with their errors, times of all calls [s], and the front among them."""
    low, median, high = np.quantile(calls, [0.25, 0.5, 0.75], axis=0)
    batch = np.array([setting.batch for setting in settings])
    seconds = median / batch
    # The Pareto front by brute force: each setting against all of its batch, which are few.
    enough = (error[:, None] <= error) & (batch[:, None] == batch)  # no less accurate
    behind = seconds / np.where(enough, seconds[:, None], np.inf).min(axis=0)
    columns = {
        "label": np.array([str(setting) for setting in settings]),
        **{name: np.array([vars(s)[name] for s in settings]) for name in vars(settings[0])},
        "default": np.array([setting in _DEFAULTS for setting in settings], np.int8),
        "error": error,
        "seconds": seconds,
        "spread": (high - low) / median,
        "behind": behind,
        "front": ((behind == 1) & np.isfinite(error)).astype(np.int8),
    }
    variables = {}
    for name, values in columns.items():
        described = {"long_name": name}
        if values.dtype.kind != "U":
            described["units"] = "s" if name == "seconds" else "1"
        variables[name] = ("setting", values, described)
    machine = {"device": jax.devices()[0].device_kind, "jax": jax.__version__}
    return make_dataset("Speed against accuracy", variables, {}, machine)
