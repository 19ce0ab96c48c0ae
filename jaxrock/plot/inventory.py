"""Objects ranked by the rate of overturning."""

import textwrap
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from ..risk import describe_place, name_records, write_years
from .axes import ACCENT, INK, LINE, QUANTILE, check_dataset, label_axes

_MOST = 60  # objects that one picture has at most; more would not be read
# Decades that an axis has at least, so that a single object does not fill it.
_DECADES = 2
_MOST_YEARS = 5  # numbers of years on the upper axis, which are long
_LETTERS = 60  # of a line below the axis


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
    check_dataset("dataset", dataset, ("object",), "assess_inventory(inventory, site, target)")
    shown = dataset.isel(object=slice(None, _MOST))
    number = shown.object.size
    has_new_axes = ax is None
    if ax is None:
        _, ax = plt.subplots(layout="constrained", figsize=(8.0, 2.1 + 0.3 * number))
    figure: Any = ax.figure
    target = float(shown.attrs["target"])
    rate = shown.rate.values
    rows = np.arange(number)[::-1]
    half = _compute_half_widths(shown)
    low, high = _choose_ends(shown)
    # Marks differ as well as colours, for prints in grey.
    for above, colour, mark in ((True, ACCENT, "D"), (False, INK, "o")):
        which = (rate > target) == above
        if not which.any():
            continue
        sides = np.stack([rate - half, rate + half])[:, which]
        ax.hlines(rows[which], *sides.clip(low), color=colour, linewidth=1.5)
        name = f"{'more' if above else 'less'} often than the target"
        at = rate[which].clip(low)
        ax.plot(at, rows[which], mark, color=colour, markersize=7, label=name, clip_on=False)
    if "rate_at_low_restitution" in shown:
        at = shown.rate_at_low_restitution.values.clip(low)
        name = "with the low end of an assumed restitution"
        style: dict[str, Any] = {"color": INK, "markerfacecolor": "white", "markersize": 5}
        ax.plot(at, rows, "o", label=name, clip_on=False, **style)
    years = f"once in {write_years(1 / target)} years"
    ax.axvline(target, color=LINE, linestyle="--", linewidth=1, label=f"target: {years}")
    ax.set(xscale="log", xlim=(low, high), ylim=(-0.7, number - 0.3))
    ranks = zip(shown["rank"].values, shown.object.values, strict=True)
    ax.set_yticks(rows, [f"{name}  {rank}" for rank, name in ranks])
    # Marks at the edge stick out.
    ax.tick_params(axis="y", length=0, pad=7)
    beside = ax.secondary_yaxis("right")
    beside.set_yticks(rows, [_describe_size(shown.isel(object=k)) for k in range(number)])
    beside.tick_params(length=0, colors=LINE)
    # Years instead of rates for those who think in them.
    top = ax.secondary_xaxis("top", functions=(_invert, _invert))
    top.set_xlabel("return period of overturning [yr]")
    top.xaxis.set_major_formatter(lambda value, _: write_years(value))
    top.xaxis.set_major_locator(LogLocator(numticks=_MOST_YEARS))
    top.xaxis.set_minor_formatter(lambda value, _: "")
    look: dict[str, Any] = {"ncols": 2, "fontsize": "small", "frameon": False}
    if has_new_axes:
        # Below all labels, which the axes do not know.
        figure.legend(loc="outside lower center", **look)
    else:
        ax.legend(**look)
    words = textwrap.fill(f"rate of overturning under {name_records(shown)}", _LETTERS)
    return label_axes(ax, f"{words} [1/yr]", "", grid="x")


def _compute_half_widths(shown: xarray.Dataset) -> np.ndarray:
    """Compute half the widths of the intervals of rates."""
    # One record has no standard error.
    sampling = QUANTILE * np.nan_to_num(shown.standard_error.values)
    return np.hypot(sampling, shown.not_detected.values)


def _describe_size(assessed: xarray.Dataset) -> str:
    """Describe the size of an object and what it needs, beside its row."""
    width = float(assessed.width)
    size = f"{width:.2f} \N{MULTIPLICATION SIGN} {float(assessed.height):.2f} m"
    return "; ".join(filter(None, [size, describe_place(assessed), str(assessed.need.values)]))


def _choose_ends(shown: xarray.Dataset) -> tuple[float, float]:
    """Choose the ends of the axis: all rates above 0, most of the intervals, and the target."""
    target = float(shown.attrs["target"])
    rates = shown.rate.values
    ends = [target, *(rates + _compute_half_widths(shown)).tolist()]
    if "rate_at_low_restitution" in shown:
        at_low = shown.rate_at_low_restitution.values
        rates = np.append(rates, at_low[np.isfinite(at_low)])
    largest = max(*ends, *rates.tolist())
    least = min([target, *(value for value in rates.tolist() if value > 0)])
    high = 1.5 * largest
    # An interval down to 0 has no place on a logarithmic axis: it ends at the edge. So does
    # what is far below the target, which would leave little room for what is near it.
    least = max(0.4 * least, 10**-_DECADES * target)
    return min(least, high / 10**_DECADES), high


def _invert(value: ArrayLike) -> ArrayLike:
    """Convert rates to return periods, and back."""
    # Matplotlib asks at 0 as well, where an axis that is not yet logarithmic begins.
    with np.errstate(divide="ignore"):
        return 1 / np.asarray(value, float)
