"""Shared parts of the figures: axes, labels, titles, legends, line styles."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import FigureBase
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ..tables import QUANTITIES, write_label
from ..validation import check_kind

# INK and NEUTRAL are close to the start and the middle of cividis, the map that colours the
# curves of spectra. Its lightness rises all the way, so that it can be read in grey as well.
INK = "#00204d"
ACCENT = "#b5651d"
LIGHT = "#d9b44a"
NEUTRAL = "#7c7b78"
LINE = "0.2"
RATIO = r"rotation ratio $\alpha/\alpha_c$ [-]"
QUANTILE = 1.96  # quantile of the normal distribution, for 95 %

# A legend inside the axes would hide curves: it stands on the right, or in rows above.
BESIDE: dict[str, Any] = {
    "loc": "center left",
    "bbox_to_anchor": (1, 0.5),
    "frameon": False,
}
ABOVE: dict[str, Any] = {
    "loc": "lower center",
    "bbox_to_anchor": (0.5, 1),
    "frameon": False,
    "fontsize": "small",
}

# Curves also differ without colours: first by line style, then by marker, since many markers
# hide a line.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (9, 3)), (0, (2, 1, 1, 3)))
_MARKERS = ("", "o", "s", "D", "^", "v", "P", "*", "X")
CURVES: list[dict[str, Any]] = [
    {"linestyle": style, "marker": marker, "markersize": 5, "markevery": 0.1}
    for marker in _MARKERS
    for style in _STYLES
]


def check_result(name: str, value: object, kind: type, source: str) -> None:
    """Check that an argument is the result of a function; `source` is the call."""
    check_kind(name, value, kind, hint=f"; {source} gives one")


def get_axes(ax: Axes | None, figsize: tuple[float, float] | None = None) -> Axes:
    """Return `ax`, or make new axes in a figure of this size [inches]."""
    return plt.subplots(layout="constrained", figsize=figsize)[1] if ax is None else ax


def make_figure(ax: Axes | None, figsize: tuple[float, float]) -> FigureBase:
    """Return a new figure of this size [inches], or the part of a figure where `ax` was."""
    if ax is None:
        return plt.figure(figsize=figsize, layout="constrained")
    figure, place = ax.figure, ax.get_subplotspec()
    if place is None:
        raise ValueError("ax must be one of plt.subplots here, since panels take its place")
    ax.remove()
    return figure.add_subfigure(place)


def label_axes(ax: Axes, x: str, y: str, grid: Literal["both", "x", "y"] = "both") -> Axes:
    """Label the axes, and give them a grid."""
    ax.set(xlabel=x, ylabel=y)
    ax.grid(axis=grid, alpha=0.3)
    return ax


def add_strip_above(ax: Axes, low: float, high: float) -> Axes:
    """Add axes over the top of `ax`, which shows `low` to `high` below them."""
    # The limits of `ax` leave room for the strip, and the ticks end where it begins.
    height = 0.28  # as a fraction of `ax`
    ax.set_ylim(low, low + (high - low) / (1 - height))
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(low, high)
    ax.set_yticks([tick for tick in ticks if low < tick < high])
    ax.yaxis.label.set_y((1 - height) / 2)
    above = ax.inset_axes((0, 1 - height, 1, height), sharex=ax)
    above.axhline(0, color=LINE, linewidth=0.6)
    above.tick_params(labelbottom=False)
    return above


def tick_decades(axis: Axis, steps: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Label a logarithmic axis at these multiples of powers of ten, as decimals."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def label_variable(variable: xarray.DataArray) -> str:
    """Write name, symbol and unit of a variable or a coordinate, for an axis or a legend."""
    name = str(variable.name)
    long_name = "" if name in QUANTITIES else variable.attrs.get("long_name", "")
    return write_label(name, long_name, variable.attrs.get("units"))


def write_amplitude_ratio(symbol: str, model: str) -> str:
    """Write the label of an amplitude over the acceleration that lifts a block."""
    angle = r"\alpha_c" if model == "linearized" else r"\tan\alpha_c"
    return rf"amplitude ratio ${symbol}/(g\,{angle})$ [-]"


def set_title(ax: Axes, about: Mapping[str, Any], *facts: str) -> None:
    """Write the title: the block, by the attributes of a dataset, and more facts."""
    size = restitution = ""
    # For an object selected from many, the attributes hold the parameters of all objects.
    if "slenderness" in about and np.ndim(about["slenderness"]) == 0:
        width = about.get("width", 2 * about.get("half_width", 0.0))
        size = rf"$\lambda$ = {about['slenderness']:.3g}"
        if width:
            size = f"{width:.3g} m wide, {width * about['slenderness']:.3g} m high"
    if np.size(about.get("restitution", ())) == 1:
        assumed = " (assumed)" if "restitution_assumed" in about else ""
        restitution = f"$C$ = {float(about['restitution']):.3g}{assumed}"
    wall = "one-sided" if np.all(about.get("one_sided", False)) else ""
    text = ", ".join(filter(None, [size, wall, restitution, *facts]))
    ax.set_title(textwrap.fill(text, 90), fontsize="medium")
