"""Fragility curves."""

from typing import Any

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
    check_result,
    get_axes,
    label_axes,
    label_variable,
    set_title,
    tick_decades,
)

_COLOURS = (INK, ACCENT, LIGHT, NEUTRAL)
_MARKERS = ("^", "s", "D", "o", "v", "P", "X")


def plot_fragility(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw fragility curves: probabilities of exceedance over the level, with intervals.

    Marks are counted probabilities, a line is the maximum-likelihood lognormal curve. For the
    last threshold, a band joins the limits of the Clopper-Pearson intervals.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `jaxrock.risk.fragility`, for one object.
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
    check_result("dataset", dataset, xarray.Dataset, "fragility(block, restitution, suite)")
    if "object" in dataset.dims:
        raise ValueError(
            "dataset must be of one object, as dataset.sel(object=...) selects it"
        )
    ax = get_axes(ax, figsize=(8.0, 4.5))
    about = dataset.attrs
    levels = dataset.level.values
    # So many points that a step within the levels looks like a step.
    fine = np.geomspace(levels[0], levels[-1], 3000)
    for k, threshold in enumerate(dataset.threshold.values):
        curve = dataset.isel(threshold=k)
        # Marks are hollow, so that equal probabilities of several thresholds stay visible.
        look: dict[str, Any] = {
            "color": _COLOURS[k % len(_COLOURS)],
            "linestyle": CURVES[k % len(CURVES)]["linestyle"],
            "marker": _MARKERS[k % len(_MARKERS)],
            "markersize": 5,
            "markerfacecolor": "none",
        }
        marks: dict[str, Any] = {**look, "linestyle": ""}
        ax.plot(levels, curve.exceedance, **marks)
        # Without a fit, as when no record exceeds the threshold, there are marks alone.
        if np.isfinite(curve.lognormal_median):
            fit = LognormalFit(
                float(curve.lognormal_median), float(curve.lognormal_dispersion)
            )
            line: dict[str, Any] = {**look, "marker": ""}
            ax.plot(fine, fit.at(fine), **line)
        # One entry of the legend for mark and line together.
        ax.plot([], [], label=_name_threshold(threshold), **look)
    # Bands of several thresholds would hide each other.
    last = dataset.isel(threshold=-1)
    name = _name_threshold(last.threshold.item())
    band = f"{about.get('confidence', 0.95):.0%} interval of {name}"
    look = {"color": NEUTRAL, "alpha": 0.2, "linewidth": 0, "label": band}
    ax.fill_between(levels, last.exceedance_low, last.exceedance_high, **look)
    set_title(ax, about, _describe_records(dataset), about.get("floor", ""))
    ax.set(xscale="log", ylim=(-0.03, 1.03))
    tick_decades(ax.xaxis)
    ax.legend(**BESIDE, title="marks: counted\nlines: lognormal curves")
    return label_axes(ax, label_variable(dataset.level), "probability of exceedance [-]")


def _describe_records(dataset: xarray.Dataset) -> str:
    """Write the number of records; both directions of a record count as one."""
    directions = dataset.attrs.get("directions", 1)
    records = f"{dataset.record.size // directions} records"
    if directions > 1:
        return f"{records} in both directions"
    reverse = all(str(name).endswith(REVERSED) for name in dataset.record.values)
    return f"{records} in reverse direction" if reverse else records


def _name_threshold(threshold: object) -> str:
    """Name a threshold, which is a rotation ratio as text, or a word."""
    text = str(threshold)
    is_ratio = text.replace(".", "").isdigit()
    return rf"$\alpha_{{max}} > {text}\,\alpha_c$" if is_ratio else text
