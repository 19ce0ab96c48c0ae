"""Steady rocking on a harmonic floor, in the plane of its frequency and amplitude."""

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from ..grids import expand_scalars
from .axes import (
    ABOVE,
    BACKDROP,
    INK,
    NEUTRAL,
    check_dataset,
    get_axes,
    label_axes,
    tick_decades,
    write_amplitude_ratio,
)

_LOOKS = (  # of the regions from 1 on
    ("0.88", "", "stable"),
    ("w", "////", "not stable: rocks in another way"),
    ("0.62", "", "not stable: overturns"),
)
# Peaks span three powers of ten; matplotlib would space contours evenly, all at the top.
_LEVELS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5)


def plot_harmonic(spectrum: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw where a block rocks steadily on a harmonic floor, and how high.

    The map is white where the block does not rock steadily, and shaded or hatched where it
    does. Contours are lines of equal peak rotation over critical angle. Above the dashed line
    the floor lifts a block at rest. The axes are in Hz and m/s2 if the spectrum has the size
    of a block, else they are ratios.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.spectra.harmonic_spectrum`, perhaps with `jaxrock.spectra.add_size`.
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
    check_dataset("spectrum", spectrum, ("region", "rotation_ratio"), "harmonic_spectrum(...)")
    ax = get_axes(ax, figsize=(7.2, 4.8))
    # Contours need rising axes, and the amplitude as the first one.
    axes = ["amplitude_ratio", "frequency_ratio"]
    spectrum = expand_scalars(spectrum, *axes).sortby(axes).transpose(*axes)
    about = spectrum.attrs
    sized = "frequency" in spectrum.coords
    across = np.atleast_1d(spectrum.frequency if sized else spectrum.frequency_ratio)
    up = np.atleast_1d(spectrum.amplitude if sized else spectrum.amplitude_ratio)
    uplift = about["uplift_amplitude"] if sized else 1
    # Amplitudes of 0 have no place on a logarithmic axis.
    if not (up > 0).any():
        raise ValueError("spectrum must have an amplitude greater than 0 to be drawn, got 0")
    spectrum = spectrum.isel(amplitude_ratio=up > 0)
    up = up[up > 0]
    # A cell around each point, on an axis that is linear and one that is logarithmic.
    sides = _compute_edges(across)
    levels = np.exp(_compute_edges(np.log(up)))
    for number, (colour, hatch, label) in enumerate(_LOOKS, 1):
        cells = [
            [(sides[j], levels[i]), (sides[j + 1], levels[i]),
             (sides[j + 1], levels[i + 1]), (sides[j], levels[i + 1])]
            for i, j in np.argwhere(spectrum.region.values == number)
        ]  # fmt: skip
        if cells:
            # An edge of its own colour leaves no gaps between the cells.
            edge = "0.6" if hatch else colour
            look = {"hatch": hatch, "edgecolor": edge, "linewidth": 0 if hatch else 0.4}
            area = PolyCollection(cells, facecolor=colour, zorder=0, label=label, **look)
            ax.add_collection(area)
    if (spectrum.region.values == 0).any():
        white = {"color": "w", "markeredgecolor": "0.6", "markersize": 9}
        ax.plot([], [], "s", **white, label="no steady rocking")
    ax.set_yscale("log")  # before curves are labelled, which leaves gaps of the right length
    ax.set(xlim=(sides[0], sides[-1]), ylim=(levels[0], levels[-1]))
    ratio = spectrum.rotation_ratio.values
    # Contours need two values along each axis, and warn of levels that are nowhere.
    if min(ratio.shape) > 1 and np.isfinite(ratio).any():
        inside = [x for x in _LEVELS if np.nanmin(ratio) < x < np.nanmax(ratio)]
        curves = ax.contour(across, up, ratio, levels=inside, colors=INK, linewidths=0.9)
        ax.clabel(curves, fmt="%g", fontsize="x-small")
        ax.plot(
            [], [], color=INK, linewidth=0.9, label=r"rotation ratio $\alpha_{max}/\alpha_c$"
        )
    tick_decades(ax.yaxis)
    if levels[0] < uplift < levels[-1]:
        ax.axhline(
            uplift, color=NEUTRAL, linestyle="--", linewidth=1.2, label="lifts a block at rest"
        )
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**ABOVE, ncols=3, fontsize="small")
    numbers = rf"$\lambda$ = {about['slenderness']:g}, $C$ = {about['restitution']:.3g}"
    if sized:
        numbers = rf"$2b$ = {about['width']:.3g} m, $2a$ = {about['height']:.3g} m, {numbers}"
    place = {"transform": ax.transAxes, "ha": "right"}
    ax.text(0.99, 0.02, numbers, fontsize="small", bbox=BACKDROP, **place)
    if sized:
        return label_axes(ax, "frequency of the floor [Hz]", "amplitude of the floor [m/s²]")
    vertical = write_amplitude_ratio("a", about["model"])
    return label_axes(ax, r"frequency ratio $\omega/p$ [-]", vertical)


def _compute_edges(values: np.ndarray) -> np.ndarray:
    """Compute the edges of cells around values: halfway to neighbours, and beyond the ends."""
    # A single value has no neighbour: a twentieth of it, and of 1 where it is small.
    if values.size == 1:
        return values + np.array([-0.05, 0.05]) * np.maximum(np.abs(values), 1)
    middle = 0.5 * (values[1:] + values[:-1])
    first = 2 * values[0] - middle[0]
    last = 2 * values[-1] - middle[-1]
    return np.concatenate([[first], middle, [last]])
