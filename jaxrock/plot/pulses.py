"""Pulses: the rotation under trains of them, how the worst was found, what single ones do."""

import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from .. import resonance
from ..block import Block
from ..impact import velocity_after_impact
from ..resonance import Linearized, ModelLike, Rocker, RockingModel, Scene, WorstTrain
from .axes import ACCENT, BESIDE, INK, LINE, NEUTRAL, RATIO, add_level, axes_or_new, draws, labelled

_POINTS = 60  # of a half-cycle
_LAST = 1.2  # rotation ratio up to which a block that overturns is followed

# Motion on one side: launch velocity over the critical one, the time since the launch from which
# and until which it lasts [s] (None: the impact or, where there is none, overturning), the side.
_Flight = tuple[float, float, float | None, float]


@draws()
def plot_resonance(
    scene: Scene, half_cycles: int = 8, model: ModelLike = Linearized(), ax: Axes | None = None
) -> Axes:
    """Draw the resonance input and, under it, the rotation over time (Fig. 2).

    A pulse comes right after every impact. The pulses are on axes of their own, the child of
    those returned. A block that overturns is followed until then.

    Parameters
    ----------
    scene, half_cycles : Scene, int
        One scene, and how many half-cycles to draw, at least 1.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.

    Raises
    ------
    ValueError
        If `half_cycles` is less than 1, or the scene rests for lack of pulses.
    """
    model = resonance.as_model(model)
    if half_cycles < 1:
        raise ValueError(f"half_cycles must be at least 1, got {half_cycles}")
    intensity = float(scene.intensity)
    if intensity == 0:
        raise ValueError("intensity must be greater than 0, or there is nothing to draw")
    critical = float(model.critical_velocity(scene.block))
    x = np.asarray(resonance.half_cycle_velocity(scene, np.arange(1, half_cycles + 1))) / critical
    # Up to the first half-cycle that overturns.
    x = x[: 1 + int(np.argmax(x >= 1))] if (x >= 1).any() else x
    side = (-1.0) ** np.arange(x.size)
    flights = [(float(ratio), 0.0, None, float(each)) for ratio, each in zip(x, side, strict=True)]
    motion = _rotation(scene.block, model, flights)
    level = float(resonance.rotation_ratio(scene, model))
    limit = (1.0, "critical angle") if np.isnan(level) else (level, "stabilized peak")
    return _draw_under_pulses(ax, motion, motion[2], intensity * side, *limit)


@draws()
def plot_train(
    block: Block,
    restitution: float,
    train: WorstTrain,
    model: ModelLike = Linearized(),
    ax: Axes | None = None,
) -> Axes:
    """Draw the pulses of a worst train and, under them, the rotation over time.

    The pulses are on axes of their own, the child of those returned.

    Parameters
    ----------
    block, restitution, train, model : Block, float, WorstTrain, Linearized or Nonlinear
        What `jaxrock.worst_train` took and found.
    """
    model = resonance.as_model(model)
    rocker = Rocker(block, jnp.asarray(restitution, float), model)
    unit, flights = float(rocker.unit), list[_Flight]()
    x, since = abs(float(train.intensities[0])) / unit, 0.0
    side = float(np.sign(train.intensities[0]))
    pulses = zip(train.intensities[1:], train.impacts_between[1:], train.delays[1:], strict=True)
    for intensity, impacts, delay in pulses:
        for _ in range(int(impacts)):
            flights.append((x, since, None, side))
            x, since, side = velocity_after_impact(restitution, x), 0.0, -side
        now = _struck(rocker, x, float(delay), side * float(intensity) / unit)
        after, launch, passed = map(float, now)
        flights.append((x, since, after, side))
        x, since = launch, passed
    flights.append((x, since, None, side))
    if since > 0.5 * float(model.half_cycle_duration(block, x * model.critical_velocity(block))):
        # The block falls towards the ground: it may go higher on the other side.
        flights.append((velocity_after_impact(restitution, x), 0.0, None, -side))
    pulses = np.asarray(train.times), np.asarray(train.intensities)
    motion = _rotation(block, model, flights)
    return _draw_under_pulses(ax, motion, *pulses, 1.0, "critical angle")


@draws("train : WorstTrain\n    From `jaxrock.worst_train`.")
def plot_convergence(train: WorstTrain, ax: Axes | None = None) -> Axes:
    """Draw how far each start was from the best train, step by step."""
    ax = axes_or_new(ax)
    reached = train.objectives[np.isfinite(train.objectives)]
    better = np.max if train.goal == "most rotation" else np.min
    best = better(reached) if reached.size else np.nan
    distances = np.maximum(np.abs(train.history / best - 1), 1e-16)
    ax.semilogy(distances.T, color=INK, alpha=0.5, linewidth=0.9)
    ax.set_title(f"{len(distances)} starts of the search", fontsize="medium")
    return labelled(ax, "step of the descent [-]", "distance from the best, relative [-]")


@draws("found : xarray.Dataset\n    From `jaxrock.overturning_map`.")
def plot_overturning_map(found: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw all boundaries of overturning, and what lies between them.

    Shaded where the block overturns, hatched where it survives a stronger pulse than one
    that overturns it.
    """
    ax = axes_or_new(ax, figsize=(7.2, 4.4))
    found = found.sortby("frequency_ratio")
    ratios, edges, about = found.frequency_ratio.values, found.amplitude_ratio.values, found.attrs
    limits = about["lowest_amplitude_ratio"], about["highest_amplitude_ratio"]
    # Every column reaches halfway to its neighbours.
    step = np.diff(ratios) if ratios.size > 1 else 0.1 * ratios
    step = np.append(step, step[-1])[: ratios.size]
    sides = np.append(ratios[0] - step[0] / 2, ratios + step / 2)
    areas: tuple[list, list] = [], []
    columns = zip(itertools.pairwise(sides), found.overturns_first.values, edges, strict=True)
    for (left, right), first, column in columns:
        levels = [limits[0], *column[np.isfinite(column)], limits[1]]
        # The outcome changes at every boundary: odd numbers overturn.
        for number, (low, high) in enumerate(itertools.pairwise(levels), int(first)):
            if number > 0:
                corners = [(left, low), (right, low), (right, high), (left, high)]
                areas[(number + 1) % 2].append(corners)
    overturns = {"facecolor": "0.8", "label": "overturns"}
    survives = {"facecolor": "w", "label": "survives again", "hatch": "////"}
    for shapes, look in zip(areas, (overturns, survives), strict=True):
        if shapes:
            area = PolyCollection(shapes, linewidth=0, zorder=0, edgecolor="0.6")
            ax.add_collection(area).set(**look)
    impacts = np.where(np.isfinite(edges), np.minimum(found.impacts.values, 2), -1)
    for number, colour, marker, when in (
        (0, INK, ".", "without an impact"),
        (1, ACCENT, "x", "after one impact"),
        (2, NEUTRAL, "+", "after more impacts"),
    ):
        row, column = np.nonzero(impacts == number)
        if row.size:
            look = {"color": colour, "markersize": 4, "label": f"boundary: {when}"}
            ax.plot(ratios[row], edges[row, column], marker, **look)
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set(xlim=(sides[0], sides[-1]), ylim=limits)
    numbers = rf"$\lambda$ = {about['slenderness']:g}, $C$ = {about['restitution']:.3g}"
    ax.set_title(f"{about['motion']}, {numbers}", fontsize="medium")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**BESIDE)
    angle = r"\alpha_c" if about["model"] == "linearized" else r"\tan\alpha_c"
    vertical = rf"amplitude ratio $a_p/(g\,{angle})$ [-]"
    return labelled(ax, r"frequency ratio $\omega_p/p$ [-]", vertical)


def strip_above(ax: Axes, low: float, high: float) -> Axes:
    """New axes over the top of `ax`, which shows `low` to `high`, ticks up to it, below them."""
    share = 0.28  # of the height
    ax.set_ylim(low, low + (high - low) / (1 - share))
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(-high, high)
    ax.set_yticks([tick for tick in ticks if abs(tick) < high])
    ax.yaxis.label.set_y((1 - share) / 2)
    above = ax.inset_axes((0, 1 - share, 1, share), sharex=ax)
    above.axhline(0, color=LINE, linewidth=0.6)
    above.tick_params(labelbottom=False)
    return above


@jax.jit
def _struck(rocker: Rocker, x: Any, delay: Any, impulse: Any) -> tuple[Any, Any, Any]:
    """When a pulse comes after the launch, the flight after it, and time since its launch."""
    duration = rocker.duration(x)
    after = delay * duration
    flight = rocker.struck(rocker.on_flight(x, after, duration), impulse)
    return after, flight.x, rocker.since_launch(flight, rocker.duration(flight.x))


def _rotation(block: Block, model: RockingModel, flights: Sequence[_Flight]) -> list[np.ndarray]:
    """Times and rotation ratios of flights that follow each other, and when each begins."""
    critical, longest = float(model.critical_velocity(block)), 6 / float(block.frequency_parameter)
    times, ratios, starts = [], [], [0.0]
    for x, since, until, side in flights:
        duration = float(model.half_cycle_duration(block, x * critical))  # NaN if it overturns
        end = np.fmin(duration, longest) if until is None else until
        after = np.linspace(since, end, _POINTS if end < longest else 20 * _POINTS)
        rotation = np.asarray(model.motion(block, x * critical, after)[0])
        ratio = rotation / float(block.critical_angle)
        beyond = ~(ratio < _LAST)
        last = int(np.argmax(beyond)) if beyond.any() else ratio.size
        times.append(starts[-1] + after[:last] - since)
        ratios.append(side * ratio[:last])
        starts.append(float(times[-1][-1]))
    return [np.concatenate(times), np.concatenate(ratios), np.asarray(starts[:-1])]


def _draw_under_pulses(
    ax: Axes | None, motion: Any, times: np.ndarray, pulses: np.ndarray, level: float, name: str
) -> Axes:
    """Draw the motion below, with a named level on both sides, and the pulses in a strip above."""
    ax = axes_or_new(ax)
    time, ratio, _ = motion
    ax.plot(time, ratio, color=INK, linewidth=1.1)
    ax.axhline(0, color=LINE, linewidth=0.6)
    limit = 1.1 * float(abs(ratio).max())
    if 1.1 * level < 2 * limit:  # else the motion would hardly be visible
        limit = max(limit, 1.1 * level)
        add_level(ax, level, name)
    ax.set(xlim=(-0.02 * time[-1], 1.02 * time[-1]))
    above = strip_above(ax, -1.3 * limit, limit)  # with room for the legend
    above.vlines(times, 0, pulses, color=ACCENT, linewidth=1.5)
    for chosen, marker in ((pulses > 0, "^"), (pulses <= 0, "v")):
        above.plot(times[chosen], pulses[chosen], marker, color=ACCENT, markersize=5)
        ax.plot(times[chosen], 0 * pulses[chosen], marker, color=ACCENT, markersize=4)
    highest = float(abs(pulses).max())
    above.set(ylim=(-1.5 * highest, 1.5 * highest), yticks=[-highest, 0, highest])
    above.yaxis.set_major_formatter("{x:.3g}")
    labelled(above, "", "$I$ [m/s]")
    labelled(ax, "time [s]", RATIO)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, loc="lower left")
    return ax
