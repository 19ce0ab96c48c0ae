"""Spectra: one panel of curves, and whole figures of panels."""

import itertools
from collections.abc import Callable
from typing import TypeVar

import matplotlib
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from ..block import Block
from ..grids import expand_scalars
from ..resonance import critical_slenderness
from ..validation import as_name
from .axes import (
    BESIDE,
    CURVES,
    LINE,
    check_result,
    get_axes,
    label_axes,
    label_variable,
    make_figure,
    set_title,
)

_Data = TypeVar("_Data", xarray.DataArray, xarray.Dataset)
_POINTS = 500  # points of a curve; more would be closer than the width of its line


def plot_curves(
    variable: xarray.DataArray,
    hue: str,
    along: str = "slenderness",
    ax: Axes | None = None,
    thresholds: xarray.DataArray | None = None,
) -> Axes:
    """Draw one panel of a spectrum, and mark where a curve ends: the block overturns.

    Parameters
    ----------
    variable : xarray.DataArray
        With dimensions `along` and `hue` only, each of which may be a scalar coordinate
        instead, for example ``spectrum.rotation_ratio.sel(restitution=0.6)``.
    hue, along : str
        Dimension that distinguishes the curves, and dimension of the horizontal axis.
    thresholds : xarray.DataArray, optional
        For each `hue`, the value beyond which the block overturns. A rotation ratio is drawn up
        to this value, where it is 1.
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
    source = "resonance_spectrum(...).rotation_ratio"
    check_result("variable", variable, xarray.DataArray, source)
    variable = expand_scalars(variable, along, hue)
    if set(variable.dims) != {along, hue}:
        raise ValueError(
            f"variable must have the dimensions {along} and {hue}, got {variable.dims}"
        )
    ax = get_axes(ax)
    variable = variable.sortby(along).transpose(hue, along)
    x = variable[along].values
    levels = variable[hue].values
    # From dark to light, stopping before colours too pale to read.
    colours = matplotlib.colormaps["cividis"](np.linspace(0, 0.85, levels.size))
    for y, level, colour, look in zip(
        variable.values, levels, colours, itertools.cycle(CURVES), strict=False
    ):
        is_end = _find_ends(y)
        limit = np.nan if thresholds is None else float(thresholds.sel({hue: level}))
        curve = x, y
        marks = x[is_end], y[is_end]
        if is_end.any() and limit > x[is_end][-1] and variable.name == "rotation_ratio":
            # Close to the threshold, 1 minus the ratio is proportional to the square root of
            # the threshold minus the slenderness: this parabola is drawn.
            remaining = np.linspace(0, 1, 30)[::-1]
            k = int(np.flatnonzero(is_end)[-1])
            missing = limit - (limit - x[k]) * remaining**2, 1 - (1 - y[k]) * remaining
            curve = np.hstack([(x[: k + 1], y[: k + 1]), missing])
            marks = [limit], [1.0]
        ax.plot(*curve, color=colour, label=f"{level:.4g}", **look)
        if x.size == 1:
            ax.plot(*curve, ".", color=colour)
        if is_end.any():
            ax.plot(*marks, "x", color=colour)
    if any(line.get_marker() == "x" for line in ax.lines):
        # One entry in the legend for the crosses of all curves.
        ax.plot([], [], "x", color=LINE, label="overturns beyond")
    fallen = int(variable.isnull().all(along).sum())
    if fallen:
        text = f"{fallen} of {levels.size} overturn throughout"
        # The text stands at the foot, where curves of ratios, which rise to the right, are
        # rare.
        look = {"transform": ax.transAxes, "ha": "right", "fontsize": "small", "color": LINE}
        ax.text(0.98, 0.03, text, **look)
    if x.size > 1:
        ax.set_xlim(x[0], x[-1])
    if not (variable < 0).any():
        ax.set_ylim(bottom=0, auto=True)
    ax.legend(**BESIDE, title=label_variable(variable[hue]))
    return label_axes(ax, label_variable(variable[along]), label_variable(variable))


def _find_ends(y: np.ndarray) -> np.ndarray:
    """Find the ends of a curve: values without a neighbour on one side."""
    standing = np.isfinite(y)
    # Points beyond the axis count as values: a curve that reaches the end of the axis has no
    # cross there.
    return standing & ~(np.append(standing[1:], True) & np.append(True, standing[:-1]))


def plot_spectrum(
    spectrum: xarray.Dataset, variable: str = "rotation_ratio", ax: Axes | None = None
) -> FigureBase:
    """Draw a variable over slenderness, restitutions in columns and intensities in rows.

    Each width has a curve. If a dimension has too many values to distinguish (more than 4
    panels a side, 7 curves, 500 points of a curve), an evenly chosen part of them is drawn,
    and a line at the foot says how many of all values that is. `plot_curves` draws one panel.
    Rotation ratios are drawn up to the overturning threshold, which is known in closed form.

    Parameters
    ----------
    spectrum, variable : xarray.Dataset, str
        From `jaxrock.resonance_spectrum`, and the name of one of its variables.
    ax : matplotlib.axes.Axes, optional
        Axes of `matplotlib.pyplot.subplots`, in whose place the panels stand; by default they
        stand in a new figure.

    Returns
    -------
    matplotlib.figure.Figure or matplotlib.figure.SubFigure

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
    check_result("spectrum", spectrum, xarray.Dataset, "resonance_spectrum(...)")
    variable = as_name("variable", variable, map(str, spectrum.data_vars))
    about = spectrum.attrs
    # Spectra to a tolerance have the model "auto": the threshold is that of the nonlinear
    # equation.
    model = "linearized" if about["model"] == "linearized" else "nonlinear"

    def draw(curves: xarray.DataArray, panel: Axes) -> None:
        """Draw the curves of one restitution and intensity."""
        thresholds = None
        # The curve of a ratio is extended from the grid to the threshold, where it is 1.
        if variable == "rotation_ratio":
            widths = np.atleast_1d(curves.width.values)
            block = Block(widths / 2, 1.0, about["gravity"], about["inertia_ratio"])
            numbers = float(curves.restitution), float(curves.intensity)
            limits = critical_slenderness(block, *numbers, model=model)
            thresholds = xarray.DataArray(np.asarray(limits), {"width": widths})
        plot_curves(curves, hue="width", ax=panel, thresholds=thresholds)
        pulses = f"$I$ = {curves.intensity:g} m/s" if "intensity" in curves.coords else ""
        set_title(panel, {"restitution": curves.restitution}, pulses)

    most = {"width": 7, "slenderness": _POINTS, "restitution": 4, "intensity": 4}
    return _draw_panels(spectrum[variable], draw, most, ax)


def _draw_rocking_curves(spectrum: xarray.Dataset, panel: Axes) -> None:
    """Draw the panel of one restitution, or Housner's, with a curve for each slenderness."""
    about = {"one_sided": spectrum.attrs.get("one_sided", False)}
    standing = spectrum.rotation_ratio.where(spectrum.overturned == 0)
    plot_curves(standing, hue="slenderness", along="free_period", ax=panel)
    panel.set_ylabel(r"peak rotation $|\alpha|_{max}/\alpha_c$ [-]")
    given = "restitution" in spectrum.coords
    if given:
        about["restitution"] = spectrum.restitution
    period = spectrum.attrs.get("floor_period")
    floor = f"on a floor of {period:g} s" if period else ""
    record = spectrum.attrs.get("record", "")
    scaled = f"{record} scaled by {spectrum.attrs.get('scale', 1):g}" if record else ""
    set_title(panel, about, "" if given else "$C$ by size", floor, scaled)


def plot_rocking_spectrum(spectrum: xarray.Dataset, ax: Axes | None = None) -> FigureBase:
    """Draw peak rotation over the period 2 pi / p, a panel for each restitution.

    Each slenderness has a curve, which ends in a cross where the block overturns. If there are
    too many values to distinguish (more than 4 panels, 5 curves), an evenly chosen part of
    them is drawn, and a line at the foot says how many of all values that is.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.rocking_spectrum`.
    ax : matplotlib.axes.Axes, optional
        As in `plot_spectrum`.

    Returns
    -------
    matplotlib.figure.Figure or matplotlib.figure.SubFigure

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.rocking_spectrum(jr.Sine(4.0, 0.5), [2.0, 4.0], slenderness=5.0)
    >>> figure = jr.plot.plot_rocking_spectrum(spectrum)
    """
    check_result("spectrum", spectrum, xarray.Dataset, "rocking_spectrum(...)")
    most = {"slenderness": 5, "restitution": 4}
    return _draw_panels(spectrum, _draw_rocking_curves, most, ax)


def _draw_panels(
    data: _Data,
    draw: Callable[[_Data, Axes], object],
    most: dict[str, int],
    ax: Axes | None,
) -> FigureBase:
    """Draw a panel for each intensity and restitution, and one legend for all of them.

    Parameters
    ----------
    data, draw : DataArray or Dataset, callable
        Whole spectrum, and the function that draws one panel of it on axes.
    most : dict
        Largest number of values that are drawn, by the name of the dimension.
    ax : matplotlib.axes.Axes or None
        In whose place the panels stand.
    """
    shown = []
    for name, number in most.items():
        size = data.sizes.get(name, 1)
        if size > number:
            chosen = np.linspace(0, size - 1, number).round().astype(int)
            data = data.isel({name: chosen})
            shown.append(f"{name} {number} of {size:,}")
    rows, columns = (data.sizes.get(name, 1) for name in ("intensity", "restitution"))
    # A panel has room for its title, the figure for its legend.
    figure = make_figure(ax, (1.6 + 3.2 * columns, 0.6 + 3.0 * rows))
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for (row, column), panel in np.ndenumerate(panels):
        draw(data.isel(intensity=row, restitution=column, missing_dims="ignore"), panel)
        panel.label_outer()
    if shown:
        figure.supxlabel(f"drawn: {', '.join(shown)}", fontsize="small", color=LINE)
    # The legend is that of the panel with the most entries: not all panels have crosses.
    entries = [panel.get_legend_handles_labels() for panel in panels.flat]
    title = panels[0, 0].get_legend().get_title().get_text()
    for panel in panels.flat:
        panel.get_legend().remove()
    longest = max(entries, key=lambda entry: len(entry[1]))
    panels[0, -1].legend(*longest, **BESIDE, title=title)
    return figure
