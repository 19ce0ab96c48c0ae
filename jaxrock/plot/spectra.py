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

from ..block import Block
from ..resonance import critical_slenderness
from .axes import BESIDE, CURVES, LINE, NEUTRAL, POINTS, axes_or_new, draws, label_of, labelled


@draws()
def plot_curves(
    variable: xarray.DataArray,
    hue: str,
    along: str = "slenderness",
    ax: Axes | None = None,
    thresholds: xarray.DataArray | None = None,
) -> Axes:
    """Draw one panel of a spectrum; a cross marks where a curve ends: the block overturns.

    Parameters
    ----------
    variable : xarray.DataArray
        With dimensions `along` and `hue` only, for example
        ``spectrum.rotation_ratio.sel(restitution=0.6)``.
    hue, along : str
        Dimensions that tell the curves apart, and of the horizontal axis.
    thresholds : xarray.DataArray, optional
        For each `hue` the value from which on the block overturns, of a rotation ratio: the
        curve is drawn up to there, where the ratio is 1, and the value is written beside it.

    Raises
    ------
    ValueError
        If `variable` has other dimensions.
    """
    ax, curves = _curves(variable, hue, along, ax)
    name = "overturns beyond" if thresholds is None else "overturning threshold"
    for level, colour, (curve, x, y) in curves:
        last = _last(y)
        if not last.any():
            continue
        ends = x[last], y[last]
        limit = np.nan if thresholds is None else float(thresholds.sel({hue: level}))
        if limit > x[last][-1]:
            # What is missing to 1 goes with the root of what is missing to the threshold.
            rest = np.linspace(0, 1, 30)[::-1]
            k = int(np.flatnonzero(last)[-1])
            missing = limit - (limit - x[k]) * rest**2, 1 - (1 - y[k]) * rest
            curve.set_data(*np.hstack([(x[: k + 1], y[: k + 1]), missing]))
            ends = [limit], [1.0]
            text = {"ha": "center", "fontsize": "small", "color": colour}
            ax.text(limit, 1.03, f"{limit:#.3g}", **text)
            ax.update_datalim([(limit, 1.05)], updatex=False)
        ax.plot(*ends, linestyle="", marker="x", color=colour)
        ax.plot([], linestyle="", marker="x", color=LINE, label=name)
        name = ""
    fallen = [f"{level:g}" for level, _, (_, _, y) in curves if not np.isfinite(y).any()]
    if fallen:
        place = {"transform": ax.transAxes, "ha": "right", "va": "top"}
        text = f"overturn throughout:\n{', '.join(fallen)}"
        ax.text(0.98, 0.97, text, fontsize="small", color=LINE, **place)
    ax = _finished(ax, variable, hue)
    if thresholds is not None and len(fallen) == len(curves):
        ax.set_ylim(0, 1.1)
    return ax


def _curves(
    variable: xarray.DataArray, hue: str, along: str, ax: Axes | None
) -> tuple[Axes, list[Any]]:
    """Prepare a panel of curves: of each its level, its colour and line, x and y."""
    if set(variable.dims) != {along, hue}:
        raise ValueError(
            f"variable must have the dimensions {along} and {hue}, got {variable.dims}"
        )
    ax = axes_or_new(ax)
    curves = []
    variable = variable.sortby(along)
    x = variable[along].values
    levels = variable[hue].values
    # From dark to light, stopping short of what is too pale to read.
    colours = matplotlib.colormaps["cividis"](np.linspace(0, 0.85, levels.size))
    looks = itertools.cycle(CURVES if x.size > 1 else POINTS)
    for level, colour, look in zip(levels, colours, looks, strict=False):
        y = variable.sel({hue: level}).values
        (curve,) = ax.plot(x, y, color=colour, label=f"{level:g}", **look)
        curves.append((level, colour, (curve, x, y)))
    if x.size > 1:
        ax.set_xlim(x[0], x[-1])
    return labelled(ax, label_of(variable[along]), label_of(variable)), curves


def _finished(ax: Axes, variable: xarray.DataArray, hue: str) -> Axes:
    """With a legend, and from 0 on unless there are negative values."""
    if not (variable < 0).any():
        ax.set_ylim(bottom=0, auto=True)
    ax.legend(**BESIDE, title=label_of(variable[hue]))
    return ax


def _last(y: np.ndarray) -> np.ndarray:
    """Find where there is a value, and none on one side of it."""
    standing = np.isfinite(y)
    return standing & ~(np.append(standing[1:], True) & np.append(True, standing[:-1]))


def plot_spectrum(spectrum: xarray.Dataset, variable: str = "rotation_ratio") -> Figure:
    """Draw a variable over slenderness: a column for each restitution, a row for each intensity.

    A curve for each width. Of a dimension with more values than can be told apart (4 panels
    a side, 7 curves) some are drawn, evenly chosen. `plot_curves` draws a single panel.
    Rotation ratios are drawn up to the overturning threshold, which is known in closed form.

    Parameters
    ----------
    spectrum, variable : xarray.Dataset, str
        From `jaxrock.resonance_spectrum`, and the name of one of its variables.

    Returns
    -------
    matplotlib.figure.Figure
    """
    about = spectrum.attrs
    model = "linearized" if about["model"] == "linearized" else "nonlinear"

    def draw(curves: xarray.DataArray, panel: Axes) -> None:
        thresholds = None
        if variable == "rotation_ratio" and "intensity" in curves.coords:
            block = Block(
                curves.width.values / 2, 1.0, about["gravity"], about["inertia_ratio"]
            )
            numbers = float(curves.restitution), float(curves.intensity)
            limits = critical_slenderness(block, *numbers, model=model)
            thresholds = xarray.DataArray(np.asarray(limits), {"width": curves.width})
        plot_curves(curves, hue="width", ax=panel, thresholds=thresholds)
        pulses = f", $I$ = {curves.intensity:g} m/s" if "intensity" in curves.coords else ""
        panel.set_title(f"$C$ = {curves.restitution:g}{pulses}")

    return _panels(spectrum[variable], draw, (3.2, 3.0), width=7, restitution=4, intensity=4)


@draws()
def plot_rocking_curves(spectrum: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw peak rotation over the period 2 pi / p, a curve for each slenderness.

    Where the block overturns there is a bar at the top instead, in the order of the legend.

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
    ax, curves = _curves(standing, hue="slenderness", along="period", ax=ax)
    at_top: dict[str, Any] = {"linewidth": 4, "transform": ax.get_xaxis_transform()}
    for k, (_, colour, (_, x, y)) in enumerate(curves):
        stands = np.isfinite(np.pad(y, 1, constant_values=np.nan))
        alone = stands[1:-1] & ~stands[:-2] & ~stands[2:]
        ax.plot(x[alone], y[alone], ".", color=colour)
        sides = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
        stands[[0, -1]] = True
        change = np.diff(stands.astype(int))
        bars = sides[change < 0], sides[change > 0]
        ax.hlines(np.full(bars[0].size, 0.97 - 0.035 * k), *bars, color=colour, **at_top)
    if not np.isfinite(standing).all():
        ax.plot([], [], color=NEUTRAL, linewidth=4, label="overturns")
        top = float(np.nan_to_num(standing.max(), nan=1.0)) / (0.93 - 0.035 * len(curves))
        ax.update_datalim([(np.nan, top)], updatex=False)
    _finished(ax, standing, "slenderness")
    ax.set_ylabel(r"peak rotation $|\alpha|_{max}/\alpha_c$ [-]")
    given = "restitution" in spectrum.coords
    title = f"$C$ = {spectrum.restitution.item():g}" if given else "Housner's $C$"
    record = spectrum.attrs.get("record")
    ax.set_title(
        f"{title}, {record} scaled by {spectrum.attrs.get('scale', 1):g}" if record else title
    )
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
    """Make a panel for each intensity and restitution, of at most so many, and one legend."""
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
        panel.label_outer()
    # One legend, of the panel with the most entries.
    legends = [panel.get_legend() for panel in panels.flat]
    entries = max(
        (p.get_legend_handles_labels() for p in panels.flat), key=lambda e: len(e[1])
    )
    for legend in legends:
        legend.remove()
    panels[0, -1].legend(*entries, **BESIDE, title=legends[0].get_title().get_text())
    return figure
