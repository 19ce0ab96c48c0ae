"""Inverse design: boundaries of overturning, and how the worst train was found."""

from itertools import pairwise

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.ticker import LogLocator, NullFormatter

from ..resonance import WorstTrain
from .axes import ACCENT, INK, NEUTRAL, axes_or_new, draws, labelled, legend_beside

_MODES = (
    (0, INK, ".", "boundary: without an impact"),
    (1, ACCENT, "x", "boundary: after one impact"),
    (2, NEUTRAL, "+", "boundary: after more impacts"),
)


@draws
def plot_overturning_map(found: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw all boundaries of overturning, and what lies between them.

    Shaded where the block overturns, hatched where it survives a stronger pulse than one
    that overturns it.

    Parameters
    ----------
    found : xarray.Dataset
        From `jaxrock.overturning_map`.
    """
    ax = axes_or_new(ax, figsize=(7.2, 4.4))
    found = found.sortby("frequency_ratio")
    ratios, edges = found.frequency_ratio.values, found.amplitude_ratio.values
    # Every column reaches halfway to its neighbours.
    step = np.diff(ratios) if ratios.size > 1 else 0.1 * ratios
    step = np.append(step, step[-1:]) if ratios.size > 1 else step
    sides = np.append(ratios[0] - step[0] / 2, ratios + step / 2)
    _draw_outcomes(ax, found, sides)
    column = np.broadcast_to(ratios[:, None], edges.shape)
    impacts = np.minimum(found.impacts.values, 2)
    for mode, colour, marker, label in _MODES:
        chosen = (impacts == mode) & np.isfinite(edges)
        if chosen.any():
            ax.plot(column[chosen], edges[chosen], marker, color=colour, markersize=4, label=label)
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    limits = found.attrs["lowest_amplitude_ratio"], found.attrs["highest_amplitude_ratio"]
    ax.set(xlim=(sides[0], sides[-1]), ylim=limits)
    angle = r"\alpha_c" if found.attrs["model"] == "linearized" else r"\tan\alpha_c"
    c, slenderness = found.attrs["restitution"], found.attrs["slenderness"]
    title = rf"{found.attrs['motion']}, $\lambda$ = {slenderness:g}, $C$ = {c:.3g}"
    ax.set_title(title, fontsize="medium")
    if ax.get_legend_handles_labels()[0]:
        legend_beside(ax)
    return labelled(
        ax, r"frequency ratio $\omega_p/p$ [-]", rf"amplitude ratio $a_p/(g\,{angle})$ [-]"
    )


def _draw_outcomes(ax: Axes, found: xarray.Dataset, sides: np.ndarray) -> None:
    """Shade where the block overturns and hatch where it survives again, column by column."""
    low, high = found.attrs["lowest_amplitude_ratio"], found.attrs["highest_amplitude_ratio"]
    shaded, hatched = [], []
    columns = zip(
        pairwise(sides), found.overturns_first.values, found.amplitude_ratio.values, strict=True
    )
    for (left, right), first, edges in columns:
        levels = [low, *edges[np.isfinite(edges)], high]
        for number, (bottom, top) in enumerate(pairwise(levels), int(first)):
            # The outcome changes at every boundary: odd numbers overturn.
            if number > 0:
                corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
                (shaded if number % 2 else hatched).append(corners)
    for areas, name, colour, hatch in (
        (shaded, "overturns", "0.8", None),
        (hatched, "survives again", "w", "////"),
    ):
        if areas:
            area = PolyCollection(areas, linewidth=0, zorder=0, label=name)
            area.set(facecolor=colour, edgecolor="0.6", hatch=hatch)
            ax.add_collection(area)


@draws
def plot_convergence(train: WorstTrain, ax: Axes | None = None) -> Axes:
    """Draw how far each start was from the best train, step by step.

    Parameters
    ----------
    train : WorstTrain
        From `jaxrock.worst_train`.
    """
    ax = axes_or_new(ax)
    reached = train.objectives[np.isfinite(train.objectives)]
    better = np.max if train.goal == "most rotation" else np.min
    best = better(reached) if reached.size else np.nan
    distances = np.abs(train.history / best - 1)
    for distance in distances:
        ax.semilogy(np.maximum(distance, 1e-16), color=INK, alpha=0.5, linewidth=0.9)
    ax.set_title(f"{train.goal}: {len(distances)} starts", fontsize="medium")
    return labelled(ax, "step of the descent [-]", "distance from the best, relative [-]")
