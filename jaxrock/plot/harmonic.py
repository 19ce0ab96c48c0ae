"""Steady rocking on a harmonic floor, in the plane of its frequency and amplitude."""

from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from ..grids import expand_scalars
from .axes import (
    BESIDE,
    INK,
    NEUTRAL,
    check_result,
    get_axes,
    label_axes,
    label_variable,
    set_title,
    tick_decades,
    write_amplitude_ratio,
)

_REGIONS = {  # colours of the regions, in the order of their numbers
    "1.0": "no steady rocking",
    "0.92": "stable",
    "0.76": "not stable: rocks\nin another way",
    "0.55": "not stable: overturns",
}
# Peaks span three powers of ten: evenly spaced contours would crowd at the top.
_LEVELS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5)


def plot_harmonic(spectrum: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw where a block rocks steadily on a harmonic floor, and how high.

    The map is white where the block does not rock steadily, and grey where it does. Contours
    are lines of equal peak rotation over critical angle. Above the dashed line the floor lifts
    a block at rest. The axes are in Hz and m/s2 if the spectrum has the size of a block, else
    they are ratios.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.spectra.harmonic_spectrum`; that of the command ``harmonic`` with a width
        has the size of the block.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If no amplitude is greater than 0.
    """
    check_result("spectrum", spectrum, xarray.Dataset, "harmonic_spectrum(...)")
    ax = get_axes(ax, figsize=(9.0, 4.8))
    # Contours need rising axes, with the amplitude first.
    axes = ["amplitude_ratio", "frequency_ratio"]
    spectrum = expand_scalars(spectrum, *axes).sortby(axes).transpose(*axes)
    # Amplitudes of 0 have no place on a logarithmic axis.
    spectrum = spectrum.isel(amplitude_ratio=spectrum.amplitude_ratio.values > 0)
    if not spectrum.amplitude_ratio.size:
        raise ValueError("spectrum must have an amplitude greater than 0 to be drawn, got 0")
    about = spectrum.attrs
    sized = "frequency" in spectrum.coords
    across = np.atleast_1d(spectrum.frequency if sized else spectrum.frequency_ratio)
    up = np.atleast_1d(spectrum.amplitude if sized else spectrum.amplitude_ratio)
    region = spectrum.region.values
    ratio = spectrum.rotation_ratio.values
    ax.set_yscale("log")  # before curves are labelled, so that gaps have the right length
    look = {"cmap": ListedColormap(list(_REGIONS)), "vmin": 0, "vmax": 3, "zorder": 0}
    ax.pcolormesh(_compute_edges(across), np.exp(_compute_edges(np.log(up))), region, **look)
    handles: list[Any] = [
        Patch(facecolor=colour, edgecolor="0.6", label=label)
        for number, (colour, label) in enumerate(_REGIONS.items())
        if (region == number).any()
    ]
    # Contours need two values along each axis; matplotlib warns of levels out of range.
    if min(ratio.shape) > 1 and np.isfinite(ratio).any():
        inside = [x for x in _LEVELS if np.nanmin(ratio) < x < np.nanmax(ratio)]
        curves = ax.contour(across, up, ratio, levels=inside, colors=INK, linewidths=0.9)
        ax.clabel(curves, fmt="%g", fontsize="x-small")
        label = r"rotation ratio $\alpha_{max}/\alpha_c$"
        handles += ax.plot([], [], color=INK, linewidth=0.9, label=label)
    tick_decades(ax.yaxis)
    uplift = about["uplift_amplitude"] if sized else 1
    if ax.get_ylim()[0] < uplift < ax.get_ylim()[1]:
        look = {"color": NEUTRAL, "linestyle": "--", "linewidth": 1.2}
        handles.append(ax.axhline(uplift, label="lifts a block at rest", **look))
    set_title(ax, about)
    ax.legend(handles=handles, **BESIDE, fontsize="small")
    if sized:
        labels = label_variable(spectrum.frequency), label_variable(spectrum.amplitude)
    else:
        labels = r"frequency ratio $\omega/p$ [-]", write_amplitude_ratio("a", about["model"])
    return label_axes(ax, *labels)


def _compute_edges(values: np.ndarray) -> np.ndarray:
    """Compute the edges of cells around values: halfway to neighbours, and beyond the ends."""
    if values.size == 1:
        return values + np.array([-0.05, 0.05])
    steps = np.diff(values) / 2
    return np.concatenate(
        [values[:1] - steps[0], values[:-1] + steps, values[-1:] + steps[-1]]
    )
