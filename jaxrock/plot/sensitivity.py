"""Dependence of an answer on its parameters: tornado, maps of derivatives."""

import textwrap
from typing import Any, NamedTuple

import matplotlib
import matplotlib.patheffects
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize, SymLogNorm
from matplotlib.patches import Patch
from matplotlib.ticker import Locator, LogLocator, MaxNLocator

from ..sensitivity import TornadoBars
from .axes import (
    ABOVE,
    INK,
    LIGHT,
    LINE,
    check_result,
    get_axes,
    label_axes,
    write_label,
    write_parameter_label,
)

# Without the darkest colours, on which neither lines nor numbers could be read.
# Of so many colours that no stripes are seen.
_COLOURS = matplotlib.colormaps["PuOr"].resampled(2**12)
_SIGNED = ListedColormap(_COLOURS(np.linspace(0.15, 0.85, 1021)))
# Half of it, for values of one sign, from pale to dark.
_POSITIVE = ListedColormap(_COLOURS(np.linspace(0.5, 0.85, 1021)))
_NEGATIVE = ListedColormap(_COLOURS(np.linspace(0.15, 0.5, 1021)))
_MANY_TIMES = 4  # values that differ so much are coloured by their logarithms
_STEPS = (1.0, 3.0)  # of logarithmic levels: the numbers of closer ones would meet
_NAME_LENGTH = 28  # letters of a line of a name
_SENTENCE_LENGTH = 60  # letters of a line of the sentence without bars
_HATCHED = {"hatch": "////", "edgecolor": "0.7", "facecolor": "w"}


def plot_tornado(bars: TornadoBars, ax: Axes | None = None, label: str = "answer") -> Axes:
    """Draw how far each parameter moves an answer within its range.

    At an end without an answer, the figure says that the block overturns there. If the block
    overturns with all parameters unchanged, bars begin at a line beyond the highest answer. If
    it overturns at all ends as well, or if no parameter changes the answer, a sentence replaces
    the bars.

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
    if bars.reason_without_bars:
        ax = get_axes(ax, figsize=(6.4, 1.6))
        words = textwrap.fill(
            f"No bars: the answer {bars.reason_without_bars}.", _SENTENCE_LENGTH
        )
        ax.text(0.5, 0.5, words, ha="center", va="center", transform=ax.transAxes)
        ax.set(xticks=[], yticks=[])
        return label_axes(ax, label, "", grid="x")
    rows = np.arange(len(bars.names))[::-1]
    names = [
        _wrap_name(write_parameter_label(name, varied=name in ("half_width", *bars.sides)))
        for name in bars.names
    ]
    lines = max(name.count("\n") + 1 for name in names)
    # Room for the names of all bars, however many there are.
    ax = get_axes(ax, figsize=(6.4, max(2.4, 1.4 + rows.size * (0.4 + 0.18 * lines))))
    middle = _place_middle(bars)
    lengths = np.nan_to_num([bars.at_low - middle, bars.at_high - middle])
    sides = _choose_sides(lengths)
    for k, (ends, limits, colour, name) in enumerate(
        (
            (bars.at_low, bars.low, INK, "low"),
            (bars.at_high, bars.high, LIGHT, "high"),
        )
    ):
        # The longer of two bars on one side must not hide the shorter one.
        shorter = abs(lengths[k]) < abs(lengths[1 - k])
        look = {"height": 0.6, "color": colour, "label": f"at the {name} end"}
        drawn = ax.barh(rows, lengths[k], left=middle, **look)
        for bar, front in zip(drawn, shorter, strict=True):
            bar.set_zorder(1.1 if front else 1.0)
        for row, end, limit, length, side in zip(
            rows, ends, limits, lengths[k], sides[k], strict=True
        ):
            # On its own side at the end of the bar, else at the middle.
            place = middle + (length if length * side > 0 else 0.0)
            text = f"{limit:.4g}" if np.isfinite(end) else f"{limit:.4g}: overturns"
            ax.annotate(
                text,
                (place, row),
                (3 * side, 0),
                textcoords="offset points",
                ha="right" if side < 0 else "left",
                va="center",
                fontsize="small",
            )
    ax.axvline(middle, color=LINE, linewidth=0.8)
    title = None if np.isfinite(bars.value) else "it overturns with all parameters unchanged"
    ax.legend(**ABOVE, ncols=2, title=title)
    ax.set_yticks(rows, names)
    ax.set_ylim(-0.5, rows.size - 0.5)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    # Bars would hold the axes to the line; the texts need room on both sides.
    ax.use_sticky_edges = False
    overturns = not np.isfinite([bars.at_low, bars.at_high]).all()
    ax.margins(x=0.6 if overturns else 0.25)
    return label_axes(ax, label, "", grid="x")


def _place_middle(bars: TornadoBars) -> float:
    """Place the line from which bars begin: at the answer, or beyond all where there is none."""
    if np.isfinite(bars.value):
        return bars.value
    ends = np.append(bars.at_low, bars.at_high)
    ends = ends[np.isfinite(ends)]
    return (
        float(ends.max() + 0.2 * (np.ptp(ends) or abs(ends.max()) or 1.0))
        if ends.size
        else 0.0
    )


def _choose_sides(lengths: np.ndarray) -> np.ndarray:
    """Choose for both ends of each bar on which side of it the text stands: -1 or 1."""
    sides = np.sign(lengths)
    low, high = sides
    # An end without a bar takes the side that the other one leaves; without any, the low end
    # stands on the left.
    low = np.where(low == 0, np.where(high == 0, -1, -high), low)
    high = np.where(high == 0, -low, high)
    # Two bars to one side: the text of the shorter one would lie in the longer one.
    same = low == high
    low_is_shorter = abs(lengths[0]) < abs(lengths[1])
    return np.array(
        [
            np.where(same & low_is_shorter, -low, low),
            np.where(same & ~low_is_shorter, -high, high),
        ]
    )


def _wrap_name(name: str) -> str:
    """Wrap the name of a parameter, with its unit on the last line of the name."""
    kept = textwrap.fill(name.replace(" [", "\N{NO-BREAK SPACE}["), _NAME_LENGTH)
    return kept.replace("\N{NO-BREAK SPACE}", " ")


def plot_sensitivity_map(
    sensitivities: xarray.DataArray, ax: Axes | None = None, limit: float | None = None
) -> Axes:
    """Draw a derivative or an elasticity over two parameters, its sign by colour.

    If both signs occur, white and the thick line are zero, and contours of negative values
    are dashed. Values of one sign go from pale to dark, on a logarithmic scale if they differ
    much, so that all colours are used. Points without a value, as beyond the overturning
    threshold, are hatched; on a fine grid the hatching ends in a smooth line.

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
    check_result(
        "sensitivities", sensitivities, xarray.DataArray, "xarray.DataArray(values, axes)"
    )
    if sensitivities.ndim != 2:
        raise ValueError(f"sensitivities must have two dimensions, got {sensitivities.dims}")
    ax = get_axes(ax)
    vertical, horizontal = (sensitivities[name] for name in sensitivities.dims)
    values = sensitivities.values
    finite = values[np.isfinite(values)]
    chosen = _choose_colours(finite, limit)
    grid = (horizontal.values, vertical.values, values)
    # The mesh leaves cells without a value free, where the ground of the axes shows.
    ax.patch.set(**_HATCHED)
    mesh = ax.pcolormesh(*grid, cmap=chosen.colours, norm=chosen.range, shading="nearest")
    # Matplotlib warns of a contour that is nowhere.
    levels = [x for x in chosen.levels if (finite < x).any() and (finite > x).any()]
    if levels and min(values.shape) > 1:
        widths = [2.0 if level == 0 else 0.7 for level in levels]
        lines = ax.contour(*grid, levels=levels, colors=LINE, linewidths=widths)
        outline = matplotlib.patheffects.withStroke(linewidth=2, foreground="w")
        for text in ax.clabel(lines, fontsize="small"):
            text.set_path_effects([outline])
    if finite.size < values.size:
        patch = Patch(label="no value: overturns")
        patch.set(**_HATCHED)
        ax.legend(handles=[patch], loc="upper right", framealpha=1, fontsize="small")
    # A derivative may bear the name of its answer, whose label would hide the long name.
    titled = (
        sensitivities.rename(None) if "long_name" in sensitivities.attrs else sensitivities
    )
    below = bool((finite < chosen.low).any())
    above = bool((finite > chosen.high).any())
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]
    # Above the map: beside it the label would be taken for the one of the next panel's axis.
    bar: dict[str, Any] = {"extend": extend, "label": write_label(titled), "location": "top"}
    drawn = ax.figure.colorbar(mesh, ax=ax, **bar)
    if isinstance(chosen.range, SymLogNorm):
        drawn.set_ticks(levels, labels=[f"{level:g}" for level in levels])
        drawn.ax.minorticks_off()
    ax.set(xlabel=write_label(horizontal), ylabel=write_label(vertical))
    return ax


class _Colours(NamedTuple):
    """Colours of a map: their range, the map itself, and the levels of contours within."""

    range: Normalize
    colours: ListedColormap
    low: float
    high: float
    levels: list[float]


def _choose_colours(finite: np.ndarray, limit: float | None) -> _Colours:
    """Choose colours so that the finite values use many of them."""
    # That signs matter is decided by more than a few values that rounding puts beyond 0.
    low, high = np.quantile(finite, (0.02, 0.98)).tolist() if finite.size else (0.0, 0.0)
    if limit is not None or low < 0 < high or low == high:
        if limit is None and finite.size:
            middle, most = np.quantile(abs(finite), (0.5, 0.95)).tolist()
            # Half of the values must not be as pale as 0.
            limit = min(most, _MANY_TIMES * middle) or most
        limit = limit or 1.0  # all derivatives NaN or 0 make no range of colours
        range_ = Normalize(-limit, limit)
        locator = MaxNLocator(9, symmetric=True)
        return _Colours(range_, _SIGNED, -limit, limit, _list_levels(locator, -limit, limit))
    sign = 1 if low >= 0 else -1
    least, most = np.quantile(sign * finite, (0.02, 0.95)).tolist()
    low, high = sorted((sign * least, sign * most))
    colours = _POSITIVE if sign > 0 else _NEGATIVE
    if most > _MANY_TIMES * least > 0:
        # Linear below `least`, which is outside of the colours: logarithmic of either sign.
        range_ = SymLogNorm(least, vmin=low, vmax=high)
        levels = sorted(sign * x for x in _list_levels(LogLocator(subs=_STEPS), least, most))
    else:
        range_ = Normalize(low, high)
        levels = _list_levels(MaxNLocator(9), low, high)
    return _Colours(range_, colours, low, high, levels)


def _list_levels(locator: Locator, low: float, high: float) -> list[float]:
    """List the levels within a range; beyond it contours lie too close for numbers."""
    return [x for x in np.asarray(locator.tick_values(low, high)).tolist() if low <= x <= high]
