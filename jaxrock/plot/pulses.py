"""Trains of instantaneous pulses, and the rotation under them."""

from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..resonance import (
    Linearized,
    ModelLike,
    Rocker,
    RockingModel,
    Scene,
    as_model,
    half_cycle_velocity,
    rotation_ratio,
)
from .axes import ACCENT, INK, NEUTRAL, RATIO, axes_or_new, draws, labelled

if TYPE_CHECKING:
    import matplotlib.axes

    from ..resonance import WorstTrain

_STRIP = 0.28  # of the height, for the pulses
_POINTS = 60  # of a half-cycle
_LAST = 1.2  # rotation ratio up to which a block that overturns is followed


@draws
def plot_resonance(
    scene: Scene,
    half_cycles: int = 8,
    model: ModelLike = Linearized(),
    ax: "matplotlib.axes.Axes | None" = None,
) -> "matplotlib.axes.Axes":
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
    number = np.arange(1, half_cycles + 1)
    x = np.asarray(half_cycle_velocity(scene, number)) / critical
    # Up to the first that overturns.
    x = x[: 1 + int(np.argmax(x >= 1))] if (x >= 1).any() else x
    side = (-1.0) ** np.arange(x.size)
    flight = _Path(scene.block, model)
    starts = [flight.follow(ratio, 0.0, each) for ratio, each in zip(x, side, strict=True)]
    level = float(rotation_ratio(scene, model))
    limit = (1.0, "critical angle") if np.isnan(level) else (level, "stabilized peak")
    return _under_pulses(ax, flight, np.asarray(starts), intensity * side, *limit)


@draws
def plot_train(
    block: Block,
    restitution: float,
    train: "WorstTrain",
    model: ModelLike = Linearized(),
    ax: "matplotlib.axes.Axes | None" = None,
) -> "matplotlib.axes.Axes":
    """Draw the pulses of a worst train and, under them, the rotation over time.

    The pulses are on axes of their own, the child of those returned.

    Parameters
    ----------
    block : Block
        That of the search.
    restitution : float
        That of the search.
    train : WorstTrain
        From `jaxrock.worst_train`.
    model : Linearized or Nonlinear
        That of the search.
    """
    model = as_model(model)
    rocker = Rocker(block, jnp.asarray(restitution, float), model)
    unit = float(rocker.unit)
    flight = _Path(block, model)
    x, since = abs(float(train.intensities[0])) / unit, 0.0
    side = float(np.sign(train.intensities[0]))
    pulses = zip(train.intensities[1:], train.impacts_between[1:], train.delays[1:], strict=True)
    for intensity, impacts, delay in pulses:
        for _ in range(int(impacts)):
            flight.follow(x, since, side)
            x, since, side = restitution * x, 0.0, -side
        numbers = (x, float(delay), side * float(intensity) / unit)
        after, *struck = (float(part) for part in _struck(rocker, *map(jnp.asarray, numbers)))
        flight.follow(x, since, side, until=after)
        x, since = struck
    flight.follow(x, since, side)
    if since > 0.5 * flight.duration(x):
        # It falls towards the ground: it may go higher on the other side.
        flight.follow(restitution * x, 0.0, -side)
    pulses = np.asarray(train.times), np.asarray(train.intensities)
    return _under_pulses(ax, flight, *pulses, 1.0, "critical angle")


@jax.jit
def _struck(rocker: Rocker, x: Any, delay: Any, impulse: Any) -> tuple[Any, Any, Any]:
    """When a pulse comes after the launch, the flight after it, and time since its launch."""
    whole = rocker.duration(x)
    after = delay * whole
    flight = rocker.struck(rocker.on_flight(x, after, whole), impulse)
    return after, flight.x, rocker.since_launch(flight, rocker.duration(flight.x))


class _Path:
    """Rotation ratio over time, half-cycle by half-cycle."""

    def __init__(self, block: Block, model: RockingModel):
        self.block, self.model = block, model
        self.critical = float(model.critical_velocity(block))
        self.times: list[np.ndarray] = []
        self.ratios: list[np.ndarray] = []
        self.now = 0.0

    def duration(self, x: float) -> float:
        """Of a half-cycle [s]; NaN where it overturns."""
        return float(self.model.half_cycle_duration(self.block, x * self.critical))

    def follow(self, x: float, since: float, side: float, until: float | None = None) -> float:
        """Go on a flight from and until some time after its launch [s]; the time before.

        Until the next impact, or if there is none, until the block overturns.
        """
        began = self.now
        whole = self.duration(x)
        longest = 6 / float(self.block.frequency_parameter)
        end = np.fmin(whole, longest) if until is None else until
        after = np.linspace(since, end, _POINTS if end < longest else 20 * _POINTS)
        rotation = np.asarray(self.model.motion(self.block, x * self.critical, after)[0])
        ratio = rotation / float(self.block.critical_angle)
        beyond = ~(ratio < _LAST)
        last = int(np.argmax(beyond)) if beyond.any() else ratio.size
        self.times.append(began + after[:last] - since)
        self.ratios.append(side * ratio[:last])
        self.now = float(self.times[-1][-1])
        return began


def _under_pulses(
    ax: "matplotlib.axes.Axes | None",
    path: _Path,
    times: np.ndarray,
    pulses: np.ndarray,
    level: float,
    name: str,
) -> "matplotlib.axes.Axes":
    from matplotlib.ticker import MaxNLocator

    ax = axes_or_new(ax)
    time, ratio = np.concatenate(path.times), np.concatenate(path.ratios)
    ax.plot(time, ratio, color=INK, linewidth=1.1)
    ax.axhline(0, color="0.2", linewidth=0.6)
    largest = float(abs(ratio).max())
    if level < 2 * largest:
        largest = max(largest, level)
        ax.axhline(level, color=NEUTRAL, linestyle="--", linewidth=0.8, label=name)
        ax.axhline(-level, color=NEUTRAL, linestyle="--", linewidth=0.8)
    ax.set_xlim(-0.02 * time[-1], 1.02 * time[-1])
    # The motion below, the pulses in a strip above it.
    limit = 1.1 * largest
    low = -1.3 * limit  # room for the legend
    ax.set_ylim(low, low + (limit - low) / (1 - _STRIP))
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(-limit, limit)
    ax.set_yticks([tick for tick in ticks if abs(tick) < limit])
    above = ax.inset_axes((0, 1 - _STRIP, 1, _STRIP), sharex=ax)
    above.axhline(0, color="0.2", linewidth=0.6)
    above.vlines(times, 0, pulses, color=ACCENT, linewidth=1.5)
    for up, marker in ((True, "^"), (False, "v")):
        of_sign = (pulses > 0) == up
        above.plot(times[of_sign], pulses[of_sign], marker, color=ACCENT, markersize=5)
        ax.plot(times[of_sign], np.zeros(of_sign.sum()), marker, color=ACCENT, markersize=4)
    highest = float(abs(pulses).max())
    above.set_ylim(-1.5 * highest, 1.5 * highest)
    above.set_yticks([-highest, 0, highest])
    above.yaxis.set_major_formatter("{x:.3g}")
    above.tick_params(labelbottom=False)
    labelled(above, "", "$I$ [m/s]")
    labelled(ax, "time [s]", RATIO).yaxis.label.set_y((1 - _STRIP) / 2)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, loc="lower left")
    return ax
