"""Boundaries between standing and overturning along a quantity, and critical intensities."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..block import SIZES_IN_WORDS, Block
from ..overturning import Boundaries
from ..resonance import Linearized, Nonlinear, critical_intensity
from ..tables import write_label
from ..validation import Number
from .axes import (
    ACCENT,
    BESIDE,
    INK,
    NEUTRAL,
    check_result,
    get_axes,
    label_axes,
    set_title,
    tick_decades,
)

_STANDS = "0.88"
_MOST_HALF_CYCLES = 20


def plot_boundaries(
    boundaries: Boundaries,
    ends: tuple[float, float],
    ax: Axes | None = None,
    *,
    uplift: float | None = None,
) -> Axes:
    """Draw where a block stands and where it overturns, along a quantity.

    The legend has the value of the first boundary.

    Parameters
    ----------
    boundaries : Boundaries
        Of one block, from `jaxrock.overturning_boundaries` or `jaxrock.critical_amplitude`.
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
    >>> boundaries = jr.critical_amplitude(jr.Block(0.1, 5.0), 0.9, jr.Sine, 0.5)
    >>> axes = jr.plot.plot_boundaries(boundaries, (1.962, 19.62), uplift=1.962)
    """
    check_result("boundaries", boundaries, Boundaries, "overturning_boundaries(...)")
    if np.ndim(boundaries.count):
        raise ValueError(
            f"boundaries must be of one block, got an array of shape {np.shape(boundaries.count)}"
        )
    if not bool(boundaries.complete):
        raise ValueError("boundaries must be complete, got an integration that did not finish")
    ax = get_axes(ax, figsize=(8.0, 2.2))
    values = np.asarray(boundaries.value)
    edges = np.concatenate([[ends[0]], values, [ends[1]]])
    spans: Any = np.column_stack([edges[:-1], np.diff(edges)])
    overturns = np.append(
        bool(boundaries.overturns_first), np.asarray(boundaries.overturns_beyond)
    )
    # A factor on the values means the same everywhere: a wide range has a logarithmic axis.
    if ends[0] > 0 and ends[1] / ends[0] > 8:
        ax.set_xscale("log")
        tick_decades(ax.xaxis)
    look: dict[str, Any] = {"linewidth": 0}
    ax.broken_barh(spans[~overturns], (0, 1), color=_STANDS, label="stands", **look)
    ax.broken_barh(spans[overturns], (0, 1), color=ACCENT, label="overturns", **look)
    # Matplotlib 3.10 does not count bars in its limits.
    ax.update_datalim([(ends[0], 0), (ends[1], 1)])
    ax.autoscale_view()
    line: dict[str, Any] = {"color": INK, "linewidth": 1.4}
    if values.size:
        ax.axvline(values[0], **line, label=f"first boundary: {values[0]:.4g}")
    if uplift is not None and np.isfinite(uplift):
        ax.axvline(uplift, **line, linestyle="--", label=f"lifts off from {uplift:.4g}")
    # The margin keeps a line at the limit visible.
    ax.margins(x=0.02)
    ax.set(ylim=(0, 1), yticks=[])
    ax.legend(**BESIDE, fontsize="small")
    along = boundaries.along
    return label_axes(ax, write_label(along, SIZES_IN_WORDS.get(along, "")), "", grid="x")


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
    # The models are often too close to distinguish: one has circles around the points of the
    # other.
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
    about = {"half_width": float(block.half_width), "slenderness": float(block.slenderness)}
    set_title(ax, about | {"restitution": restitution, "one_sided": block.one_sided})
    ax.legend(fontsize="small")
    return label_axes(ax, "half-cycles [-]", write_label("critical_intensity"))
