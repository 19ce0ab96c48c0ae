"""Shared parts of the figures: axes, labels with units, levels, legends, line styles."""

from typing import Any, Literal

import matplotlib.pyplot as plt
import xarray
from matplotlib.axes import Axes

# INK and NEUTRAL are close to the start and the middle of cividis, the map that colours the
# curves of spectra. Its lightness rises all the way, so that it can be read in grey as well.
INK = "#00204d"
ACCENT = "#b5651d"
LIGHT = "#d9b44a"
NEUTRAL = "#7c7b78"
LINE = "0.2"
RATIO = r"rotation ratio $\alpha/\alpha_c$ [-]"

# A legend inside of the axes would hide curves: it stands on the right, or in a row above.
BESIDE: dict[str, Any] = {
    "loc": "center left",
    "bbox_to_anchor": (1, 0.5),
    "frameon": False,
}
ABOVE: dict[str, Any] = {
    "loc": "lower center",
    "bbox_to_anchor": (0.5, 1),
    "frameon": False,
}

# Curves differ without colours, too: by line style first and marker next, since many markers
# hide a line. A point has no line style, so that points differ by their marker first.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (9, 3)), (0, (2, 1, 1, 3)))
_MARKERS = ("", "o", "s", "D", "^", "v", "P", "*", "X")
_LOOKS = [{"linestyle": s, "marker": m, "markersize": 5} for m in _MARKERS for s in _STYLES]
CURVES: list[dict[str, object]] = [{**look, "markevery": 0.1} for look in _LOOKS]
POINTS: list[dict[str, object]] = [_LOOKS[k + 7 * m] for k in range(7) for m in range(1, 9)]

# Names in words and units, by the names in the code. A name such as "period" is a given number
# where it is a dimension, and an answer where it is a variable: hence two tables.
_DIMENSIONS = {
    "period": (r"period $2\pi/p$ of the block", "s"),
    "slenderness": (r"slenderness $\lambda$", "1"),
    "width": ("width $2b$", "m"),
    "half_width": ("half-width $b$", "m"),
    "inertia_ratio": (r"inertia ratio $\kappa$", "1"),
    "restitution": ("restitution $C$", "1"),
    "intensity": ("pulse intensity $I$", "m s-1"),
    "amplitude": ("amplitude", "m s-2"),
    "pulse_duration": ("pulse duration", "s"),
    "scale": ("factor on the record", "1"),
}
_VARIABLES = {
    "rotation_ratio": (r"rotation ratio $\alpha^*_{max}/\alpha_c$", "1"),
    "peak_rotation": (r"peak rotation $\alpha^*_{max}$", "rad"),
    "period": ("stabilized period $T^*$", "s"),
    "amplification": (r"amplification $\zeta$", "1"),
    "overturning_margin": ("overturning margin", "1"),
    "overturning_half_cycle": ("half-cycle that overturns", "1"),
    "critical_intensity": ("critical intensity", "m s-1"),
}
_UNITS = {"1": "-", "m s-1": "m/s", "m s-2": "m/s²", "rad s-1": "rad/s"}


def get_axes(ax: Axes | None, figsize: tuple[float, float] | None = None) -> Axes:
    """Return `ax`, or make new axes in a figure of this size [inches]."""
    return plt.subplots(layout="constrained", figsize=figsize)[1] if ax is None else ax


def label_axes(ax: Axes, x: str, y: str, grid: Literal["both", "x", "y"] = "both") -> Axes:
    """Label the axes, and give them a grid."""
    ax.set(xlabel=x, ylabel=y)
    ax.grid(axis=grid, alpha=0.3)
    return ax


def add_level(ax: Axes, level: float, name: str | None) -> None:
    """Draw a level on both sides of 0, with one entry in the legend, or none."""
    for sign, label in ((1, name), (-1, None)):
        ax.axhline(sign * level, color=NEUTRAL, linestyle="--", linewidth=0.8, label=label)


def write_label(variable: xarray.DataArray) -> str:
    """Write name, symbol and unit of a variable or a coordinate, for an axis or a legend."""
    name = str(variable.name)
    attributes = variable.attrs
    # A coordinate is named after the dimension along which it lies.
    symbols = _DIMENSIONS if variable.name in variable.dims else _VARIABLES
    named = symbols.get(name, (attributes.get("long_name", name.replace("_", " ")), None))
    return _append_unit(named[0], attributes.get("units", named[1]))


def write_number_label(name: str) -> str:
    """Write name, symbol and unit of a number, by the name that it has in the code."""
    return _append_unit(*_DIMENSIONS.get(name, (name.replace("_", " "), None)))


def _append_unit(label: str, unit: str | None) -> str:
    """Append a unit of the CF conventions, as it is printed, to a label."""
    return label if unit is None else f"{label} [{_UNITS.get(unit, unit)}]"
