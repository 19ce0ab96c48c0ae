"""Fragility curves."""

import textwrap

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
    check_dataset,
    get_axes,
    label_axes,
    tick_decades,
    write_label,
)

_COLOURS = (INK, ACCENT, LIGHT, NEUTRAL)
_TITLE_LENGTH = 58  # letters of a line
_SAME_MEDIAN = 0.02  # relative difference of medians of curves that are drawn once
_MARKERS = ("^", "s", "D", "o", "v", "P", "X")


def plot_fragility(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:  # noqa: PLR0915
    """Draw fragility curves: probabilities of exceedance over the level, with intervals.

    Marks are counted probabilities, a line is the maximum-likelihood lognormal curve. For the
    last threshold, a band joins the limits of the Clopper-Pearson intervals. Thresholds that
    differ by one record at most, at any level, are drawn once.

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
    check_dataset(
        "dataset", dataset, ("level", "threshold"), "fragility(block, restitution, suite)"
    )
    if "object" in dataset.dims:
        raise ValueError(
            "dataset must be of one object, as dataset.sel(object=...) selects it"
        )
    ax = get_axes(ax, figsize=(8.0, 4.5))
    levels = dataset.level.values
    groups = _group_thresholds(dataset)
    for k, group in enumerate(groups):
        curves = dataset.isel(threshold=group[-1])
        colour = _COLOURS[k % len(_COLOURS)]
        look = CURVES[k % len(CURVES)]
        *same, name = (_name_threshold(dataset.threshold.values[j]) for j in group)
        name += "".join(f"\n({other}:\nthe same within one record)" for other in same)
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
        # Bands of several thresholds would hide each other. Of a single level a band would
        # have no width.
        is_last = k == len(groups) - 1
        if is_last and levels.size > 1:
            ax.fill_between(levels, low, high, color=colour, alpha=0.15, linewidth=0)
        elif is_last:
            ax.vlines(levels, low, high, color=colour, linewidth=1)
        # Without a fit, as where no record exceeds the threshold, there are marks alone.
        line = {"color": colour, "linestyle": look["linestyle"]}
        if np.isfinite(curves["lognormal_median"]):
            median, dispersion = (
                float(curves[f"lognormal_{n}"]) for n in ("median", "dispersion")
            )
            fine = np.geomspace(levels[0], levels[-1], 300)
            # A step is seen as one.
            beside = median * np.array([1 - 1e-9, 1 + 1e-9])
            fine = np.unique(np.append(fine, beside[[levels[0] < median < levels[-1]] * 2]))
            ax.plot(fine, LognormalFit(median, dispersion).at(fine), **line)
        # One entry for mark and line, which the legend would else list one by one.
        ax.plot([], [], label=name, **line, **mark)
    # A dataset that was made by hand has no attributes.
    about = dataset.attrs
    # For an object selected from many, the attributes have the parameters of all.
    if np.ndim(about.get("half_width", ())) == 0:
        width = 2 * about["half_width"]
        c = f"{about['restitution']:.3g}{' (assumed)' * ('restitution_assumed' in about)}"
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
        source = ""
        if "record_source" in about:
            source = "\n" + textwrap.fill(about["record_source"], _TITLE_LENGTH)
        break_line = "\n" if wall or floor else " "
        ax.set_title(
            f"{size}{wall}, $C$ = {c},{break_line}{records}{floor}{source}", fontsize="medium"
        )
    ax.set(xscale="log", ylim=(-0.03, 1.03))
    tick_decades(ax.xaxis)
    confidence = f"{about['confidence']:.0%} " if "confidence" in about else ""
    banded = _name_threshold(dataset.threshold.values[-1])
    title = f"marks: counted\nlines: lognormal curves\nband: {confidence}interval of\n{banded}"
    ax.legend(**BESIDE, title=title)
    return label_axes(ax, write_label(dataset.level), "probability of exceedance [-]")


def _group_thresholds(dataset: xarray.Dataset) -> list[list[int]]:
    """Group thresholds whose probabilities differ by a record at most, and so their curves."""
    record = dataset.attrs.get("directions", 1) / dataset.sizes["record"]
    median = np.log(dataset.lognormal_median.values)
    exceedance = dataset.exceedance.transpose("threshold", "level").values
    groups: list[list[int]] = []
    for k, probabilities in enumerate(exceedance):
        first = groups[-1][0] if groups else 0
        is_near = (abs(exceedance[first] - probabilities) <= 1.001 * record).all()
        if groups and is_near and abs(median[first] - median[k]) < _SAME_MEDIAN:
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _name_threshold(threshold: object) -> str:
    """Name a threshold, which is a rotation ratio as text, or a word."""
    text = str(threshold)
    is_ratio = text.replace(".", "").isdigit()
    return rf"$\alpha_{{max}} > {text}\,\alpha_c$" if is_ratio else text
