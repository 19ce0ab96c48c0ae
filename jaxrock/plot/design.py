"""Inverse design: every boundary of overturning, and how the worst train was found."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .axes import ACCENT, INK, NEUTRAL, axes_or_new, draws, labelled, legend_beside

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray

    from ..resonance import WorstTrain

_MARKS = (
    (0, INK, ".", "boundary: without an impact"),
    (1, ACCENT, "x", "boundary: after one impact"),
    (2, NEUTRAL, "+", "boundary: after more impacts"),
)


@draws
def plot_overturning_map(
    found: "xarray.Dataset", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw all boundaries of overturning, and what lies between them.

    Shaded where the block overturns, hatched where it survives a stronger pulse than one
    that overturns it.

    Parameters
    ----------
    found : xarray.Dataset
        From `jaxrock.overturning_map`.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.ticker import LogLocator, NullFormatter

    ax = axes_or_new(ax, figsize=(7.2, 4.4))
    found = found.sortby("frequency_ratio")
    ratios, edges = found.frequency_ratio.values, found.amplitude_ratio.values
    low, high = found.attrs["lowest_amplitude_ratio"], found.attrs["highest_amplitude_ratio"]
    # Each is drawn halfway to its neighbours.
    step = np.diff(ratios) if ratios.size > 1 else 0.1 * ratios
    sides = ratios + np.append(step, step[-1]) / 2 if ratios.size > 1 else ratios + step / 2
    sides = np.append(ratios[0] - step[0] / 2, sides)
    shaded, hatched = [], []
    for k, first in enumerate(found.overturns_first.values):
        levels = [low, *edges[k][np.isfinite(edges[k])], high]
        for number, (bottom, top) in enumerate(pairwise(levels)):
            # Every boundary passed changes the fate.
            overturns = (number + first) % 2 == 1
            if overturns or number + first > 0:
                left, right = sides[k], sides[k + 1]
                corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
                (shaded if overturns else hatched).append(corners)
    for areas, name, colour, hatch in (
        (shaded, "overturns", "0.8", None),
        (hatched, "survives again", "w", "////"),
    ):
        if areas:
            area = PolyCollection(areas, linewidth=0, zorder=0, label=name)
            area.set(facecolor=colour, edgecolor="0.6", hatch=hatch)
            ax.add_collection(area)
    place = np.broadcast_to(ratios[:, None], edges.shape)
    impacts = np.minimum(found.impacts.values, 2)
    for mode, colour, marker, label in _MARKS:
        of_mode = (impacts == mode) & np.isfinite(edges)
        if of_mode.any():
            ax.plot(place[of_mode], edges[of_mode], marker, color=colour, markersize=4, label=label)
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xlim(sides[0], sides[-1])
    ax.set_ylim(low, high)
    angle = r"\alpha_c" if found.attrs["model"] == "linearized" else r"\tan\alpha_c"
    c, slenderness = found.attrs["restitution"], found.attrs["slenderness"]
    ax.set_title(
        rf"{found.attrs['motion']}, $\lambda$ = {slenderness:g}, $C$ = {c:.3g}",
        fontsize="medium",
    )
    if ax.get_legend_handles_labels()[0]:
        legend_beside(ax)
    return labelled(
        ax, r"frequency ratio $\omega_p/p$ [-]", rf"amplitude ratio $a_p/(g\,{angle})$ [-]"
    )


@draws
def plot_convergence(
    train: "WorstTrain", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw how far each start was from the best train, step by step.

    Parameters
    ----------
    train : WorstTrain
        From `jaxrock.worst_train`.
    """
    ax = axes_or_new(ax)
    known = train.objectives[np.isfinite(train.objectives)]
    best = {"most rotation": np.max}.get(train.goal, np.min)(known) if known.size else np.nan
    away = np.abs(train.history / best - 1)
    for path in away:
        ax.semilogy(np.maximum(path, 1e-16), color=INK, alpha=0.5, linewidth=0.9)
    ax.set_title(f"{train.goal}: {len(away)} starts", fontsize="medium")
    return labelled(ax, "step of the descent [-]", "distance from the best, relative [-]")
