"""Trains of instantaneous pulses, and the rotation under them."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..block import Block
from ..resonance import (
    Linearized,
    ModelLike,
    Rocker,
    RockingModel,
    Scene,
    WorstTrain,
    as_model,
    half_cycle_velocity,
    rotation_ratio,
)
from .axes import ACCENT, INK, LINE, NEUTRAL, RATIO, axes_or_new, draws, labelled

_STRIP = 0.28  # of the height, for the pulses
_POINTS = 60  # of a half-cycle
_LAST = 1.2  # rotation ratio up to which a block that overturns is followed


@draws
def plot_resonance(
    scene: Scene, half_cycles: int = 8, model: ModelLike = Linearized(), ax: Axes | None = None
) -> Axes:
    """Draw the resonance input and, under it, the rotation over time (Fig. 2).

    A pulse comes right after every impact. The pulses are on axes of their own, the child of
    those returned. A block that overturns is followed until then.

    Parameters
    ----------
    scene : Scene
        One scene.
    half_cycles : int
        How many to draw, at least 1.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.

    Raises
    ------
    ValueError
        If `half_cycles` is less than 1, or the scene rests for lack of pulses.
    """
    model = as_model(model)
    if half_cycles < 1:
        raise ValueError(f"half_cycles must be at least 1, got {half_cycles}")
    intensity = float(scene.intensity)
    if intensity == 0:
        raise ValueError("intensity must be greater than 0, or there is nothing to draw")
    critical = float(model.critical_velocity(scene.block))
    x = np.asarray(half_cycle_velocity(scene, np.arange(1, half_cycles + 1))) / critical
    # Up to the first half-cycle that overturns.
    x = x[: 1 + int(np.argmax(x >= 1))] if (x >= 1).any() else x
    side = (-1.0) ** np.arange(x.size)
    flights = [_Flight(float(ratio), 0.0, float(each)) for ratio, each in zip(x, side, strict=True)]
    time, ratio, starts = _rotation(scene.block, model, flights)
    level = float(rotation_ratio(scene, model))
    limit = (1.0, "critical angle") if np.isnan(level) else (level, "stabilized peak")
    return _draw_under_pulses(ax, time, ratio, starts, intensity * side, *limit)


@draws
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
    block, restitution, model : Block, float, Linearized or Nonlinear
        Those of the search.
    train : WorstTrain
        From `jaxrock.worst_train`.
    """
    model = as_model(model)
    rocker = Rocker(block, jnp.asarray(restitution, float), model)
    unit = float(rocker.unit)
    flights = []
    x, since = abs(float(train.intensities[0])) / unit, 0.0
    side = float(np.sign(train.intensities[0]))
    pulses = zip(train.intensities[1:], train.impacts_between[1:], train.delays[1:], strict=True)
    for intensity, impacts, delay in pulses:
        for _ in range(int(impacts)):
            flights.append(_Flight(x, since, side))
            x, since, side = restitution * x, 0.0, -side
        numbers = (x, float(delay), side * float(intensity) / unit)
        after, *struck = (float(part) for part in _struck(rocker, *map(jnp.asarray, numbers)))
        flights.append(_Flight(x, since, side, until=after))
        x, since = struck
    flights.append(_Flight(x, since, side))
    if since > 0.5 * float(model.half_cycle_duration(block, x * model.critical_velocity(block))):
        # The block falls towards the ground: it may go higher on the other side.
        flights.append(_Flight(restitution * x, 0.0, -side))
    time, ratio, _ = _rotation(block, model, flights)
    pulses = np.asarray(train.times), np.asarray(train.intensities)
    return _draw_under_pulses(ax, time, ratio, *pulses, 1.0, "critical angle")


@jax.jit
def _struck(rocker: Rocker, x: Any, delay: Any, impulse: Any) -> tuple[Any, Any, Any]:
    """When a pulse comes after the launch, the flight after it, and time since its launch."""
    duration = rocker.duration(x)
    after = delay * duration
    flight = rocker.struck(rocker.on_flight(x, after, duration), impulse)
    return after, flight.x, rocker.since_launch(flight, rocker.duration(flight.x))


class _Flight(NamedTuple):
    """Motion on one side, from one time after its launch to another [s]."""

    x: float  # launch velocity over the critical velocity
    since: float
    side: float
    until: float | None = None  # the impact or, where there is none, overturning


def _rotation(
    block: Block, model: RockingModel, flights: list[_Flight]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and rotation ratios of flights that follow each other, and when each begins."""
    critical, longest = float(model.critical_velocity(block)), 6 / float(block.frequency_parameter)
    times, ratios, starts = [], [], [0.0]
    for x, since, side, until in flights:
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
    return np.concatenate(times), np.concatenate(ratios), np.asarray(starts[:-1])


def _draw_under_pulses(
    ax: Axes | None,
    time: np.ndarray,
    ratio: np.ndarray,
    pulse_times: np.ndarray,
    pulses: np.ndarray,
    level: float,
    name: str,
) -> Axes:
    """Draw the motion below, with a named level on both sides, and the pulses in a strip above."""
    ax = axes_or_new(ax)
    ax.plot(time, ratio, color=INK, linewidth=1.1)
    ax.axhline(0, color=LINE, linewidth=0.6)
    largest = float(abs(ratio).max())
    if level < 2 * largest:  # else the motion would hardly be visible
        largest = max(largest, level)
        for sign, label in ((1, name), (-1, None)):
            ax.axhline(sign * level, color=NEUTRAL, linestyle="--", linewidth=0.8, label=label)
    limit = 1.1 * largest
    low = -1.3 * limit  # room for the legend
    top = low + (limit - low) / (1 - _STRIP)
    ax.set(xlim=(-0.02 * time[-1], 1.02 * time[-1]), ylim=(low, top))
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(-limit, limit)
    ax.set_yticks([tick for tick in ticks if abs(tick) < limit])
    above = ax.inset_axes((0, 1 - _STRIP, 1, _STRIP), sharex=ax)
    above.axhline(0, color=LINE, linewidth=0.6)
    above.vlines(pulse_times, 0, pulses, color=ACCENT, linewidth=1.5)
    for chosen, marker in ((pulses > 0, "^"), (pulses <= 0, "v")):
        at = pulse_times[chosen]
        above.plot(at, pulses[chosen], marker, color=ACCENT, markersize=5)
        ax.plot(at, np.zeros_like(at), marker, color=ACCENT, markersize=4)
    highest = float(abs(pulses).max())
    above.set(ylim=(-1.5 * highest, 1.5 * highest), yticks=[-highest, 0, highest])
    above.yaxis.set_major_formatter("{x:.3g}")
    above.tick_params(labelbottom=False)
    labelled(above, "", "$I$ [m/s]")
    labelled(ax, "time [s]", RATIO).yaxis.label.set_y((1 - _STRIP) / 2)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, loc="lower left")
    return ax
