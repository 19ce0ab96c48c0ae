"""Fragility curves."""

import numpy as np
import xarray
from matplotlib.axes import Axes

from ..ground_motion import REVERSED
from ..risk import LognormalFit
from .axes import (
    ACCENT,
    BESIDE,
    CURVES,
    INK,
    LIGHT,
    NEUTRAL,
    get_axes,
    label_axes,
    tick_decades,
    write_label,
)

_COLOURS = (INK, ACCENT, LIGHT, NEUTRAL)
_MARKERS = ("^", "s", "D", "o", "v", "P", "X")


def plot_fragility(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw fragility curves: probabilities of exceedance over the level, with intervals.

    Marks are counted probabilities. A band joins the limits of their Clopper-Pearson
    intervals. A line is the maximum-likelihood lognormal curve.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `jaxrock.fragility`, for one object.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If the dataset is of many objects.
    """
    if "object" in dataset.dims:
        raise ValueError(
            "dataset must be of one object, as dataset.sel(object=...) selects it"
        )
    ax = get_axes(ax, figsize=(8.0, 4.5))
    levels = dataset.level.values
    for k, threshold in enumerate(dataset.threshold.values):
        curves = dataset.sel(threshold=threshold)
        colour = _COLOURS[k % len(_COLOURS)]
        look = CURVES[k % len(CURVES)]
        # Thresholds are rotation ratios as text, or words.
        ratio = str(threshold).replace(".", "").isdigit()
        name = rf"$\alpha_{{max}} > {threshold}\,\alpha_c$" if ratio else str(threshold)
        middle, low, high = (
            curves[variable].values
            for variable in ("exceedance", "exceedance_low", "exceedance_high")
        )
        # Hollow, so that equal probabilities of several thresholds are seen on one another.
        mark = {
            "marker": _MARKERS[k % len(_MARKERS)],
            "markersize": 5,
            "markerfacecolor": "none",
        }
        ax.plot(levels, middle, linestyle="", color=colour, **mark)
        # Of a single level a band would have no width.
        if levels.size > 1:
            ax.fill_between(levels, low, high, color=colour, alpha=0.15, linewidth=0)
        else:
            ax.vlines(levels, low, high, color=colour, linewidth=1)
        # Without a fit, as where no record exceeds the threshold, there are marks alone.
        line = {"color": colour, "linestyle": look["linestyle"]}
        if np.isfinite(curves["lognormal_median"]):
            fine = np.geomspace(levels[0], levels[-1], 300)
            median, dispersion = (
                float(curves[f"lognormal_{n}"]) for n in ("median", "dispersion")
            )
            ax.plot(fine, LognormalFit(median, dispersion).at(fine), **line)
        # One entry for mark and line, which the legend would else list one by one.
        ax.plot([], [], label=name, **line, **mark)
    # A dataset that was made by hand has no attributes.
    about = dataset.attrs
    # For an object selected from many, the attributes have the parameters of all.
    if np.ndim(about.get("half_width", ())) == 0:
        width = 2 * about["half_width"]
        c = about["restitution"]
        size = f"{width:.3g} m wide, {width * about['slenderness']:.3g} m high"
        wall = ", one-sided" if about.get("one_sided") else ""
        # Both directions of a record count as one.
        directions = about.get("directions", 1)
        records = f"{dataset.record.size // directions} records"
        if directions > 1:
            records = f"{records} in both directions"
        elif all(str(name).endswith(REVERSED) for name in dataset.record.values):
            records = f"{records} in reverse direction"
        floor = f", on a {about['floor']}" if "floor" in about else ""
        # What is not usual goes to a line of its own, for which there is room.
        break_line = "\n" if wall or floor else " "
        ax.set_title(f"{size}{wall}, $C$ = {c:.3g},{break_line}{records}{floor}")
    ax.set(xscale="log", ylim=(-0.03, 1.03))
    tick_decades(ax.xaxis)
    confidence = f"{about['confidence']:.0%} " if "confidence" in about else ""
    title = f"counted (marks), with\n{confidence}intervals (bands), and\nlognormal curves"
    ax.legend(**BESIDE, title=title)
    return label_axes(ax, write_label(dataset.level), "probability of exceedance [-]")
