"""Spectra: one panel of curves, and whole figures of panels."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .axes import axes_or_new, draws, label_of, labelled, legend_beside, shades, style

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure
    import xarray


@draws
def plot_curves(
    variable: "xarray.DataArray",
    hue: str,
    along: str = "slenderness",
    ax: "matplotlib.axes.Axes | None" = None,
) -> "matplotlib.axes.Axes":
    """Draw one panel of a spectrum: a variable along one dimension, curves over another.

    A curve ends where the block overturns; a cross marks the last value that there is.
    `plot_spectrum` draws all panels of a resonance spectrum into a figure of its own.

    Parameters
    ----------
    variable : xarray.DataArray
        With dimensions `along` and `hue` only, for example
        ``spectrum.rotation_ratio.sel(restitution=0.6)``.
    hue : str
        Dimension that tells the curves apart.
    along : str
        Dimension of the horizontal axis.

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
    x = variable[along].values
    levels = variable[hue].values
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


def plot_spectrum(
    spectrum: "xarray.Dataset", variable: str = "rotation_ratio"
) -> "matplotlib.figure.Figure":
    """Draw a variable of `resonance_spectrum` over slenderness, a panel each restitution.

    A row of panels each intensity, a curve each width. Of a dimension with more values than
    can be told apart (4 panels a side, 7 curves) some are drawn, evenly chosen. A single
    panel on given axes is what `plot_curves` draws.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.resonance_spectrum`.
    variable : str
        Which of its variables.

    Returns
    -------
    matplotlib.figure.Figure
    """
    data = _some(spectrum[variable], width=7, restitution=4, intensity=4)
    restitutions = data.restitution.values
    has_rows = "intensity" in data.dims
    rows = data.intensity.values if has_rows else [None]
    figure, panels = _panels(len(rows), restitutions.size, (3.2, 3.0), sharex=True)
    for row, intensity in zip(panels, rows, strict=True):
        for panel, restitution in zip(row, restitutions, strict=True):
            chosen = {"restitution": restitution} | ({"intensity": intensity} if has_rows else {})
            plot_curves(data.sel(chosen), hue="width", ax=panel)
            pulse = spectrum.intensity.item() if spectrum.intensity.ndim == 0 else intensity
            title = f"$C$ = {restitution:g}"
            panel.set_title(title if pulse is None else f"{title}, $I$ = {pulse:g} m/s")
    _outer(panels)
    return figure


@draws
def plot_rocking_curves(
    spectrum: "xarray.Dataset", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw peak rotation over the period 2 pi / p, a curve each slenderness.

    A curve ends where the block overturns. `plot_rocking_spectrum` draws a panel like this
    for every restitution into a figure of its own.

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
    ax = plot_curves(_standing(spectrum), hue="slenderness", along="period", ax=ax)
    ax.set_ylabel(r"peak rotation $|\alpha|_{max}/\alpha_c$ [-]")
    ax.set_title(_title(spectrum))
    return ax


def plot_rocking_spectrum(spectrum: "xarray.Dataset") -> "matplotlib.figure.Figure":
    """Draw peak rotation over the period 2 pi / p, a panel each restitution.

    Of more values than can be told apart (4 panels, 5 curves) some are drawn, evenly
    chosen. A single panel on given axes is what `plot_rocking_curves` draws.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.rocking_spectrum`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    data = _some(spectrum, slenderness=5, restitution=4)
    chosen = [data]
    if "restitution" in data.dims:
        chosen = [data.isel(restitution=k) for k in range(data.restitution.size)]
    figure, panels = _panels(1, len(chosen), (4.0, 3.6))
    for panel, part in zip(panels[0], chosen, strict=True):
        plot_rocking_curves(part, ax=panel)
    _outer(panels)
    return figure


def _standing(spectrum: "xarray.Dataset") -> "xarray.DataArray":
    return spectrum.rotation_ratio.where(spectrum.overturned == 0)


def _title(spectrum: "xarray.Dataset") -> str:
    if "restitution" in spectrum.coords:
        return f"$C$ = {spectrum.restitution.item():g}"
    return "Housner's $C$"


def _panels(rows: int, columns: int, size: tuple[float, float], **settings: Any) -> Any:
    import matplotlib.pyplot as plt

    return plt.subplots(
        rows,
        columns,
        figsize=(1.6 + size[0] * columns, 0.6 + size[1] * rows),
        sharey=True,
        squeeze=False,
        layout="constrained",
        **settings,
    )


def _outer(panels: np.ndarray) -> None:
    """One legend for all, and labels only outside."""
    for panel in panels.flat:
        if panel is not panels[0, -1]:
            panel.get_legend().remove()
        panel.label_outer()


def _some(data: Any, **most: int) -> Any:
    """At most so many values of each dimension, evenly chosen."""
    for name, number in most.items():
        size = data.sizes.get(name, 1)
        if size > number:
            data = data.isel({name: np.linspace(0, size - 1, number).round().astype(int)})
    return data
