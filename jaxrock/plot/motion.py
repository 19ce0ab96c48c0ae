"""What a block did under a ground motion: over time, and in the phase plane."""

from typing import TYPE_CHECKING

import numpy as np

from .axes import ACCENT, INK, NEUTRAL, RATIO, axes_or_new, draws, labelled

if TYPE_CHECKING:
    import matplotlib.axes

    from ..dynamics import Response


@draws
def plot_response(
    response: "Response", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw rotation over critical angle against time, with a tick at every impact.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    """
    ax = axes_or_new(ax)
    times = np.linspace(0, float(response.scene.duration), 4000)
    ratio = np.asarray(response.history(times)[0]) / float(response.scene.block.critical_angle)
    ax.plot(times, ratio, color=INK, linewidth=0.9)
    limit = min(1.4, 1.2 * float(np.max(np.abs(ratio))) or 1.4)
    impacts = np.asarray(response.impact_times)
    ax.plot(impacts, np.zeros_like(impacts), "|", color=ACCENT, markersize=6, label="impacts")
    for level in (-1, 1):
        # Not mentioned where it lies outside of the limits.
        label = "critical angle" if level == 1 < limit else None
        ax.axhline(level, color=NEUTRAL, linestyle="--", linewidth=0.8, label=label)
    ax.set_ylim(-limit, limit)
    if bool(response.overturned) and np.isfinite(float(response.overturning_time)):
        when = float(response.overturning_time)
        ax.axvline(when, color="0.2", linestyle=":", label="overturning")
    ax.set_xlim(0, times[-1])
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=3)
    return labelled(ax, "time [s]", RATIO)


@draws
def plot_phase(
    response: "Response", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw the phase portrait, with the separatrix of free motion.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    """
    import jax.numpy as jnp

    from ..dynamics import Equation

    ax = axes_or_new(ax)
    block = response.scene.block
    angle, rate = float(block.critical_angle), float(block.frequency_parameter)
    times = np.linspace(0, float(response.scene.duration), 8000)
    rotation, velocity = (np.array(part) for part in response.history(times))
    # Impacts change the velocity at once: no line from before to after.
    broken = np.diff(np.searchsorted(np.asarray(response.impact_times), times)) > 0
    velocity[1:][broken] = np.nan
    ax.plot(rotation / angle, velocity / (rate * angle), color=INK, linewidth=0.8, label="motion")
    lean = np.linspace(0, 1.5 * angle, 200)
    equation = Equation.of(block, response.model)
    back = np.asarray(equation.returning_velocity(jnp.asarray(lean))) / (rate * angle)
    for side in (-1, 1):
        for sign in (-1, 1):
            label = "separatrix" if side == sign == 1 else None
            ax.plot(side * lean / angle, side * sign * back, "--", color=NEUTRAL, label=label)
    ax.set_xlim(-1.5, 1.5)
    shown = np.abs(velocity[np.abs(rotation) <= 1.5 * angle]) / (rate * angle)
    limit = max(1.2, 1.1 * min(float(np.nanmax(shown)), 3))
    ax.set_ylim(-limit, limit)
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
    return labelled(ax, RATIO, r"velocity ratio $\dot\alpha/(p\,\alpha_c)$ [-]")
