"""What a block did under a ground motion: over time, and in the phase plane."""

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes

from ..dynamics import Equation, Response
from .axes import ACCENT, INK, LINE, NEUTRAL, RATIO, axes_or_new, draws, labelled, legend_above


@draws
def plot_response(response: Response, ax: Axes | None = None) -> Axes:
    """Draw rotation over critical angle against time, with a tick at every impact.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    """
    ax = axes_or_new(ax)
    times, rotation, _ = _history(response, 4000)
    ratio = rotation / float(response.scene.block.critical_angle)
    ax.plot(times, ratio, color=INK, linewidth=0.9)
    limit = min(1.4, 1.2 * float(np.max(np.abs(ratio))) or 1.4)
    impacts = np.asarray(response.impact_times)
    ax.plot(impacts, np.zeros_like(impacts), "|", color=ACCENT, markersize=6, label="impacts")
    for level in (-1, 1):
        # Without an entry in the legend where the line lies outside of the limits.
        label = "critical angle" if level == 1 < limit else None
        ax.axhline(level, color=NEUTRAL, linestyle="--", linewidth=0.8, label=label)
    if bool(response.overturned) and np.isfinite(response.overturning_time):
        ax.axvline(float(response.overturning_time), color=LINE, linestyle=":", label="overturning")
    ax.set(xlim=(0, times[-1]), ylim=(-limit, limit))
    legend_above(ax, 3)
    return labelled(ax, "time [s]", RATIO)


@draws
def plot_phase(response: Response, ax: Axes | None = None) -> Axes:
    """Draw the phase portrait, with the separatrix of free motion.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    """
    ax = axes_or_new(ax)
    block = response.scene.block
    angle = float(block.critical_angle)
    unit = float(block.frequency_parameter) * angle  # of the velocity
    times, rotation, velocity = _history(response, 8000)
    # Impacts change the velocity at once: no line from before to after.
    broken = np.diff(np.searchsorted(np.asarray(response.impact_times), times)) > 0
    velocity[1:][broken] = np.nan
    ax.plot(rotation / angle, velocity / unit, color=INK, linewidth=0.8, label="motion")
    rotations = np.linspace(0, 1.5 * angle, 200)  # from the side that the block stands on
    equation = Equation.of(block, response.model)
    separatrix = np.asarray(equation.returning_velocity(jnp.asarray(rotations))) / unit
    for side in (-1, 1):
        for sign in (-1, 1):
            label = "separatrix" if side == sign == 1 else None
            ax.plot(
                side * rotations / angle, side * sign * separatrix, "--", color=NEUTRAL, label=label
            )
    shown = np.abs(velocity[np.abs(rotation) <= 1.5 * angle]) / unit
    # The fall, much faster than what came before it, does not set the limits.
    limit = max(1.2, 1.1 * min(float(np.nanmax(shown)), 3))
    ax.set(xlim=(-1.5, 1.5), ylim=(-limit, limit))
    legend_above(ax, 2)
    return labelled(ax, RATIO, r"velocity ratio $\dot\alpha/(p\,\alpha_c)$ [-]")


def _history(response: Response, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, rotations and angular velocities."""
    times = np.linspace(0, float(response.scene.duration), samples)
    rotation, velocity = (np.array(values) for values in response.history(times))
    return times, rotation, velocity
