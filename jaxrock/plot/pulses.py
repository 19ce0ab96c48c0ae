"""Pulses: rotation under trains of them, boundaries of overturning by a single one."""

from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes

from .. import resonance
from ..grids import expand_scalars
from ..resonance import Linearized, ModelLike, Scene
from ..tables import write_label
from .axes import (
    ACCENT,
    BESIDE,
    INK,
    LINE,
    NEUTRAL,
    RATIO,
    add_strip_above,
    check_result,
    get_axes,
    label_axes,
    set_title,
    tick_decades,
    write_amplitude_ratio,
)

_POINTS = 600  # number of points of a half-cycle
_LAST = 1.2  # rotation ratio up to which a block that overturns is drawn
_LONGEST = 6.0  # length of the last half-cycle that is drawn, times p


def plot_resonance(
    scene: Scene, half_cycles: int = 8, model: ModelLike = Linearized(), ax: Axes | None = None
) -> Axes:
    """Draw the resonance input and, under it, the rotation over time (Fig. 2).

    A pulse comes right after every impact; for a one-sided block always away from its wall.
    The pulses have their own axes, a child of the returned axes. The motion of a block that
    overturns is drawn until it does.

    Parameters
    ----------
    scene, half_cycles : Scene, int
        One scene, and how many half-cycles to draw, at least 1.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If `half_cycles` is less than 1.

    Examples
    --------
    >>> import jaxrock as jr
    >>> axes = jr.plot.plot_resonance(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15), half_cycles=3)
    """
    check_result("scene", scene, Scene, "Scene(block, restitution, intensity)")
    model = resonance.as_model(model)
    if half_cycles < 1:
        raise ValueError(f"half_cycles must be at least 1, got {half_cycles}")
    block = scene.block
    launches = np.asarray(resonance.half_cycle_velocity(scene, np.arange(1, half_cycles + 1)))
    overturns = launches >= float(model.critical_velocity(block))
    # Up to the first half-cycle that overturns.
    count = int(np.argmax(overturns)) + 1 if overturns.any() else half_cycles
    launches = launches[:count, None]
    durations = np.array(model.half_cycle_duration(block, launches), float)
    longest = _LONGEST / float(block.frequency_parameter)
    durations[-1] = np.fmin(durations[-1], longest)  # NaN if it overturns
    starts = np.cumsum(durations)[:, None] - durations
    sides = (1.0 if block.one_sided else -1.0) ** np.arange(count)[:, None]
    # Each half-cycle is computed from its launch: in a train at fixed times every error would
    # grow from impact to impact.
    since = durations * np.linspace(0, 1, _POINTS)
    rotation = sides * np.asarray(model.motion(block, launches, since)[0])
    ratio = rotation.ravel() / float(block.critical_angle)
    # Written so that NaN, which follows overturning in closed form, is left out as well.
    ratio[~(abs(ratio) < _LAST)] = np.nan
    ax = get_axes(ax)
    ax.plot((starts + since).ravel(), ratio, color=INK, linewidth=1.1)
    ax.axhline(0, color=LINE, linewidth=0.6)
    stabilized = float(resonance.rotation_ratio(scene, model))
    # Where the block overturns there is no stabilized peak.
    name = "critical angle" if np.isnan(stabilized) else "stabilized peak"
    look = {"color": NEUTRAL, "linestyle": "--", "linewidth": 0.8}
    level = 1.0 if np.isnan(stabilized) else stabilized
    ax.axhline(level, label=name, **look)
    ax.legend(loc="lower left", fontsize="small")

    peak = float(np.nanmax(abs(ratio)))
    # The limits leave room for the legend at the foot.
    above = add_strip_above(ax, -1.4 * peak, 1.1 * max(level, peak))
    pulses = float(scene.intensity) * sides.ravel()
    arrows = {"color": ACCENT, "angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
    above.quiver(starts.ravel(), 0 * pulses, 0 * pulses, pulses, **arrows)
    levels = pulses[0] * np.array([-1, 0, 1])
    above.set(ylim=(1.4 * levels[0], 1.4 * levels[2]), yticks=levels)
    label_axes(above, "", "$I$ [m/s]")
    return label_axes(ax, write_label("time"), RATIO)


def plot_overturning_map(boundaries: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw all boundaries of overturning, and the regions between them.

    The map is shaded where the block overturns, and hatched where it survives although a
    weaker pulse overturns it.

    Parameters
    ----------
    boundaries : xarray.Dataset
        From `jaxrock.overturning_map`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Examples
    --------
    >>> import jaxrock as jr
    >>> boundaries = jr.overturning_map(jr.Sine, [4.0], restitution=0.9)
    >>> axes = jr.plot.plot_overturning_map(boundaries)
    """
    check_result("boundaries", boundaries, xarray.Dataset, "overturning_map(...)")
    ax = get_axes(ax, figsize=(7.2, 4.4))
    boundaries = expand_scalars(boundaries, "frequency_ratio").sortby("frequency_ratio")
    ratios = boundaries.frequency_ratio.values
    edges = boundaries.amplitude_ratio.values
    about = boundaries.attrs
    lowest = about["lowest_amplitude_ratio"]
    highest = about["highest_amplitude_ratio"]
    # Each column reaches halfway to its neighbours.
    widths = np.gradient(ratios) if ratios.size > 1 else 0.1 * ratios
    # The outcome changes at every boundary: the block overturns in areas of odd number. Missing
    # boundaries are placed at the highest amplitude, where an area has no height.
    levels = np.pad(np.nan_to_num(edges, nan=highest), ((0, 0), (1, 1)))
    levels[:, 0] = lowest
    levels[:, -1] = highest
    numbers = boundaries.overturns_first.values[:, None] + np.arange(levels.shape[1] - 1)
    heights = np.diff(levels)
    overturns: dict[str, Any] = {"color": "0.8", "label": "overturns"}
    survives: dict[str, Any] = {
        "color": "w",
        "edgecolor": "0.6",
        "hatch": "////",
        "label": "survives again",
    }
    for look, chosen in (
        (overturns, numbers % 2 == 1),
        (survives, (numbers % 2 == 0) & (numbers > 0)),
    ):
        row, column = np.nonzero(chosen & (heights > 0))
        bottom = levels[row, column]
        if row.size:
            where = ratios[row], heights[row, column], widths[row], bottom
            ax.bar(*where, linewidth=0, zorder=0, **look)
    impacts = np.where(np.isfinite(edges), np.minimum(boundaries.impacts.values, 2), -1)
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
    tick_decades(ax.yaxis, (1.0, 2.0, 3.0, 5.0))
    sides = ratios[0] - widths[0] / 2, ratios[-1] + widths[-1] / 2
    ax.set(xlim=sides, ylim=(lowest, highest))
    set_title(ax, about, about["motion"])
    ax.legend(**BESIDE)
    vertical = write_amplitude_ratio("a_p", about["model"])
    return label_axes(ax, r"frequency ratio $\omega_p/p$ [-]", vertical)
