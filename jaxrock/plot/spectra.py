"""Spectra: one panel of curves, and whole figures of panels."""

import itertools
from collections.abc import Callable
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .axes import BESIDE, CURVES, POINTS, axes_or_new, draws, label_of, labelled


@draws()
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
    # From dark to light, stopping short of what is too pale to read.
    colours = matplotlib.colormaps["cividis"](np.linspace(0, 0.85, levels.size))
    looks = itertools.cycle(CURVES if x.size > 1 else POINTS)
    for level, colour, look in zip(levels, colours, looks, strict=False):
        y = variable.sel({hue: level}).values
        ax.plot(x, y, color=colour, label=f"{level:g}", **look)
        standing = np.isfinite(y)
        last = standing & ~(np.append(standing[1:], True) & np.append(True, standing[:-1]))
        if last.any():
            ax.plot(x[last], y[last], linestyle="", marker="x", color=colour)
    if x.size > 1:
        ax.set_xlim(x[0], x[-1])
    if not (variable < 0).any():
        ax.set_ylim(bottom=0, auto=True)
    ax.legend(**BESIDE, title=label_of(variable[hue]))
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

    def draw(curves: xarray.DataArray, panel: Axes) -> None:
        plot_curves(curves, hue="width", ax=panel)
        pulses = f", $I$ = {curves.intensity:g} m/s" if "intensity" in curves.coords else ""
        panel.set_title(f"$C$ = {curves.restitution:g}{pulses}")

    return _panels(spectrum[variable], draw, (3.2, 3.0), width=7, restitution=4, intensity=4)


@draws()
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
    return _panels(spectrum, plot_rocking_curves, (4.0, 3.6), slenderness=5, restitution=4)


def _panels(
    data: Any, draw: Callable[[Any, Axes], Any], size: tuple[float, float], **most: int
) -> Figure:
    """A panel for each intensity and restitution, of at most so many values, and one legend."""
    for name, number in most.items():
        if data.sizes.get(name, 1) > number:
            chosen = np.linspace(0, data.sizes[name] - 1, number).round().astype(int)
            data = data.isel({name: chosen})
    rows, columns = (data.sizes.get(name, 1) for name in ("intensity", "restitution"))
    figsize = (1.6 + size[0] * columns, 0.6 + size[1] * rows)
    settings: dict[str, Any] = {"figsize": figsize, "layout": "constrained", "squeeze": False}
    figure, panels = plt.subplots(rows, columns, sharex=True, sharey=True, **settings)
    for (row, column), panel in np.ndenumerate(panels):
        draw(data.isel(intensity=row, restitution=column, missing_dims="ignore"), panel)
        if panel is not panels[0, -1]:
            panel.get_legend().remove()
        panel.label_outer()
    return figure
