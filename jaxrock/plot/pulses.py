"""Pulses: rotation under trains of them, boundaries of overturning by a single one."""

import itertools

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from .. import resonance
from ..grids import expand_scalars
from ..resonance import Linearized, ModelLike, Scene
from .axes import (
    ACCENT,
    BESIDE,
    INK,
    LINE,
    NEUTRAL,
    RATIO,
    add_level,
    add_strip_above,
    check_dataset,
    check_result,
    get_axes,
    label_axes,
    tick_decades,
    write_amplitude_ratio,
)

_POINTS = 600  # of a half-cycle
_LAST = 1.2  # rotation ratio up to which a block that overturns is drawn
_LONGEST = 6.0  # how long a half-cycle is drawn at the end, times p


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
        If `half_cycles` is less than 1, or the intensity is 0.

    Examples
    --------
    >>> import jaxrock as jr
    >>> axes = jr.plot.plot_resonance(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15), half_cycles=3)
    """
    check_result("scene", scene, Scene, "Scene(block, restitution, intensity)")
    model = resonance.as_model(model)
    if half_cycles < 1:
        raise ValueError(f"half_cycles must be at least 1, got {half_cycles}")
    intensity = float(scene.intensity)
    if intensity == 0:
        raise ValueError("intensity must be greater than 0, or there is nothing to draw")
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
    # From launch to launch: of a train at fixed times every error grows from impact to impact.
    since = durations * np.linspace(0, 1, _POINTS)
    rotation = sides * np.asarray(model.motion(block, launches, since)[0])
    motion = _drop_after_overturning(
        (starts + since).ravel(), rotation.ravel() / float(block.critical_angle)
    )
    pulses = intensity * sides.ravel()
    level = float(resonance.rotation_ratio(scene, model))
    # Where the block overturns there is no stabilized peak.
    limit = (1.0, "critical angle") if np.isnan(level) else (level, "stabilized peak")
    return _draw_under_pulses(ax, motion, starts.ravel(), pulses, *limit)


def plot_overturning_map(boundaries: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw all boundaries of overturning, and what lies between them.

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
    check_dataset(
        "boundaries", boundaries, ("overturns_first", "impacts"), "overturning_map(...)"
    )
    ax = get_axes(ax, figsize=(7.2, 4.4))
    boundaries = expand_scalars(boundaries, "frequency_ratio").sortby("frequency_ratio")
    ratios = boundaries.frequency_ratio.values
    edges = boundaries.amplitude_ratio.values
    about = boundaries.attrs
    limits = about["lowest_amplitude_ratio"], about["highest_amplitude_ratio"]
    # Every column reaches halfway to its neighbours.
    step = np.diff(ratios) if ratios.size > 1 else 0.1 * ratios
    step = np.append(step, step[-1])[: ratios.size]
    sides = np.append(ratios[0] - step[0] / 2, ratios + step / 2)
    areas: tuple[list, list] = [], []
    columns = zip(
        itertools.pairwise(sides), boundaries.overturns_first.values, edges, strict=True
    )
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
    ax.set(xlim=(sides[0], sides[-1]), ylim=limits)
    numbers = rf"$\lambda$ = {about['slenderness']:g}, $C$ = {about['restitution']:.3g}"
    ax.set_title(f"{about['motion']}, {numbers}", fontsize="medium")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**BESIDE)
    vertical = write_amplitude_ratio("a_p", about["model"])
    return label_axes(ax, r"frequency ratio $\omega_p/p$ [-]", vertical)


def _drop_after_overturning(
    time: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Drop the motion from where the ratio of a block that overturns is too large to draw."""
    # Written so that NaN, which follows an overturning in closed form, is beyond as well.
    beyond = ~(abs(ratio) < _LAST)
    last = int(np.argmax(beyond)) if beyond.any() else ratio.size
    return time[:last], ratio[:last]


def _draw_under_pulses(
    ax: Axes | None,
    motion: tuple[np.ndarray, np.ndarray],
    times: np.ndarray,
    pulses: np.ndarray,
    level: float,
    name: str,
) -> Axes:
    """Draw the motion, with a named level on both sides, and the pulses in a strip above."""
    ax = get_axes(ax)
    time, ratio = motion
    ax.plot(time, ratio, color=INK, linewidth=1.1)
    ax.axhline(0, color=LINE, linewidth=0.6)
    limit = 1.1 * float(abs(ratio).max())
    if 1.1 * level < 2 * limit:  # else the motion would hardly be visible
        limit = max(limit, 1.1 * level)
        add_level(ax, level, name)
    ax.set(xlim=(-0.02 * time[-1], 1.02 * time[-1]))
    above = add_strip_above(ax, -1.3 * limit, limit)  # with room for the legend
    above.vlines(times, 0, pulses, color=ACCENT, linewidth=1.5)
    # Arrowheads at the pulses, and on the rotation where they meet the block.
    for chosen, marker in ((pulses > 0, "^"), (pulses <= 0, "v")):
        above.plot(times[chosen], pulses[chosen], marker, color=ACCENT, markersize=5)
        ax.plot(times[chosen], 0 * pulses[chosen], marker, color=ACCENT, markersize=4)
    highest = float(abs(pulses).max())
    above.set(ylim=(-1.5 * highest, 1.5 * highest), yticks=[-highest, 0, highest])
    above.yaxis.set_major_formatter("{x:.3g}")
    label_axes(above, "", "$I$ [m/s]")
    label_axes(ax, "time [s]", RATIO)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, loc="lower left")
    return ax
