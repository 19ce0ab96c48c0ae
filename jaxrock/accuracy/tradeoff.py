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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import DrivenScene, respond, respond_batch
from ..ground_motion import HalfSine, Pulse, Rectangular
from ..host import Printed, announce, make_dataset, show_progress
from ..impact import count_half_cycles
from ..resonance import (
    Nonlinear,
    RockingModel,
    Scene,
    as_model,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)
from ..validation import Reals
from .cheapest_setting import CLOSED
from .model_errors import model_error

if TYPE_CHECKING:
    import xarray

_SAMPLE = 8  # scenes by which errors are taken: a single one may be right by chance
_TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-11)
_BATCH = (*((64, rtol) for rtol in (*_TOLERANCES, 1e-13)), (32, 1e-3), (32, 1e-5))
_ADAPTIVE = (
    *((64, solver, rtol) for solver in ("Tsit5", "Dopri8") for rtol in _TOLERANCES),
    *((32, "Tsit5", rtol) for rtol in (1e-3, 1e-4, 1e-5)),
)
_LONG_NAMES = {
    "error": "largest relative error",
    "seconds": "time per answer, median",
    "spread": "interquartile range of the time over its median",
    "compilation": "time of the first call, with compilation",
    "behind": "time over the time of the fastest setting at least as accurate",
    "front": "1 on the front of its batch",
    "front_of_level": "1 on the front of its batch and level",
}


@dataclass(frozen=True)
class _Dials:
    """One setting of everything that can be dialled."""

    level: str
    bits: int
    batch: int = 1
    solver: str = "-"
    tolerance: float = math.nan
    default: bool = False

    @property
    def label(self) -> str:
        """The setting in words, without the size of the batch."""
        parts = [self.level, f"float{self.bits}"]
        parts += [self.solver] if self.solver != "-" else []
        parts += [f"rtol {self.tolerance:.0e}"] if self.tolerance > 0 else []
        return ", ".join(parts)


@dataclass(frozen=True, repr=False)
class Tradeoff(Printed):
    """Error and time of each setting; see `measure_tradeoff`.

    Attributes
    ----------
    dataset : xarray.Dataset
        Has the dimension setting and the variables label, level, solver, tolerance, bits,
        batch, default, error, seconds (median time per answer), spread (interquartile range
        of the time over its median), compilation (seconds), behind, front and front_of_level.
        ``behind`` compares a setting with all settings of its batch that are at least as
        accurate: it is the time of the setting over the shortest of their times. ``front`` is
        1 where ``behind`` is 1 and the error is finite. front_of_level is the same among
        settings of one level of fidelity.
    """

    dataset: "xarray.Dataset"

    def best(self, tolerance: float, batch: int | None = None) -> str | None:
        """Name the fastest setting within a relative tolerance.

        Parameters
        ----------
        tolerance, batch : float, int, optional
            Relative tolerance, and size of batch of the settings to consider; all sizes by
            default.

        Returns
        -------
        str or None
            None if no setting is within the tolerance.
        """
        enough = self.dataset.to_dataframe().query("error <= @tolerance")
        enough = enough if batch is None else enough.query("batch == @batch")
        if enough.empty:
            return None
        fastest = enough.sort_values("seconds").iloc[0]
        return f"{fastest.label} ({_format_seconds(fastest.seconds)} per answer)"

    def sentence(self, batch: int | None = None) -> str:
        """Say which setting to use for which accuracy, on this machine.

        Parameters
        ----------
        batch : int, optional
            As in `best`.

        Returns
        -------
        str
        """
        best = {f"{tol:.0e}": self.best(tol, batch) for tol in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)}
        uses = (f"for {t} {f'use {b}' if b else 'nothing is enough'}" for t, b in best.items())
        return "; ".join(uses) + "."

    def notes(self) -> list[str]:
        """List the levels, solvers and precisions that are never on a front.

        Returns
        -------
        list of str
        """
        rows = self.dataset.to_dataframe()
        lines = []
        for dial, name, front in (
            ("level", "the level of fidelity", "front"),
            ("solver", "the solver", "front_of_level"),
            ("bits", "float", "front_of_level"),
        ):
            # A dial says nothing if all of its values are on the front, or none is.
            values = set(rows[dial]) - {"-"}
            never = sorted(values - set(rows[dial][rows[front] == 1]))
            if 0 < len(never) < len(values):
                lines.append(f"never the fastest: {name} {', '.join(map(str, never))}")
        return lines

    def __str__(self) -> str:
        rows = self.dataset.to_dataframe()
        lines = [f"{'error':>8}  {'time':>9}  {'batch':>6}  setting"]
        for _, row in rows.query("front == 1").sort_values(["batch", "seconds"]).iterrows():
            time = _format_seconds(row.seconds)
            lines.append(f"{row.error:8.1e}  {time:>9}  {row.batch:6}  {row.label}")
        lines += [f"batches of {n}: {self.sentence(int(n))}" for n in np.unique(rows.batch)]
        for _, row in rows.query("default == 1").iterrows():
            lines.append(
                f"default in batches of {row.batch}: {row.label}, error {row.error:.1e},"
                f" takes {row.behind:.2f} times as long as the fastest that is as accurate"
            )
        return "\n".join(lines + self.notes())


def measure_tradeoff(
    scene: Scene | DrivenScene | None = None, *, repeats: int = 15
) -> Tradeoff:
    """Measure the error and the time of every combination of level, solver and precision.

    Parameters
    ----------
    scene : Scene or DrivenScene, optional
        A single scene. By default a block under a short half-sine pulse.
    repeats : int
        Number of times that each setting is timed, after compilation.

    Returns
    -------
    Tradeoff

    Raises
    ------
    ValueError
        If JAX is not set to 64 bits, or if the scene holds arrays or does not rock.

    Notes
    -----
    The error is the largest over eight scenes whose sizes differ by up to 5 %. It is the
    error of rotation ratio and period for a `Scene`, and of the peak rotation for a
    `DrivenScene`. A single pulse that changes the ground velocity is also treated as
    instantaneous, in closed form. Progress is shown if standard error is a terminal.
    """
    if jnp.result_type(float) != jnp.float64:
        raise ValueError(
            "JAX must be set to 64 bits, the reference for lower precisions, got 32 bits"
        )
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1, got {repeats}")
    scene = make_default_scene() if scene is None else scene
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((scene.block, scene.restitution))):
        raise ValueError("scene must be a single scene, got arrays of numbers")
    # The truth first: a scene that does not rock is refused before anything else compiles.
    truth, floor = _compute_truth(scene)
    if not (np.isfinite(truth) & (truth > 0)).all():
        raise ValueError("scene must be one in which the block rocks and does not overturn")
    rows: list[dict[str, object]] = []
    calls: list[Callable[[], object]] = []
    for dials in show_progress(_list_settings(scene), "compiling"):
        sample, timed = (_vary_size(scene, number, dials) for number in (_SAMPLE, dials.batch))
        answer = functools.partial(_compute_answer, dials, _choose_duration(scene))
        calls.append(functools.partial(answer, timed[0]))
        begin = time.perf_counter()
        answers = np.stack(
            [answer(varied_scene) for varied_scene in show_progress(sample, dials.label)],
            axis=-1,
            dtype=float,
        )
        jax.block_until_ready(calls[-1]())
        compilation = time.perf_counter() - begin
        error = float(np.max(np.abs(answers.reshape(truth.shape) / truth - 1)))
        # Nothing is known to be more accurate than the truth; an answer that is not finite is
        # wrong.
        error = max(error, floor) if math.isfinite(error) else math.inf
        measured = {"error": error, "compilation": compilation}
        rows.append({"label": dials.label, **asdict(dials), **measured})
    # In turn, so that what else the machine does meets all alike.
    seconds = np.empty((repeats, len(calls)))
    begin_all = time.perf_counter()
    for call in calls:
        jax.block_until_ready(call())
    once = time.perf_counter() - begin_all
    announce(f"timing {len(calls)} settings {repeats} times takes some {repeats * once:.0f} s")
    for repeat, k in show_progress([*np.ndindex(seconds.shape)], "timing"):
        begin = time.perf_counter()
        jax.block_until_ready(calls[k]())
        seconds[repeat, k] = time.perf_counter() - begin
    quartiles = np.quantile(seconds, [0.25, 0.5, 0.75], axis=0).T
    for row, (low, median, high) in zip(rows, quartiles, strict=True):
        row |= {"seconds": median / row["batch"], "spread": (high - low) / median}
    return Tradeoff(_tabulate(rows, scene, floor))


def make_default_scene() -> DrivenScene:
    """Make a block under a pulse so short that every level of fidelity can tell of it."""
    return DrivenScene(Block(0.4, 5.0), 0.7, HalfSine(40.0, 0.01))


def _list_settings(scene: Scene | DrivenScene) -> list[_Dials]:
    """List every setting of the dials that the scene has."""
    driven = isinstance(scene, DrivenScene)
    sizes = (1, 1000) if driven else (1, 1000, 100_000)
    table: list[_Dials] = []
    if not driven or (isinstance(scene.motion, Pulse) and type(scene.motion).area):
        for setting, size in itertools.product(CLOSED, sizes):
            default = not driven and setting == CLOSED[0]  # in JAX's own precision
            table.append(_Dials(setting.level, setting.bits, size, default=default))
    for (bits, rtol), size in itertools.product(_BATCH if driven else (), sizes):
        default = (bits, rtol, size) == (64, 1e-9, sizes[-1])
        table.append(_Dials("batch", bits, size, tolerance=rtol, default=default))
    for bits, solver, rtol in _ADAPTIVE:
        default = (bits, solver, rtol) in ((64, "Tsit5", 1e-8), (32, "Tsit5", 1e-5))
        table.append(_Dials("adaptive", bits, 1, solver, rtol, default=default))
    return table


def _compute_answer(
    dials: _Dials, duration: float, scene: Scene | DrivenScene
) -> Reals | np.ndarray:
    """Compute rotation ratio and period of a `Scene`, or peak rotation of a `DrivenScene`."""
    if dials.level not in ("batch", "adaptive"):
        return _compute_closed_form(scene, as_model(dials.level))
    if isinstance(scene, DrivenScene):
        given = scene.block, scene.restitution, scene.motion, duration
        if dials.level == "batch":
            return respond_batch(*given, rtol=dials.tolerance).peak_rotation
        response = respond(*given, rtol=dials.tolerance, solver=dials.solver)
        return np.where(response.overturned, np.nan, response.peak_rotation)
    # The half-cycle begins at the stabilized velocity on ground that stands still. With C = 0
    # no other one follows it.
    zero = jnp.zeros_like(scene.restitution)
    still = Rectangular(zero, zero + 1)
    velocity = stabilized_velocity(scene)
    settings = {"rtol": dials.tolerance, "solver": dials.solver}
    response = respond(scene.block, zero, still, duration, velocity=velocity, **settings)
    period = count_half_cycles(scene.block) * response.impact_times[0]
    return np.stack([response.peak_rotation / scene.block.critical_angle, period])


@functools.partial(jax.jit, static_argnames="model")
def _compute_closed_form(scene: Scene | DrivenScene, model: RockingModel) -> Reals:
    """Compute the same answers in closed form; a pulse is taken as instantaneous."""
    if isinstance(scene, Scene):
        return jnp.stack([rotation_ratio(scene, model), stabilized_period(scene, model)])
    intensity = cast(Pulse, scene.motion).intensity
    return model.peak_rotation(scene.block, scene.block.pulse_velocity(intensity))


def _choose_duration(scene: Scene | DrivenScene) -> float:
    """Choose how long to follow the block [s]."""
    # Of a `Scene` until its half-cycle is over for sure; after a pulse until the block has
    # come to rest, or has at least passed its peak; of other motions to their end.
    if isinstance(scene, Scene):
        return float(1000 / scene.block.frequency_parameter)
    pulse = isinstance(scene.motion, Pulse)
    return float(scene.motion.end + (20 / scene.block.frequency_parameter if pulse else 0))


def _vary_size(
    scene: Scene | DrivenScene, number: int, dials: _Dials
) -> list[Scene | DrivenScene]:
    """Vary the size of the block by up to 5 %: in one scene, or for the integrator in many."""
    factors = jnp.linspace(0.95, 1.05, number) if number > 1 else jnp.ones(1)
    widths = scene.block.half_width * factors
    return [
        jax.tree.map(
            lambda leaf: jnp.asarray(leaf, f"float{dials.bits}"),
            eqx.tree_at(lambda s: s.block.half_width, scene, width),
        )
        for width in (widths if dials.level == "adaptive" else [widths])
    ]


def _compute_truth(scene: Scene | DrivenScene) -> tuple[np.ndarray, float]:
    """Compute the answers about the sample, and the error below which none is told apart."""
    if isinstance(scene, Scene):
        (sample,) = _vary_size(scene, _SAMPLE, _Dials("nonlinear", 64))
        rounding = model_error(scene).rounding["nonlinear"][64]
        floor = max(float(rounding.rotation_ratio), float(rounding.period))
        return np.asarray(_compute_closed_form(sample, Nonlinear())), floor
    settings = [
        _Dials("adaptive", 64, 1, "Tsit5", rtol) for rtol in (1e-9, 1e-10, 1e-11, 1e-12)
    ]
    sample = _vary_size(scene, _SAMPLE, settings[0])
    answers = [
        _compute_answer(dials, _choose_duration(scene), varied_scene)
        for dials, varied_scene in show_progress(
            [*itertools.product(settings, sample)], "motions to compare with"
        )
    ]
    peaks = np.stack(answers).reshape(len(settings), _SAMPLE)
    # A stricter tolerance changes less and less, until rounding takes over.
    changes = [float(np.max(np.abs(b / a - 1))) for a, b in itertools.pairwise(peaks)]
    best = int(np.argmin(changes))
    return peaks[best + 1], max(changes[best], 4 * float(np.finfo(float).eps))


def _tabulate(
    rows: Sequence[Mapping[str, object]], scene: Scene | DrivenScene, floor: float
) -> "xarray.Dataset":
    """Tabulate the rows as a dataset, with the fronts among them."""
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    columns["default"] = columns["default"].astype(np.int8)
    # Pareto fronts by brute force: each setting against all of its group, which are few.
    error, seconds, batch, level = (columns[n] for n in ("error", "seconds", "batch", "level"))
    same_batch = batch[:, None] == batch
    same_level = same_batch & (level[:, None] == level)
    for name, group in (("front", same_batch), ("front_of_level", same_level)):
        enough = (error[:, None] <= error) & group  # no less accurate
        behind = seconds / np.where(enough, seconds[:, None], np.inf).min(axis=0)
        columns.setdefault("behind", behind)
        columns[name] = ((behind == 1) & np.isfinite(error)).astype(np.int8)
    variables = {}
    for name, values in columns.items():
        attributes = {"long_name": _LONG_NAMES.get(name, name)}
        if values.dtype.kind != "U":
            attributes["units"] = "s" if name in ("seconds", "compilation") else "1"
        variables[name] = ("setting", values, attributes)
    attributes = {
        "scene": type(scene).__name__,
        "reference_error": floor,
        "device": jax.devices()[0].device_kind,
        "jax": jax.__version__,
    }
    return make_dataset("Speed against accuracy", variables, {}, attributes)


def _format_seconds(seconds: float) -> str:
    """Format a time in the largest unit that leaves a number of at least 1."""
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    unit = next((unit for unit, size in units.items() if seconds >= size), "ns")
    return f"{seconds / units[unit]:.3g} {unit}"
