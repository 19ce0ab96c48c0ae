"""Speed against accuracy, measured: every dial turned, on the machine at hand.

A work-precision diagram holds error against time. Here the dials are the level of fidelity, the
solver, its tolerance or order, how an impact is located, the precision and the size of the batch;
the truth is the closed form where there is one, and else the adaptive integrator at a
tolerance where a stricter one changes nothing any more.
"""

import functools
import math
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..block import Block
from ..dynamics import SOLVERS, Driven, Method, Response, compiled, follow, respond_batch
from ..ground_motion import HalfSine, Pulse, Rectangular
from ..host import labelled, with_progress
from ..resonance import (
    Linearized,
    Nonlinear,
    Scene,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)
from .choice import CLOSED, DrivenScene
from .simplification import model_error

if TYPE_CHECKING:
    import xarray

_SAMPLE = 8  # scenes by which errors are taken
_TOLERANCES = {64: (1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-11), 32: (1e-3, 1e-4, 1e-5)}
_LOW_ORDER = {"Bosh3": 1e-8, "Heun": 1e-6}  # below, a step is so short that it takes minutes
_MODELS = {"linearized": Linearized(), "nonlinear": Nonlinear()}


class _Contender(NamedTuple):
    level: str
    bits: int
    batch: int
    answers: Callable[[], Any]  # of the sample, its last axis
    timed: Callable[[], Any]
    solver: str = "-"
    locate: str = "-"
    tolerance: float = math.nan
    order: int = 0
    default: bool = False

    @property
    def label(self) -> str:
        """The setting in words, without the size of the batch."""
        parts = [self.level, f"float{self.bits}"]
        if self.solver != "-":
            parts += [self.solver, f"rtol {self.tolerance:.0e}"]
            parts += {"interpolant": ["on interpolant"], "end": ["at step end"]}.get(
                self.locate, []
            )
        if self.order:
            parts.append(f"order {self.order}")
        return ", ".join(parts)


class Tradeoff(NamedTuple):
    """What `measure_tradeoff` found.

    Attributes
    ----------
    dataset : xarray.Dataset
        Along the dimension setting the variables label, level, solver, locate, tolerance,
        order, bits, batch, default, error, seconds (an answer, median), spread (relative,
        between the quartiles), compilation (seconds), behind (time over that of the fastest
        setting of the same batch that is no less accurate) and front: 1 where that is itself.
        `front_of_level` compares within the level of fidelity.
    """

    dataset: "xarray.Dataset"

    def best(self, tolerance: float, batch: int | None = None) -> str | None:
        """The fastest setting that keeps a tolerance.

        Parameters
        ----------
        tolerance : float
            Relative.
        batch : int, optional
            Among the settings measured at this size of batch; of all unless given.

        Returns
        -------
        str or None
            In words; None if there is none.
        """
        found = self.dataset.where(self.dataset.error <= tolerance, drop=True)
        if batch is not None:
            found = found.where(found.batch == batch, drop=True)
        if not found.setting.size:
            return None
        row = found.isel(setting=int(np.argmin(found.seconds.values)))
        return f"{row.label.item()} ({_duration(float(row.seconds))} an answer)"

    def sentence(self, batch: int | None = None) -> str:
        """For which accuracy to use what, on this machine.

        Parameters
        ----------
        batch : int, optional
            As in `best`.

        Returns
        -------
        str
        """
        parts: list[str] = []
        for tolerance in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
            best = self.best(tolerance, batch)
            parts.append(f"for {tolerance:.0e} " + (f"use {best}" if best else "nothing is enough"))
        return "; ".join(parts) + "."

    def notes(self) -> list[str]:
        """Which values of a dial are on no front, by what was measured.

        Returns
        -------
        list of str
            A sentence for each such dial.
        """
        rows = self.dataset
        lines = []
        dials = {
            "level": "the level of fidelity",
            "solver": "the solver",
            "locate": "locating impacts on the",
            "bits": "float",
        }
        for dial, name in dials.items():
            values = [v for v in np.unique(rows[dial].values) if v != "-"]
            never = [str(v) for v in values if not int(rows.front_of_level[rows[dial] == v].sum())]
            if dial == "level":
                never = [str(v) for v in values if not int(rows.front[rows[dial] == v].sum())]
            if never and len(never) < len(values):
                lines.append(f"never pays: {name} {', '.join(never)}")
        return lines

    def __str__(self) -> str:
        lines = [f"{'error':>8}  {'time':>9}  {'batch':>6}  setting"]
        rows = self.dataset
        for batch in np.unique(rows.batch.values):
            front = rows.where((rows.front == 1) & (rows.batch == batch), drop=True)
            front = front.sortby("seconds")
            for k in range(front.setting.size):
                row = front.isel(setting=k)
                lines.append(
                    f"{float(row.error):8.1e}  {_duration(float(row.seconds)):>9}"
                    f"  {int(row.batch):6}  {row.label.item()}"
                )
        for batch in np.unique(rows.batch.values):
            lines.append(f"batches of {batch}: {self.sentence(int(batch))}")
        for k in np.flatnonzero(rows.default.values):
            row = rows.isel(setting=int(k))
            lines.append(
                f"default in batches of {int(row.batch)}: {row.label.item()}, error"
                f" {float(row.error):.1e}, {float(row.behind):.2f} times the fastest as accurate"
            )
        return "\n".join([*lines, *self.notes()])


def measure_tradeoff(scene: Scene | DrivenScene | None = None, *, repeats: int = 15) -> Tradeoff:
    """Measure error and time of everything that can be dialled.

    Parameters
    ----------
    scene : Scene or DrivenScene, optional
        A single one. By default a block under a short half-sine pulse.
    repeats : int
        Number of times that each setting is timed, after compilation.

    Returns
    -------
    Tradeoff

    Raises
    ------
    ValueError
        If JAX is not set to 64 bits, if the scene holds arrays, or does not rock.

    Notes
    -----
    The error is the largest among eight scenes whose sizes are up to 5 % apart: of rotation
    ratio and period of a `Scene`, of the peak rotation of a `DrivenScene`. A single pulse
    that has an intensity is also taken as instantaneous, in closed form. Shows its progress
    if standard error is a terminal.
    """
    if jnp.result_type(float) != jnp.float64:
        raise ValueError("JAX must be set to 64 bits to measure what less costs")
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1, got {repeats}")
    if scene is None:
        scene = default_scene()
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((scene.block, scene.restitution))):
        raise ValueError("scene must be a single one")
    if isinstance(scene, Scene):
        truth, floor = _truth_of_scene(scene)
        contenders = list(_for_scene(scene, [1, 1000, 100_000]))
    else:
        truth, floor = _truth_of_driven(scene)
        contenders = list(_for_driven(scene, [1, 1000]))
    if not (np.isfinite(truth) & (truth > 0)).all():
        raise ValueError("scene must be one in which the block rocks and stands")
    answers, compilation = [], []
    for contender in with_progress(contenders, "compiling"):
        begin = time.perf_counter()
        answers.append(np.asarray(jax.device_get(contender.answers()), float))
        jax.block_until_ready(contender.timed())
        compilation.append(time.perf_counter() - begin)
    # In turn, so that what else the machine does meets all alike.
    taken = np.empty((repeats, len(contenders)))
    for repeat in with_progress(range(repeats), "timing"):
        for k, contender in enumerate(contenders):
            begin = time.perf_counter()
            jax.block_until_ready(contender.timed())
            taken[repeat, k] = time.perf_counter() - begin
    low, middle, high = np.quantile(taken, [0.25, 0.5, 0.75], axis=0)
    rows = []
    for k, contender in enumerate(contenders):
        error = float(np.max(np.abs(answers[k] / truth - 1)))
        rows.append(
            {
                "label": contender.label,
                **{n: v for n, v in contender._asdict().items() if n not in ("answers", "timed")},
                "error": max(error, floor) if math.isfinite(error) else math.inf,
                "seconds": middle[k] / contender.batch,
                "spread": (high[k] - low[k]) / middle[k],
                "compilation": compilation[k],
            }
        )
    return Tradeoff(_dataset(rows, scene, floor))


def default_scene() -> DrivenScene:
    """A block under a pulse so short that every level of fidelity has something to say about it."""
    amplitude, duration = jnp.asarray(40.0), jnp.asarray(0.01)
    return DrivenScene(Block(0.4, 5.0), 0.7, HalfSine(amplitude, duration))


def _spread(block: Any, number: int) -> Any:
    """Blocks of nearly the same size; the first of them the one given, if it is alone."""
    factor = jnp.linspace(0.95, 1.05, number) if number > 1 else jnp.ones(1)
    return eqx.tree_at(lambda b: b.half_width, block, block.half_width * factor)


def _in(bits: int, tree: Any) -> Any:
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf, jnp.float64 if bits == 64 else jnp.float32), tree
    )


def _one(tree: Any, k: int) -> Any:
    return eqx.tree_at(lambda s: s.block.half_width, tree, tree.block.half_width[k])


@functools.cache
def _closed_form(level: str) -> Callable[[Scene], Array]:
    model = _MODELS[level]
    return jax.jit(lambda s: jnp.stack([rotation_ratio(s, model), stabilized_period(s, model)]))


def _truth_of_scene(scene: Scene) -> tuple[np.ndarray, float]:
    spread = eqx.tree_at(lambda s: s.block, scene, _spread(scene.block, _SAMPLE))
    rounding = model_error(scene).rounding["nonlinear"][64]
    return np.asarray(_closed_form("nonlinear")(spread)), float(max(rounding[:2]))


def _for_scene(scene: Scene, sizes: list[int]) -> Iterator[_Contender]:
    def spread(number: int, bits: int) -> Scene:
        return _in(bits, eqx.tree_at(lambda s: s.block, scene, _spread(scene.block, number)))

    for level, bits, *_ in CLOSED:
        for size in sizes:
            run = _closed_form(level)
            sample, many = spread(_SAMPLE, bits), spread(size, bits)
            yield _Contender(
                level,
                bits,
                size,
                lambda run=run, sample=sample: run(sample),
                lambda run=run, many=many: run(many),
                default=(level, bits) == ("linearized", 32),  # which is JAX's own precision
            )

    def flight(scene: Scene, rtol: Array, method: Method) -> Array:
        """The stabilized half-cycle, from one impact to the next."""
        still = jnp.zeros_like(scene.restitution)
        driven = Driven(
            block=scene.block,
            restitution=scene.restitution,
            motion=Rectangular(still, still + 1),
            duration=still + 1000 / scene.block.frequency_parameter,
            rotation=still,
            velocity=stabilized_velocity(scene),
        )
        end = follow(
            driven,
            rtol=rtol,
            atol=1e-9 * rtol,
            model=Nonlinear(),
            once=True,
            forced=False,
            method=method,
        )
        return jnp.stack([end.peak / scene.block.critical_angle, 2 * end.struck[0]])

    run = eqx.filter_jit(flight)
    for bits, tolerance, method, default in _adaptive():
        rtol = _in(bits, tolerance)

        def answers(bits: int = bits, rtol: Any = rtol, method: Method = method) -> Any:
            sample = spread(_SAMPLE, bits)
            return np.stack([run(_one(sample, k), rtol, method) for k in range(_SAMPLE)], axis=-1)

        one = _one(spread(1, bits), 0)
        yield _Contender(
            "adaptive",
            bits,
            1,
            answers,
            lambda one=one, rtol=rtol, method=method: run(one, rtol, method),
            solver=method.solver,
            locate=method.locate,
            tolerance=tolerance,
            default=default,
        )


def _adaptive() -> Iterator[tuple[int, float, Method, bool]]:
    """Precision, tolerance and method of what the adaptive integrator is to show."""
    methods = [(64, Method(solver)) for solver in SOLVERS]
    methods += [(64, Method(locate=locate)) for locate in ("interpolant", "end")]
    methods += [(32, Method())]
    for bits, method in methods:
        for tolerance in _TOLERANCES[bits]:
            if tolerance >= _LOW_ORDER.get(method.solver, 0):
                usual = 1e-8 if bits == 64 else 1e-5
                yield bits, tolerance, method, method == Method() and tolerance == usual


def _driven(scene: DrivenScene, bits: int) -> Driven:
    zero = jnp.zeros(())
    driven = Driven(
        block=scene.block,
        restitution=scene.restitution,
        motion=scene.motion,
        duration=_duration_of(scene),
        rotation=zero,
        velocity=zero,
    )
    return _in(bits, driven)


def _duration_of(scene: DrivenScene) -> Any:
    """To the end of a record; after a pulse until the block has come to rest, or nearly."""
    if isinstance(scene.motion, Pulse):
        return scene.motion.end + 20 / jnp.min(scene.block.frequency_parameter)
    return scene.motion.end


def _response(scene: DrivenScene, bits: int, rtol: float, method: Method) -> Response:
    relative, absolute = _in(bits, (rtol, 1e-9 * rtol))
    return compiled(_driven(scene, bits), relative, absolute, Nonlinear(), 0, method)


def _truth_of_driven(scene: DrivenScene) -> tuple[np.ndarray, float]:
    """Peaks at a tolerance at which a stricter one changes nothing, and what it does change."""
    spread = eqx.tree_at(lambda s: s.block, scene, _spread(scene.block, _SAMPLE))

    def peaks(rtol: float) -> np.ndarray:
        responses = [_response(_one(spread, k), 64, rtol, Method()) for k in range(_SAMPLE)]
        if any(bool(r.overturned) or int(r.status) > 1 for r in responses):
            return np.full(_SAMPLE, np.nan)
        return np.array([float(r.peak_rotation) for r in responses])

    truth, change = peaks(1e-9), math.inf
    for rtol in (1e-10, 1e-11, 1e-12):
        stricter = peaks(rtol)
        with np.errstate(invalid="ignore"):
            now = float(np.max(np.abs(stricter / truth - 1)))
        if not now < change:
            break
        truth, change = stricter, now
    return truth, max(change, 4 * float(np.finfo(float).eps))


def _for_driven(scene: DrivenScene, sizes: list[int]) -> Iterator[_Contender]:
    motion, duration = scene.motion, _duration_of(scene)
    if isinstance(motion, Pulse) and type(motion).area:
        for level, bits, *_ in CLOSED:
            peak = jax.jit(
                lambda b, i, model=_MODELS[level]: model.peak_rotation(b, b.pulse_velocity(i))
            )
            for size in sizes:
                sample, many, intensity = _in(
                    bits,
                    (_spread(scene.block, _SAMPLE), _spread(scene.block, size), motion.intensity),
                )
                yield _Contender(
                    level,
                    bits,
                    size,
                    lambda peak=peak, sample=sample, i=intensity: peak(sample, i),
                    lambda peak=peak, many=many, i=intensity: peak(many, i),
                )
    dials = [(64, order) for order in (3, 4, 5, 6, 8, 10, 12)] + [(32, 4), (32, 6)]
    for bits, order in dials:
        for size in sizes:

            def run(number: int, bits: int = bits, order: int = order) -> Any:
                blocks, c, shaking, length = _in(
                    bits, (_spread(scene.block, number), scene.restitution, motion, duration)
                )
                return respond_batch(blocks, c, shaking, length, order=order).peak_rotation

            yield _Contender(
                "batch",
                bits,
                size,
                functools.partial(run, _SAMPLE),
                functools.partial(run, size),
                order=order,
                default=(bits, order, size) == (64, 8, sizes[-1]),
            )
    spread = eqx.tree_at(lambda s: s.block, scene, _spread(scene.block, _SAMPLE))
    for bits, tolerance, method, default in _adaptive():

        def answers(bits: int = bits, tolerance: float = tolerance, method: Method = method) -> Any:
            blocks = (_one(spread, k) for k in range(_SAMPLE))
            found = (_response(block, bits, tolerance, method) for block in blocks)
            return np.array([float(response.peak_rotation) for response in found])

        yield _Contender(
            "adaptive",
            bits,
            1,
            answers,
            functools.partial(_response, scene, bits, tolerance, method),
            solver=method.solver,
            locate=method.locate,
            tolerance=tolerance,
            default=default,
        )


def _dataset(rows: list[dict[str, Any]], scene: Any, floor: float) -> "xarray.Dataset":
    error = np.array([row["error"] for row in rows])
    seconds = np.array([row["seconds"] for row in rows])
    batch = np.array([row["batch"] for row in rows])
    level = np.array([row["level"] for row in rows])

    def behind(groups: np.ndarray) -> np.ndarray:
        """Time over that of the fastest setting which is no less accurate."""
        enough = (error[:, None] <= error) & (groups[:, None] == groups)
        return seconds / np.where(enough, seconds[:, None], np.inf).min(axis=0)

    def front(groups: np.ndarray) -> np.ndarray:
        return ((behind(groups) == 1) & np.isfinite(error)).astype(np.int8)

    units = {"seconds": "s", "compilation": "s"}
    meaning = {
        "seconds": "time an answer, median",
        "compilation": "time of the first call, with compilation",
        "error": "largest relative error",
        "spread": "between the quartiles of the time, relative",
    }
    variables = {}
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        if values.dtype == bool:
            values = values.astype(np.int8)
        attributes = {"long_name": meaning.get(name, name)}
        attributes |= {} if values.dtype.kind == "U" else {"units": units.get(name, "1")}
        variables[name] = ("setting", values, attributes)
    both = np.array([f"{r} {b}" for r, b in zip(level, batch, strict=True)])
    variables["behind"] = (
        "setting",
        behind(batch),
        {"long_name": "time over that of the fastest that is no less accurate", "units": "1"},
    )
    variables["front"] = (
        "setting",
        front(batch),
        {"long_name": "1 on the front of its batch", "units": "1"},
    )
    variables["front_of_level"] = (
        "setting",
        front(both),
        {"long_name": "1 on the front of its batch and level", "units": "1"},
    )
    attributes = {
        "scene": type(scene).__name__,
        "reference_error": floor,
        "device": jax.devices()[0].device_kind,
        "jax": jax.__version__,
    }
    return labelled("Speed against accuracy", variables, {}, attributes)


def _duration(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"
