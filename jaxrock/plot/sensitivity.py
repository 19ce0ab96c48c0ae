"""Dependence of an answer on numbers: tornado, maps of slopes, scatter."""

from collections.abc import Sequence

import matplotlib
import matplotlib.patheffects
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ..sensitivity import MomentEstimate, TornadoBars, describe_input
from .axes import (
    ABOVE,
    ACCENT,
    INK,
    LIGHT,
    LINE,
    get_axes,
    label_axes,
    write_label,
    write_number_label,
)

# Without the darkest colours, on which neither lines nor numbers could be read.
_SIGNED = ListedColormap(matplotlib.colormaps["PuOr"](np.linspace(0.15, 0.85, 255)))
_HATCHED = {"hatch": "////", "edgecolor": "0.7", "facecolor": "w"}


def plot_tornado(bars: TornadoBars, ax: Axes | None = None, label: str = "answer") -> Axes:
    """Draw what each number can do to an answer within its range.

    An end at which there is no answer says that the block overturns there. Where it overturns
    with all numbers unchanged, the line stands beyond the highest answer.

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
    """
    ax = get_axes(ax)
    rows = np.arange(len(bars.names))[::-1]
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
    if not np.isfinite(bars.value):
        ax.set_title("it overturns with all numbers unchanged", fontsize="medium", pad=24)
    ax.set_yticks(rows, [_label_number(name, bars.sides) for name in bars.names])
    # Bars would hold the axes to the line; the texts need room on both sides.
    ax.use_sticky_edges = False
    ax.margins(x=0.2 if np.isfinite([bars.at_low, bars.at_high]).all() else 0.5)
    ax.legend(**ABOVE, ncols=2)
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


def _label_number(name: str, sides: Sequence[str]) -> str:
    """Label a number; of a size also what stays as it is where it is changed."""
    symbols = {"width": "2b", "height": "2a", "half_width": "b"}
    if name == "half_width" or (name in sides and name in symbols):
        return f"{describe_input(name)}, ${symbols[name]}$ [m]"
    return write_number_label(name)


def plot_sensitivity_map(
    slopes: xarray.DataArray, ax: Axes | None = None, limit: float | None = None
) -> Axes:
    """Draw a slope or an elasticity over two numbers, its sign by colour.

    White and the thick line are zero; contours below it are dashed. Hatched where there is
    no value, as beyond the overturning threshold: on a fine grid that ends in a smooth line.

    Parameters
    ----------
    slopes : xarray.DataArray
        With two dimensions, the second one the horizontal axis.
    limit : float, optional
        End of the colours, so that several maps share them. By default 95 % of the values
        are within: the steepest, at the overturning threshold, would hide all others.
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
    if slopes.ndim != 2:
        raise ValueError(f"slopes must have two dimensions, got {slopes.dims}")
    ax = get_axes(ax)
    vertical, horizontal = (slopes[name] for name in slopes.dims)
    values = slopes.values
    finite = values[np.isfinite(values)]
    # All slopes NaN or 0 make no range of colours.
    limit = limit or (float(np.quantile(abs(finite), 0.95)) if finite.size else 0.0) or 1.0
    grid = (horizontal.values, vertical.values, values)
    # The mesh leaves cells without a value free, where the ground of the axes shows.
    ax.patch.set(**_HATCHED)
    mesh = ax.pcolormesh(*grid, cmap=_SIGNED, vmin=-limit, vmax=limit, shading="nearest")
    levels = MaxNLocator(9, symmetric=True).tick_values(-limit, limit)
    # Matplotlib warns of a contour that is nowhere.
    levels = [level for level in levels if (finite < level).any() and (finite > level).any()]
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
    # A slope may bear the name of its answer, whose label would hide the long name.
    titled = slopes.rename(None) if "long_name" in slopes.attrs else slopes
    extend = "both" if (abs(finite) > limit).any() else "neither"
    # Above the map: beside it the label would be taken for the one of the next panel's axis.
    ax.figure.colorbar(mesh, ax=ax, extend=extend, label=write_label(titled), location="top")
    ax.set(xlabel=write_label(horizontal), ylabel=write_label(vertical))
    return ax


def plot_distribution(
    samples: np.ndarray,
    scatter: MomentEstimate | None = None,
    ax: Axes | None = None,
    label: str = "answer",
) -> Axes:
    """Draw how an answer scatters.

    Parameters
    ----------
    samples, label : ndarray, shape (samples,), str
        From `jaxrock.sensitivity.monte_carlo`, NaN where there is no answer; the name of the
        answer, with its unit.
    scatter : MomentEstimate, optional
        From `jaxrock.sensitivity.propagate`: adds the normal distributions of both orders.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If no sample has an answer.
    """
    samples = np.asarray(samples)
    finite = samples[np.isfinite(samples)]
    if not finite.size:
        raise ValueError("samples must have at least one answer")
    ax = get_axes(ax)
    # From 10 bins on, more with the samples; beyond 60 they only get rough.
    edges = np.histogram_bin_edges(finite, bins=min(60, 10 + finite.size // 50))
    heights = np.histogram(finite, edges)[0] / samples.size
    ax.stairs(heights, edges, fill=True, color="0.8", label=f"{samples.size:,} samples")
    if scatter is not None:
        place = np.linspace(edges[0], edges[-1], 400)
        first = scatter.first_order_mean, scatter.first_order_standard_deviation
        second = scatter.mean, scatter.standard_deviation
        for (mean, deviation), look, colour, name in (
            (first, ":", ACCENT, "first"),
            (second, "-", INK, "second"),
        ):
            if deviation > 0:
                share = np.exp(-0.5 * ((place - mean) / deviation) ** 2) / np.sqrt(2 * np.pi)
                share *= (edges[1] - edges[0]) / deviation
                ax.plot(place, share, look, color=colour, label=f"normal, {name} order")
        if not scatter.valid:
            ax.set_title("neither order is valid", fontsize="medium")
    if finite.size < samples.size:
        missing = 100 * (1 - finite.size / samples.size)
        ax.plot([], [], " ", label=f"{missing:.1f} % without an answer")
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False)
    return label_axes(ax, label, "share of samples in a bin [-]")


def plot_shares(scatter: MomentEstimate, ax: Axes | None = None) -> Axes:
    """Draw which share of the variance of an answer comes from which number.

    Parameters
    ----------
    scatter : MomentEstimate
        From `jaxrock.sensitivity.propagate`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    ax = get_axes(ax, figsize=(5.0, 1.2 + 0.4 * len(scatter.shares)))
    shares = sorted(scatter.shares.items(), key=lambda pair: pair[1])
    names = [describe_input(name) for name, _ in shares]
    bars = ax.barh(names, [100 * share for _, share in shares], color=INK)
    ax.bar_label(bars, fmt=" {:.1f}", fontsize="small")
    ax.set_xlim(0, 110)
    return label_axes(ax, "share of the variance, first order [%]", "", grid="x")
