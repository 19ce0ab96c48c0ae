"""Dependence of an answer on its parameters: tornado, maps of derivatives."""

import textwrap
from typing import Any

import matplotlib
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize, SymLogNorm
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, MaxNLocator

from ..block import SIZES_IN_WORDS
from ..sensitivity import TornadoBars
from ..tables import write_label
from .axes import (
    ABOVE,
    INK,
    LIGHT,
    LINE,
    check_result,
    get_axes,
    label_axes,
    label_variable,
)

# The darkest colours are left out: neither lines nor numbers could be read on them. The number
# of colours avoids visible stripes.
_COLOURS = matplotlib.colormaps["PuOr"].resampled(2**12)(np.linspace(0.15, 0.85, 1021))
_MANY_TIMES = 4  # ratio of values above which logarithms are coloured
_HATCHED: dict[str, Any] = {"hatch": "////", "edgecolor": "0.7", "facecolor": "w"}


def plot_tornado(bars: TornadoBars, ax: Axes | None = None, label: str = "answer") -> Axes:
    """Draw how far each parameter moves an answer within its range.

    Below the name of each parameter stands its range; an end without an answer says that the
    block overturns there. If the block overturns with all parameters unchanged, bars begin at
    the highest answer. If it overturns at all ends as well, there are no bars.

    Parameters
    ----------
    bars, label : TornadoBars, str
        From `jaxrock.tornado`; name and unit of the answer.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> bars = jr.tornado(jr.rotation_ratio, wall, {"restitution": (0.6, 0.8)})
    >>> axes = jr.plot.plot_tornado(bars, label="rotation ratio [-]")
    """
    check_result("bars", bars, TornadoBars, "tornado(answer, at, ranges)")
    rows = np.arange(len(bars.names))[::-1]
    ax = get_axes(ax, figsize=(6.4, 1.4 + 0.6 * rows.size))
    answers = np.array([bars.at_low, bars.at_high])
    # Without any answer there are no bars.
    middle = np.nanmax([-np.inf, *answers.flat]) if np.isnan(bars.value) else bars.value
    middle = middle if np.isfinite(middle) else 0.0
    lengths = np.nan_to_num(answers - middle)
    for k, (colour, name) in enumerate(((INK, "low"), (LIGHT, "high"))):
        look = {"left": middle, "height": 0.6, "color": colour, "label": f"at the {name} end"}
        drawn = ax.barh(rows, lengths[k], **look)
        # The longer of two bars on one side must not hide the shorter one.
        for bar, shorter in zip(drawn, abs(lengths[k]) < abs(lengths[1 - k]), strict=True):
            bar.set_zorder(1.1 if shorter else 1.0)
    ax.axvline(middle, color=LINE, linewidth=0.8)
    ax.set_yticks(rows, _describe_ranges(bars))
    ax.xaxis.set_major_locator(MaxNLocator(6))
    # Otherwise bars would keep the axes at the line without a margin.
    ax.use_sticky_edges = False
    ax.margins(x=0.08)
    ax.set_ylim(-0.5, rows.size - 0.5)
    title = None if np.isfinite(bars.value) else "it overturns with all parameters unchanged"
    ax.legend(**ABOVE, ncols=2, title=title)
    return label_axes(ax, label, "", grid="x")


def _describe_ranges(bars: TornadoBars) -> list[str]:
    """Describe each parameter with its range, and at which ends the block overturns."""
    texts = []
    for k, name in enumerate(bars.names):
        label = write_label(name, SIZES_IN_WORDS.get(name, ""))
        span = " to ".join(
            f"{limit[k]:.4g}" + " (overturns)" * (not np.isfinite(answer[k]))
            for limit, answer in ((bars.low, bars.at_low), (bars.high, bars.at_high))
        )
        texts.append(f"{textwrap.fill(label, 40)}\n{span}")
    return texts


def plot_sensitivity_map(
    sensitivities: xarray.DataArray, ax: Axes | None = None, limit: float | None = None
) -> Axes:
    """Draw a derivative or an elasticity over two parameters, its sign by colour.

    If both signs occur, white and the thick line are zero, and contours of negative values
    are dashed. Values of one sign go from pale to dark, on a logarithmic scale, so that all
    colours are used. Points without a value, as beyond the overturning threshold, are hatched;
    on a fine grid the hatching ends in a smooth line.

    Parameters
    ----------
    sensitivities : xarray.DataArray
        With two dimensions, the second one the horizontal axis.
    limit : float, optional
        End of the colour scale on both sides of 0, so that several maps share it. By default
        at least the largest 5 % of the values lie beyond it, and for values of one sign the
        smallest 2 % as well: the extreme values at the overturning threshold would hide all
        others.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If there are not two dimensions.
    """
    source = "xarray.DataArray(values, axes)"
    check_result("sensitivities", sensitivities, xarray.DataArray, source)
    if sensitivities.ndim != 2:
        raise ValueError(f"sensitivities must have two dimensions, got {sensitivities.dims}")
    ax = get_axes(ax)
    vertical, horizontal = (sensitivities[name] for name in sensitivities.dims)
    values = sensitivities.values
    finite = values[np.isfinite(values)]
    colours, scale, levels = _choose_colours(finite, limit)
    grid = (horizontal.values, vertical.values, values)
    # Cells without a value stay empty, and show the background of the axes.
    ax.patch.set(**_HATCHED)
    mesh = ax.pcolormesh(*grid, cmap=ListedColormap(colours), norm=scale, shading="nearest")
    # Matplotlib warns of a contour that is out of range.
    inside = [x for x in levels if (finite < x).any() and (finite > x).any()]
    if inside and min(values.shape) > 1:
        widths = [2.0 if level == 0 else 0.7 for level in inside]
        lines = ax.contour(*grid, levels=inside, colors=LINE, linewidths=widths)
        # Numbers must be legible on dark colours as well.
        halo = withStroke(linewidth=2, foreground="w")
        for text in ax.clabel(lines, fontsize="small"):
            text.set_path_effects([halo])
    if finite.size < values.size:
        patch = Patch(label="no value: overturns", **_HATCHED)
        ax.legend(handles=[patch], loc="upper right", framealpha=1, fontsize="small")
    beyond = bool((finite < scale.vmin).any()), bool((finite > scale.vmax).any())
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[beyond]
    # A derivative may have the name of its answer, and would get the label of the answer.
    has_name = "long_name" in sensitivities.attrs
    text = label_variable(sensitivities.rename(None) if has_name else sensitivities)
    # The label stands above the map: beside it, it would look like the label of the next
    # panel.
    bar = ax.figure.colorbar(mesh, ax=ax, extend=extend, label=text, location="top")
    bar.set_ticks(levels, labels=[f"{level:g}" for level in levels])
    bar.ax.minorticks_off()
    ax.set(xlabel=label_variable(horizontal), ylabel=label_variable(vertical))
    return ax


def _choose_colours(
    finite: np.ndarray, limit: float | None
) -> tuple[np.ndarray, Normalize, list[float]]:
    """Choose colours, their range and levels of contours; the finite values use many colours."""
    # Values count as of both signs if more than a few lie beyond 0: rounding may move some.
    low, high = np.quantile(finite, (0.02, 0.98)) if finite.size else (0.0, 0.0)
    colours = _COLOURS
    if limit is not None or low <= 0 <= high:
        if limit is None and finite.size:
            middle, most = np.quantile(abs(finite), (0.5, 0.95))
            # At most half of the values may look as pale as 0.
            limit = min(most, _MANY_TIMES * middle) or most
        high = limit or 1.0  # all derivatives NaN or 0 make no range of colours
        low = -high
        scale = Normalize(low, high)
    else:
        least, most = np.quantile(abs(finite), (0.02, 0.95))
        low, high = (least, most) if low > 0 else (-most, -least)
        half = _COLOURS.shape[0] // 2
        colours = _COLOURS[half:] if low > 0 else _COLOURS[: half + 1]
        # The scale is linear below `least`, outside the range of colours, and logarithmic for
        # either sign.
        scale = SymLogNorm(least, vmin=low, vmax=high)
        if most > _MANY_TIMES * least:
            sign = np.sign(low)
            levels = sign * LogLocator(subs=(1.0, 3.0)).tick_values(least, most)
            return colours, scale, sorted(x for x in levels.tolist() if low <= x <= high)
    levels = np.asarray(MaxNLocator(9).tick_values(low, high)).tolist()
    # Beyond the range, contours are too close for numbers.
    return colours, scale, [x for x in levels if low <= x <= high]
