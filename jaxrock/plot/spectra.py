"""Spectra: one panel of curves, and whole figures of panels."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .axes import axes_or_new, draws, label_of, labelled, legend_beside, shades, style


@draws
def plot_curves(
    variable: xarray.DataArray, hue: str, along: str = "slenderness", ax: Axes | None = None
) -> Axes:
    """Draw one panel of a spectrum; a cross marks where a curve ends: the block overturns.

    Parameters
    ----------
    variable : xarray.DataArray
        With dimensions `along` and `hue` only, for example
        ``spectrum.rotation_ratio.sel(restitution=0.6)``.
    hue, along : str
        Dimensions that tell the curves apart, and of the horizontal axis.

    Raises
    ------
    ValueError
        If `variable` has other dimensions.
    """
    if set(variable.dims) != {along, hue}:
        raise ValueError(
            f"variable must have the dimensions {along} and {hue}, got {variable.dims}"
        )
    ax = axes_or_new(ax)
    variable = variable.sortby(along)
    x, levels = variable[along].values, variable[hue].values
    for index, (level, colour) in enumerate(zip(levels, shades(levels.size), strict=True)):
        y = variable.sel({hue: level}).values
        (curve,) = ax.plot(x, y, color=colour, label=f"{level:g}")
        curve.set(**style(index, points=x.size == 1))
        standing = np.isfinite(y)
        last = standing & ~(np.append(standing[1:], True) & np.append(True, standing[:-1]))
        if last.any():
            ax.plot(x[last], y[last], linestyle="", marker="x", color=colour)
    if x.size > 1:
        ax.set_xlim(x[0], x[-1])
    if not (variable < 0).any():
        ax.set_ylim(bottom=0, auto=True)
    legend_beside(ax, title=label_of(variable[hue]))
    return labelled(ax, label_of(variable[along]), label_of(variable))


def plot_spectrum(spectrum: xarray.Dataset, variable: str = "rotation_ratio") -> Figure:
    """Draw a variable over slenderness: a column for each restitution, a row for each intensity.

    A curve for each width. Of a dimension with more values than can be told apart (4 panels
    a side, 7 curves) some are drawn, evenly chosen. `plot_curves` draws a single panel.

    Parameters
    ----------
    spectrum, variable : xarray.Dataset, str
        From `jaxrock.resonance_spectrum`, and the name of one of its variables.

    Returns
    -------
    matplotlib.figure.Figure
    """
    data = _evenly_chosen(spectrum[variable], width=7, restitution=4, intensity=4)
    rows, columns = data.sizes.get("intensity", 1), data.sizes["restitution"]
    figure, panels = _panels(rows, columns, (3.2, 3.0), sharex=True)
    for (row, column), panel in np.ndenumerate(panels):
        curves = data.isel(intensity=row, restitution=column, missing_dims="ignore")
        plot_curves(curves, hue="width", ax=panel)
        title = f"$C$ = {curves.restitution.item():g}"
        if "intensity" in curves.coords:
            title += f", $I$ = {curves.intensity.item():g} m/s"
        panel.set_title(title)
    _share_legend(panels)
    return figure


@draws
def plot_rocking_curves(spectrum: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw peak rotation over the period 2 pi / p, a curve for each slenderness.

    A curve ends where the block overturns.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.rocking_spectrum`, for one restitution or Housner's: for example
        ``spectrum.sel(restitution=0.9)``.

    Raises
    ------
    ValueError
        If there are several restitutions.
    """
    standing = spectrum.rotation_ratio.where(spectrum.overturned == 0)
    ax = plot_curves(standing, hue="slenderness", along="period", ax=ax)
    ax.set_ylabel(r"peak rotation $|\alpha|_{max}/\alpha_c$ [-]")
    given = "restitution" in spectrum.coords
    ax.set_title(f"$C$ = {spectrum.restitution.item():g}" if given else "Housner's $C$")
    return ax


def plot_rocking_spectrum(spectrum: xarray.Dataset) -> Figure:
    """Draw peak rotation over the period 2 pi / p, a panel for each restitution.

    Of more values than can be told apart (4 panels, 5 curves) some are drawn, evenly
    chosen. `plot_rocking_curves` draws a single panel.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.rocking_spectrum`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    data = _evenly_chosen(spectrum, slenderness=5, restitution=4)
    figure, panels = _panels(1, data.sizes.get("restitution", 1), (4.0, 3.6))
    for k, panel in enumerate(panels[0]):
        plot_rocking_curves(data.isel(restitution=k, missing_dims="ignore"), ax=panel)
    _share_legend(panels)
    return figure


def _panels(rows: int, columns: int, size: tuple[float, float], **settings: Any) -> Any:
    figsize = (1.6 + size[0] * columns, 0.6 + size[1] * rows)
    settings |= {"figsize": figsize, "layout": "constrained", "squeeze": False}
    return plt.subplots(rows, columns, sharey=True, **settings)


def _share_legend(panels: np.ndarray) -> None:
    """Leave one legend for all panels, and labels only outside."""
    for panel in panels.flat:
        if panel is not panels[0, -1]:
            panel.get_legend().remove()
        panel.label_outer()


def _evenly_chosen(data: Any, **max_values: int) -> Any:
    """A dataset or variable with at most so many values of each dimension."""
    for name, number in max_values.items():
        size = data.sizes.get(name, 1)
        if size > number:
            data = data.isel({name: np.linspace(0, size - 1, number).round().astype(int)})
    return data
