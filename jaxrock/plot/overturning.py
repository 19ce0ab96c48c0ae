"""Boundaries between standing and overturning along a quantity, and critical intensities."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..block import Block
from ..overturning import Boundaries
from ..resonance import Linearized, Nonlinear, critical_intensity
from ..validation import Number
from .axes import (
    ABOVE,
    ACCENT,
    BACKDROP,
    INK,
    NEUTRAL,
    check_result,
    get_axes,
    label_axes,
    tick_decades,
    write_parameter_label,
)

_STANDS = "0.88"
# Least distance between the labels of two boundaries, as a fraction of the axis.
_LABEL_DISTANCE = 0.025
_MOST_HALF_CYCLES = 20


def plot_boundaries(
    boundaries: Boundaries,
    ends: tuple[float, float],
    ax: Axes | None = None,
    *,
    uplift: float | None = None,
) -> Axes:
    """Draw where a block stands and where it overturns, along a quantity.

    Boundaries are labelled where there is room, the first one always. The axis says how many
    are not labelled.

    Parameters
    ----------
    boundaries : Boundaries
        Of one block, from `jaxrock.overturning_boundaries`, `jaxrock.critical_amplitude`,
        `jaxrock.critical_duration` or `jaxrock.overturning.critical_factor`.
    ends : tuple of two floats
        First and last of the values that were examined.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.
    uplift : float, optional
        Value of the quantity from which on the block is lifted. It is marked.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If `boundaries` is of several blocks, or not complete.

    Examples
    --------
    >>> import jaxrock as jr
    >>> boundaries = jr.critical_duration(jr.Block(0.1, 5.0), 0.9, jr.HalfSine, 4.0, (0.01, 1.0))
    >>> axes = jr.plot.plot_boundaries(boundaries, (0.01, 1.0))
    """
    check_result("boundaries", boundaries, Boundaries, "overturning_boundaries(...)")
    if np.ndim(boundaries.count):
        raise ValueError(
            f"boundaries must be of one block, got an array of shape {np.shape(boundaries.count)}"
        )
    if not bool(boundaries.complete):
        raise ValueError("boundaries must be complete, got an integration that did not finish")
    ax = get_axes(ax, figsize=(8.0, 2.6))
    values = np.asarray(boundaries.value)
    edges = np.concatenate([[ends[0]], values, [ends[1]]])
    overturns = np.append(
        bool(boundaries.overturns_first), np.asarray(boundaries.overturns_beyond)
    )
    # Both in one order in the legend, whichever comes first along the quantity.
    for falls, colour, label in ((False, _STANDS, "stands"), (True, ACCENT, "overturns")):
        spans = [
            (low, high - low)
            for low, high, does in zip(edges[:-1], edges[1:], overturns, strict=True)
            if does == falls
        ]
        if spans:
            ax.broken_barh(spans, (0, 1), linewidth=0, color=colour, label=label)
    # Outcomes are as they are with a factor, which is the same on a wide scale as on a small.
    if ends[0] > 0 and ends[1] / ends[0] > 8:
        ax.set_xscale("log")
        tick_decades(ax.xaxis)
    ax.set(xlim=_widen_range(ends, uplift, ax.get_xscale() == "log"), ylim=(0, 1))
    if uplift is not None and np.isfinite(uplift):
        line = {"color": INK, "linestyle": "--", "linewidth": 1.4}
        ax.axvline(uplift, **line, label=f"lifts off from {uplift:.4g}")
    if values.size:
        missing = values.size - _label_values(ax, edges)
        if missing:
            note = f"{missing} of {values.size} boundaries are not labelled"
            place = {"transform": ax.transAxes, "ha": "right", "va": "bottom"}
            ax.text(0.995, 0.03, note, fontsize="small", bbox=BACKDROP, **place)
    ax.set_yticks([])
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False, fontsize="small")
    return label_axes(ax, write_parameter_label(boundaries.along, varied=True), "", grid="x")


def _widen_range(
    ends: tuple[float, float], uplift: float | None, logarithmic: bool
) -> tuple[float, float]:
    """Widen the range that was examined by a little, so that a line at its end is seen."""
    known = [*ends, *([uplift] if uplift is not None and np.isfinite(uplift) else [])]
    low = min(known)
    high = max(known)
    if logarithmic:
        factor = (high / low) ** 0.02
        return low / factor, high * factor
    margin = 0.02 * (high - low)
    return low - margin, high + margin


def _label_values(ax: Axes, edges: np.ndarray) -> int:
    """Write boundaries above the axes where there is room, and return how many.

    `edges` has both ends of the range as well.
    """
    places = ax.transData.transform(np.column_stack([edges, np.zeros_like(edges)]))
    along = ax.transAxes.inverted().transform(places)[:, 0]
    # The first and the last one matter most, then those beside intervals that are seen best.
    seen = np.minimum(np.diff(along)[:-1], np.diff(along)[1:])
    seen[[0, -1]] = np.inf
    labelled: list[float] = []
    for k in 1 + np.argsort(-seen, kind="stable"):
        if any(abs(along[k] - place) < _LABEL_DISTANCE for place in labelled):
            continue
        labelled.append(float(along[k]))
        ax.annotate(
            f"{edges[k]:.4g}",
            (edges[k], 1),
            (0, 4),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            rotation=90,
            ha="center",
            va="bottom",
            fontsize="small",
        )
    return len(labelled)


def plot_critical_intensity(
    block: Block, restitution: Number, intensity: float | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the intensity of timed pulses that just overturn a block, over their number.

    Both models are drawn, with the limit for an endless sequence of pulses.

    Parameters
    ----------
    block : Block
    restitution : float
        C [-], between 0 and 1.
    intensity : float, optional
        An intensity to mark [m/s].
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Examples
    --------
    >>> import jaxrock as jr
    >>> axes = jr.plot.plot_critical_intensity(jr.Block(0.4, 5.0), 0.7, intensity=0.3)
    """
    check_result("block", block, Block, "Block.from_size(width=..., height=...)")
    ax = get_axes(ax, figsize=(6.4, 4.2))
    count = np.arange(1.0, _MOST_HALF_CYCLES + 1)
    # The models are often too close to be told apart: circles around points.
    circles = {"marker": "o", "markersize": 8, "markerfacecolor": "none", "linestyle": "none"}
    looks: tuple[tuple[Linearized | Nonlinear, dict[str, Any]], ...] = (
        (Nonlinear(), {"color": INK, "marker": ".", "linewidth": 1.2}),
        (Linearized(), {"color": ACCENT, **circles}),
    )
    for model, look in looks:
        intensities = np.asarray(critical_intensity(block, restitution, count, model))
        ax.plot(count, intensities, label=model.name, **look)
    limit = float(critical_intensity(block, restitution, np.inf, "nonlinear"))
    line = {"color": INK, "linestyle": ":", "linewidth": 1.2}
    ax.axhline(limit, **line, label=f"pulses without end: {limit:.4g} m/s")
    if intensity is not None:
        line = {"color": NEUTRAL, "linestyle": "--", "linewidth": 1.2}
        ax.axhline(intensity, **line, label=f"given: {intensity:.4g} m/s")
    ax.set_ylim(bottom=0)
    ax.set_xticks([1, 5, 10, 15, 20])
    size = f"{float(block.width):.3g} m wide, {float(block.height):.3g} m high"
    title = f"{size}, $C$ = {float(np.asarray(restitution)):.3g}"
    ax.legend(**ABOVE, ncols=2, fontsize="small", title=title)
    return label_axes(ax, "half-cycles [-]", "critical intensity [m/s]")
