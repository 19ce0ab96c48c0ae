"""What an answer depends on: swings, maps of slopes, scatter."""

from typing import TYPE_CHECKING

import numpy as np

from .axes import ACCENT, INK, LIGHT, axes_or_new, draws, label_of, labelled

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray

    from ..sensitivity import MomentEstimate, TornadoBars


@draws
def plot_tornado(
    swing: "TornadoBars", ax: "matplotlib.axes.Axes | None" = None, label: str = "answer"
) -> "matplotlib.axes.Axes":
    """Draw what each number can do to an answer within its range.

    Parameters
    ----------
    swing : TornadoBars
        From `jaxrock.tornado`.
    label : str
        Of the answer, with its unit.
    """
    ax = axes_or_new(ax)
    rows = np.arange(len(swing.names))[::-1]
    for ends, limits, colour, name in (
        (swing.at_low, swing.low, INK, "low"),
        (swing.at_high, swing.high, LIGHT, "high"),
    ):
        width = np.nan_to_num(ends - swing.value)
        ax.barh(rows, width, left=swing.value, height=0.6, color=colour, label=f"at the {name} end")
        others = swing.at_high if ends is swing.at_low else swing.at_low
        for row, limit, end, other in zip(rows, limits, ends, others, strict=True):
            # Where there is no answer, on the side that the other end leaves free.
            missing = not np.isfinite(end)
            outward = other < swing.value if missing else end >= swing.value
            ax.annotate(
                f"{limit:.4g}: no answer" if missing else f"{limit:.4g}",
                (swing.value if missing else end, row),
                xytext=(3 if outward else -3, 0),
                textcoords="offset points",
                ha="left" if outward else "right",
                va="center",
                fontsize="small",
            )
    ax.axvline(swing.value, color="0.2", linewidth=0.8)
    ax.set_yticks(rows, [name.replace("_", " ") for name in swing.names])
    ax.margins(x=0.15)
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
    labelled(ax, label, "").grid(visible=False, axis="y")
    return ax


@draws
def plot_sensitivity_map(
    slopes: "xarray.DataArray",
    ax: "matplotlib.axes.Axes | None" = None,
    limit: float | None = None,
) -> "matplotlib.axes.Axes":
    """Draw a slope or an elasticity over two numbers, its sign by colour.

    White is zero, and the thick line; below, contours are dashed. Hatched where there is no
    value.

    Parameters
    ----------
    slopes : xarray.DataArray
        With two dimensions, the second one the horizontal axis.
    limit : float, optional
        End of the colours, so that several maps share them; by default 95 % of the values are
        within, since the steepest of all, at the verge, would hide the rest.

    Raises
    ------
    ValueError
        If there are not two dimensions.
    """
    from matplotlib.ticker import MaxNLocator

    if slopes.ndim != 2:
        raise ValueError(f"slopes must have two dimensions, got {slopes.dims}")
    ax = axes_or_new(ax)
    vertical, horizontal = (slopes[name] for name in slopes.dims)
    values = slopes.values
    known = values[np.isfinite(values)]
    if limit is None:
        limit = float(np.quantile(abs(known), 0.95)) if known.size else 0.0
    limit = limit or 1.0
    place = (horizontal.values, vertical.values)
    ax.patch.set(hatch="////", edgecolor="0.8", facecolor="w")
    mesh = ax.pcolormesh(*place, values, cmap="PuOr", vmin=-limit, vmax=limit, shading="nearest")
    levels = MaxNLocator(9, symmetric=True).tick_values(-limit, limit)
    drawn = [level for level in levels if (known < level).any() and (known > level).any()]
    if drawn and min(values.shape) > 1:
        lines = ax.contour(
            *place,
            values,
            levels=drawn,
            colors="0.2",
            linewidths=[2.0 if level == 0 else 0.7 for level in drawn],
        )
        ax.clabel(lines, fontsize="x-small")
    named = slopes.rename(None) if "long_name" in slopes.attrs else slopes
    extend = "both" if (abs(known) > limit).any() else "neither"
    ax.figure.colorbar(mesh, ax=ax, extend=extend, label=label_of(named))
    labelled(ax, label_of(horizontal), label_of(vertical)).grid(visible=False)
    return ax


@draws
def plot_distribution(
    samples: np.ndarray,
    scatter: "MomentEstimate | None" = None,
    ax: "matplotlib.axes.Axes | None" = None,
    label: str = "answer",
) -> "matplotlib.axes.Axes":
    """Draw how an answer scatters.

    With the normal distributions of first and second order, if these are given.

    Parameters
    ----------
    samples : ndarray, shape (samples,)
        From `jaxrock.sensitivity.monte_carlo`; NaN where there is no answer.
    scatter : MomentEstimate, optional
        From `jaxrock.sensitivity.propagate`.
    label : str
        Of the answer, with its unit.

    Raises
    ------
    ValueError
        If no sample has an answer.
    """
    samples = np.asarray(samples)
    known = samples[np.isfinite(samples)]
    if not known.size:
        raise ValueError("samples must have at least one answer")
    ax = axes_or_new(ax)
    edges = np.histogram_bin_edges(known, bins=min(60, 10 + known.size // 50))
    heights = np.histogram(known, edges)[0] / samples.size
    ax.stairs(heights, edges, fill=True, color="0.8", label=f"{samples.size:,} samples")
    if scatter is not None:
        place = np.linspace(edges[0], edges[-1], 400)
        for mean, deviation, look, name in (
            (
                scatter.first_order_mean,
                scatter.first_order_standard_deviation,
                ":",
                "normal, first order",
            ),
            (scatter.mean, scatter.standard_deviation, "-", "normal, second order"),
        ):
            if deviation > 0:
                share = np.exp(-0.5 * ((place - mean) / deviation) ** 2) / np.sqrt(2 * np.pi)
                share *= (edges[1] - edges[0]) / deviation
                colour = ACCENT if look == ":" else INK
                ax.plot(place, share, look, color=colour, label=name)
        if not scatter.valid:
            ax.set_title("neither order holds", fontsize="medium")
    missing = 100 * (1 - known.size / samples.size)
    if missing:
        ax.plot([], [], " ", label=f"{missing:.1f} % without an answer")
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False)
    return labelled(ax, label, "share of samples in a bin [-]")


@draws
def plot_shares(
    scatter: "MomentEstimate", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw which share of the variance of an answer comes from which number.

    Parameters
    ----------
    scatter : MomentEstimate
        From `jaxrock.sensitivity.propagate`.
    """
    ax = axes_or_new(ax, figsize=(5.0, 1.2 + 0.4 * len(scatter.shares)))
    shares = sorted(scatter.shares.items(), key=lambda pair: pair[1])
    names = [name.replace("_", " ") for name, _ in shares]
    bars = ax.barh(names, [100 * share for _, share in shares], color=INK)
    ax.bar_label(bars, fmt=" {:.1f}", fontsize="small")
    ax.set_xlim(0, 110)
    labelled(ax, "share of the variance, first order [%]", "").grid(visible=False, axis="y")
    return ax
