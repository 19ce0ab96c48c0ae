"""Objects ranked by the rate of overturning."""

import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from ..risk import describe_place, write_years
from .axes import ACCENT, INK, LINE, QUANTILE, check_result, label_axes

_MOST = 60  # largest number of objects in a picture; more could not be read
# Decades: least length of the axis, and largest part of it below the target.
_DECADES = 2


def plot_inventory(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the rates of overturning of objects, the highest on top, and the target.

    A point is the rate. A line is its interval (95 %), which covers the standard error, the
    windows that were not detected and the levels beyond the last. A hollow point is the rate
    with the low end of an assumed restitution. Rates of less than a hundredth of the target
    stand at the edge. Beside each object stand its size and the width that it needs for the
    target at this height. The sixty objects with the highest rates are drawn.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `jaxrock.risk.assess_inventory`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    check_result(
        "dataset", dataset, xarray.Dataset, "assess_inventory(inventory, site, target)"
    )
    shown = dataset.isel(object=slice(None, _MOST))
    number = shown.object.size
    if ax is None:
        _, ax = plt.subplots(layout="constrained", figsize=(8.0, 2.1 + 0.3 * number))
    target = float(shown.attrs["target"])
    rate = shown.rate.values
    # One record has no standard error.
    half = np.hypot(QUANTILE * shown.standard_error.fillna(0), shown.not_detected).values
    high = 1.5 * max(target, *(rate + half))
    low = max(0.4 * min(target, *rate[rate > 0]), target / 10**_DECADES)
    low = min(low, high / 10**_DECADES)
    rows = np.arange(number)[::-1]
    # Marks differ as well as colours, for prints in grey.
    for name, which, colour, mark in (
        ("more often than the target", rate > target, ACCENT, "D"),
        ("less often than the target", ~(rate > target), INK, "o"),
    ):
        if which.any():
            sides = np.stack([rate - half, rate + half])[:, which].clip(low)
            ax.hlines(rows[which], *sides, color=colour, linewidth=1.5)
            look = {"color": colour, "markersize": 7, "label": name, "clip_on": False}
            ax.plot(rate[which].clip(low), rows[which], mark, **look)
    if "rate_at_low_restitution" in shown and shown.restitution_assumed.any():
        look = {"color": INK, "markerfacecolor": "w", "markersize": 5, "clip_on": False}
        name = "with the low end of an assumed restitution"
        low_rates = shown.rate_at_low_restitution.values.clip(low)
        ax.plot(low_rates, rows, "o", label=name, **look)
    name = f"target: once in {write_years(1 / target)} years"
    ax.axvline(target, color=LINE, linestyle="--", linewidth=1, label=name)
    ax.set(xscale="log", xlim=(low, high), ylim=(-0.7, number - 0.3))
    ranks = zip(shown["rank"].values, shown.object.values, strict=True)
    ax.set_yticks(rows, [f"{name}  {rank}" for rank, name in ranks])
    # Marks at the edge stick out.
    ax.tick_params(axis="y", length=0, pad=7)
    beside = ax.secondary_yaxis("right")
    beside.set_yticks(rows, [_describe_size(shown.isel(object=k)) for k in range(number)])
    beside.tick_params(length=0, colors=LINE)
    # A second axis shows return periods.
    top = ax.secondary_xaxis("top", functions=(_invert, _invert))
    top.set_xlabel("return period of overturning [yr]")
    top.xaxis.set_major_formatter(lambda value, _: write_years(value))
    top.xaxis.set_major_locator(LogLocator(numticks=5))
    top.xaxis.set_minor_formatter(lambda value, _: "")
    ax.figure.legend(loc="outside lower center", ncols=2, fontsize="small", frameon=False)
    return label_axes(ax, "rate of overturning [1/yr]", "", grid="x")


def _describe_size(assessed: xarray.Dataset) -> str:
    """Describe the size of an object and its required size, beside its row."""
    width = float(assessed.width)
    size = f"{width:.2f} \N{MULTIPLICATION SIGN} {float(assessed.height):.2f} m"
    return "; ".join(filter(None, [size, describe_place(assessed), str(assessed.need.values)]))


def _invert(value: ArrayLike) -> ArrayLike:
    """Convert rates to return periods, and back."""
    # Matplotlib also evaluates 0, where an axis begins before it is logarithmic.
    with np.errstate(divide="ignore"):
        return 1 / np.asarray(value, float)
