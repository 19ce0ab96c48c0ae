"""Spectra: one panel of curves, and whole figures of panels."""

import itertools
import textwrap
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..block import Block
from ..grids import expand_scalars
from ..resonance import critical_slenderness
from ..validation import as_name, as_text
from .axes import (
    BACKDROP,
    BESIDE,
    CURVES,
    LINE,
    NEUTRAL,
    POINTS,
    check_dataset,
    check_result,
    get_axes,
    label_axes,
    write_label,
)

_Data = TypeVar("_Data", xarray.DataArray, xarray.Dataset)
_POINTS = 500  # of a curve; more lie closer together than the width of its line
# Least distance of two thresholds that are written, as a fraction of the axis.
_LABEL_DISTANCE = 0.14
# What is counted where not all values of a dimension are drawn.
_COUNTED = {
    "width": "widths",
    "slenderness": "slenderness values",
    "restitution": "restitutions",
    "intensity": "intensities",
}


class _Curve(NamedTuple):
    """Curve of a panel: its level of the dimension `hue`, colour and line, and its points."""

    level: float
    colour: np.ndarray
    line: Line2D
    x: np.ndarray
    y: np.ndarray


def plot_curves(
    variable: xarray.DataArray,
    hue: str,
    along: str = "slenderness",
    ax: Axes | None = None,
    thresholds: xarray.DataArray | None = None,
) -> Axes:
    """Draw one panel of a spectrum, and mark where a curve ends: the block overturns.

    The end is marked by a cross, or by an arrow for a period, which grows without bound.

    Parameters
    ----------
    variable : xarray.DataArray
        With dimensions `along` and `hue` only, each of which may be a scalar coordinate
        instead, for example ``spectrum.rotation_ratio.sel(restitution=0.6)``.
    hue, along : str
        Dimension that distinguishes the curves, and dimension of the horizontal axis.
    thresholds : xarray.DataArray, optional
        For each `hue`, the value beyond which the block overturns. It is written at the end
        of the curve. A rotation ratio is drawn up to this value, where it is 1.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If `variable` has other dimensions.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)
    >>> axes = jr.plot.plot_curves(spectrum.rotation_ratio, hue="width")
    """
    check_result(
        "variable", variable, xarray.DataArray, "resonance_spectrum(...).rotation_ratio"
    )
    hue = as_text(hue)
    along = as_text(along)
    ax, curves = _draw_curves(variable, hue, along, ax)
    name = "overturns beyond" if thresholds is None else "overturning threshold"
    marker = "x"
    if variable.name == "stabilized_period":
        # Where its last value lies depends on the grid: the period itself has no end.
        name = "grows without bound,\noverturns beyond"
        marker = "^"
    written: list[float] = []
    for level, colour, line, x, y in curves:
        last = _find_ends(y)
        if not last.any():
            continue
        ends = x[last], y[last]
        limit = np.nan if thresholds is None else float(thresholds.sel({hue: level}))
        if limit > x[last][-1] and variable.name != "stabilized_period":
            # Close to the threshold the ratio lacks of 1 the square root of what the
            # slenderness lacks of the threshold: the parabola that is drawn here.
            remaining = np.linspace(0, 1, 30)[::-1]
            k = int(np.flatnonzero(last)[-1])
            missing = limit - (limit - x[k]) * remaining**2, 1 - (1 - y[k]) * remaining
            line.set_data(*np.hstack([(x[: k + 1], y[: k + 1]), missing]))
            ends = [limit], [1.0]
        least = _LABEL_DISTANCE * (x[-1] - x[0])
        # Beside an end of the axis the text keeps within it.
        place = float(np.clip(limit, x[0] + least / 2, x[-1] - least / 2))
        if limit > x[last][-1] and all(abs(place - taken) > least for taken in written):
            written.append(place)
            # As the report on the paper rounds it. By points, since an axis may be of seconds.
            ax.annotate(
                f"{limit:#.3g}",
                (place, ends[1][-1]),
                (0, 4),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize="small",
                color=colour,
            )
            # A text is not part of what limits follow.
            ax.update_datalim([(limit, 1.05 * ends[1][-1])], updatex=False)
        ax.plot(*ends, linestyle="", marker=marker, color=colour)
        ax.plot([], linestyle="", marker=marker, color=LINE, label=name)
        name = ""  # one entry in the legend for the crosses of all curves
    empty = _write_fallen(ax, curves)
    ax = _finish_panel(ax, variable, hue)
    if empty and thresholds is not None and variable.name != "stabilized_period":
        ax.set_ylim(0, 1.1)
    return ax


def _write_fallen(ax: Axes, curves: list[_Curve]) -> bool:
    """Write into a panel which curves have no value; return whether none has any."""
    fallen = [
        str(curve.line.get_label()) for curve in curves if not np.isfinite(curve.y).any()
    ]
    empty = len(fallen) == len(curves)
    if fallen:
        levels = "all" if empty else textwrap.fill(", ".join(fallen), 20)
        # At the foot, where curves of ratios are rarely: they rise to the right.
        place = {"transform": ax.transAxes, "ha": "right", "va": "bottom"}
        text = f"overturn throughout:\n{levels}"
        ax.text(0.98, 0.03, text, fontsize="small", color=LINE, bbox=BACKDROP, **place)
    return empty


def _draw_curves(
    variable: xarray.DataArray, hue: str, along: str, ax: Axes | None
) -> tuple[Axes, list[_Curve]]:
    """Draw a panel with a curve for each level of `hue`; return the axes and the curves."""
    variable = expand_scalars(variable, along, hue)
    if set(variable.dims) != {along, hue}:
        raise ValueError(
            f"variable must have the dimensions {along} and {hue}, got {variable.dims}"
        )
    ax = get_axes(ax)
    curves = []
    variable = variable.sortby(along)
    x = variable[along].values
    levels = variable[hue].values
    names = _name_levels(levels)
    # From dark to light, stopping before colours too pale to read.
    colours = matplotlib.colormaps["cividis"](np.linspace(0, 0.85, levels.size))
    looks = itertools.cycle(CURVES if x.size > 1 else POINTS)
    for level, name, colour, look in zip(levels, names, colours, looks, strict=False):
        y = variable.sel({hue: level}).values
        (line,) = ax.plot(x, y, color=colour, label=name)
        line.set(**look)
        curves.append(_Curve(level, colour, line, x, y))
    if x.size > 1:
        ax.set_xlim(x[0], x[-1])
    return label_axes(ax, write_label(variable[along]), write_label(variable)), curves


def _name_levels(levels: np.ndarray) -> list[str]:
    """Write levels in four digits; in as many as they have where four would make two alike."""
    short = [f"{level:.4g}" for level in levels]
    return short if len(set(short)) == len(short) else [f"{level:g}" for level in levels]


def _finish_panel(ax: Axes, variable: xarray.DataArray, hue: str) -> Axes:
    """Add the legend, and let the axis begin at 0 unless there are negative values."""
    if not (variable < 0).any():
        ax.set_ylim(bottom=0, auto=True)
    ax.legend(**BESIDE, title=write_label(variable[hue]))
    return ax


def _find_ends(y: np.ndarray) -> np.ndarray:
    """Find the values that have none on one side of them: the ends of a curve."""
    standing = np.isfinite(y)
    # What lies beyond the axis counts as a value: a curve that reaches its end has no cross
    # there.
    return standing & ~(np.append(standing[1:], True) & np.append(True, standing[:-1]))


def plot_spectrum(spectrum: xarray.Dataset, variable: str = "rotation_ratio") -> Figure:
    """Draw a variable over slenderness, restitutions in columns and intensities in rows.

    Each width has a curve. If a dimension has too many values to distinguish (more than 4
    panels a side, 7 curves, 500 points of a curve), an evenly chosen part of them is drawn,
    and a line at the foot says how many of all values that is. `plot_curves` draws one panel.
    Rotation ratios are drawn up to the overturning threshold, which is known in closed form.

    Parameters
    ----------
    spectrum, variable : xarray.Dataset, str
        From `jaxrock.resonance_spectrum`, and the name of one of its variables.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the spectrum has no such variable.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)
    >>> figure = jr.plot.plot_spectrum(spectrum)
    """
    check_dataset("spectrum", spectrum, ("slenderness",), "resonance_spectrum(...)")
    variable = as_name("variable", variable, map(str, spectrum.data_vars))
    about = spectrum.attrs
    # Spectra to a tolerance have the model "auto": the threshold of the nonlinear equation is
    # true.
    model = "linearized" if about["model"] == "linearized" else "nonlinear"

    def draw(curves: xarray.DataArray, panel: Axes) -> None:
        """Draw the curves of one restitution and intensity."""
        thresholds = None
        # Closer to the threshold than any grid is the curve of the ratio, which reaches 1.
        if variable in ("rotation_ratio", "stabilized_period"):
            widths = np.atleast_1d(curves.width.values)
            block = Block(widths / 2, 1.0, about["gravity"], about["inertia_ratio"])
            numbers = float(curves.restitution), float(curves.intensity)
            limits = critical_slenderness(block, *numbers, model=model)
            thresholds = xarray.DataArray(np.asarray(limits), {"width": widths})
        plot_curves(curves, hue="width", ax=panel, thresholds=thresholds)
        pulses = f", $I$ = {curves.intensity:g} m/s" if "intensity" in curves.coords else ""
        panel.set_title(f"$C$ = {curves.restitution:g}{pulses}")

    most = {"width": 7, "slenderness": _POINTS, "restitution": 4, "intensity": 4}
    return _draw_panels(spectrum[variable], draw, (3.2, 3.0), **most)


def _draw_rocking_curves(spectrum: xarray.Dataset, ax: Axes) -> None:
    """Draw the panel of one restitution, or Housner's, with a curve for each slenderness."""
    standing = spectrum.rotation_ratio.where(spectrum.overturned == 0)
    ax, curves = _draw_curves(standing, hue="slenderness", along="free_period", ax=ax)
    for k, (_, colour, _, x, y) in enumerate(curves):
        # A single period at which the block stands is a line of no length: it gets a dot.
        stands = np.isfinite(np.pad(y, 1, constant_values=np.nan))
        alone = stands[1:-1] & ~stands[:-2] & ~stands[2:]
        ax.plot(x[alone], y[alone], ".", color=colour)
        # Bars reach halfway to neighbours. Beyond both ends the block counts as standing, so
        # that bars begin and end within the axes.
        sides = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
        stands[[0, -1]] = True
        change = np.diff(stands.astype(int))
        bars = sides[change < 0], sides[change > 0]
        ax.hlines(
            np.full(bars[0].size, 0.97 - 0.035 * k),
            *bars,
            color=colour,
            linewidth=4,
            transform=ax.get_xaxis_transform(),  # the height in parts of the axes
        )
    if not np.isfinite(standing).all():
        ax.plot([], [], color=NEUTRAL, linewidth=4, label="overturns")
        # Room for the bars above the highest value; where all overturn, a ratio of 1 stands
        # in.
        top = float(np.nan_to_num(standing.max(), nan=1.0)) / (0.93 - 0.035 * len(curves))
        ax.update_datalim([(np.nan, top)], updatex=False)
    _finish_panel(ax, standing, "slenderness")
    ax.set_ylabel(r"peak rotation $|\alpha|_{max}/\alpha_c$ [-]")
    given = "restitution" in spectrum.coords
    is_one_sided = bool(spectrum.attrs.get("one_sided"))
    default = "one-sided $C$ by size" if is_one_sided else "Housner's $C$"
    title = f"$C$ = {spectrum.restitution.item():g}" if given else default
    if given and is_one_sided:
        title = f"{title}, one-sided"
    record = spectrum.attrs.get("record")
    if "floor_period" in spectrum.attrs:
        title = f"{title}, on a floor of {spectrum.attrs['floor_period']:g} s"
    ax.set_title(
        f"{title}, {record} scaled by {spectrum.attrs.get('scale', 1):g}" if record else title
    )


def plot_rocking_spectrum(spectrum: xarray.Dataset) -> Figure:
    """Draw peak rotation over the period 2 pi / p, a panel for each restitution.

    Each slenderness has a curve. Where the block overturns, a bar at the top replaces it, in
    the order of the legend. If there are too many values to distinguish (more than 4 panels,
    5 curves), an evenly chosen part of them is drawn, and a line at the foot says how many of
    all values that is.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.rocking_spectrum`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.rocking_spectrum(jr.Sine(4.0, 0.5), [2.0, 4.0], slenderness=5.0)
    >>> figure = jr.plot.plot_rocking_spectrum(spectrum)
    """
    check_dataset("spectrum", spectrum, ("free_period", "overturned"), "rocking_spectrum(...)")
    return _draw_panels(
        spectrum, _draw_rocking_curves, (4.0, 3.6), slenderness=5, restitution=4
    )


def _draw_panels(
    data: _Data, draw: Callable[[_Data, Axes], object], size: tuple[float, float], **most: int
) -> Figure:
    """Draw a panel for each intensity and restitution, and one legend for all of them.

    Parameters
    ----------
    data, draw : DataArray or Dataset, callable
        Whole spectrum, and the function that draws one panel of it on axes.
    size : tuple of float
        Width and height of a panel [inches].
    most : int
        By the name of a dimension, the largest number of its values that are drawn.
    """
    shown = []
    for name, number in most.items():
        there = data.sizes.get(name, 1)
        if there > number:
            chosen = np.linspace(0, there - 1, number).round().astype(int)
            data = data.isel({name: chosen})
            shown.append(f"{number} of {there:,} {_COUNTED[name]}")
    rows, columns = (data.sizes.get(name, 1) for name in ("intensity", "restitution"))
    # A panel has room for its legend and its title besides.
    figsize = (1.6 + size[0] * columns, 0.6 + size[1] * rows)
    figure, panels = plt.subplots(
        rows,
        columns,
        sharex=True,
        sharey=True,
        squeeze=False,
        figsize=figsize,
        layout="constrained",
    )
    for (row, column), panel in np.ndenumerate(panels):
        draw(data.isel(intensity=row, restitution=column, missing_dims="ignore"), panel)
        panel.label_outer()
    if shown:
        figure.supxlabel(f"{', '.join(shown)} shown", fontsize="small", color=LINE)
    # One legend, from the panel with the most entries: crosses and bars are not in all of
    # them.
    legends = [panel.get_legend() for panel in panels.flat]
    entries = max(
        (p.get_legend_handles_labels() for p in panels.flat), key=lambda e: len(e[1])
    )
    for legend in legends:
        legend.remove()
    panels[0, -1].legend(*entries, **BESIDE, title=legends[0].get_title().get_text())
    return figure
