"""What the figures share: axes, labels with units, colours and line styles."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes

_Function = TypeVar("_Function", bound=Callable[..., Any])

INK, ACCENT, LIGHT, NEUTRAL, LINE = "#00204d", "#b5651d", "#d9b44a", "#7c7b78", "0.2"
RATIO = r"rotation ratio $\alpha/\alpha_c$ [-]"

# Curves differ without colours, too. Once all line styles are used, markers come on top.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (9, 3)), (0, (2, 1, 1, 3)))
_MARKERS = ("", "o", "s", "D", "^", "v", "P", "*", "X")

_DIMENSIONS = {
    "period": (r"period $2\pi/p$ of the block", "s"),
    "slenderness": (r"slenderness $\lambda$", "1"),
    "width": ("width $2b$", "m"),
    "half_width": ("half-width $b$", "m"),
    "restitution": ("restitution $C$", "1"),
    "intensity": ("pulse intensity $I$", "m s-1"),
    "amplitude": ("amplitude $a_p$", "m s-2"),
    "duration": ("duration", "s"),
    "gravity": ("gravity $g$", "m s-2"),
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

_SHARED = """ax : matplotlib.axes.Axes, optional
    Axes to draw on; new ones by default.

Returns
-------
matplotlib.axes.Axes
    The axes drawn on."""


def draws(function: _Function) -> _Function:
    """Add to a docstring what every figure has: the parameter ``ax``, and the axes returned."""
    parameters, raises, errors = inspect.cleandoc(function.__doc__ or "").partition("\n\nRaises\n")
    function.__doc__ = f"{parameters}\n{_SHARED}{raises}{errors}"
    return function


def axes_or_new(ax: Axes | None, **settings: Any) -> Axes:
    """`ax`, or new axes."""
    return plt.subplots(layout="constrained", **settings)[1] if ax is None else ax


def labelled(ax: Axes, x: str, y: str) -> Axes:
    """The axes, with labels and a grid."""
    ax.set(xlabel=x, ylabel=y)
    ax.grid(alpha=0.3)
    return ax


def legend_beside(ax: Axes, **settings: Any) -> None:
    """A legend to the right, where it hides nothing."""
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, **settings)


def legend_above(ax: Axes, columns: int) -> None:
    """A legend in one row above the axes."""
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), frameon=False, ncols=columns)


def shades(number: int) -> np.ndarray:
    """Colours from dark to light, stopping short of what is too pale to read."""
    return matplotlib.colormaps["cividis"](np.linspace(0, 0.85, number))


def style(number: int, *, points: bool = False) -> dict[str, Any]:
    """Line and marker that tell the curve of this number from 62 others."""
    markers = _MARKERS[1:] if points else _MARKERS
    return {
        "linestyle": _STYLES[number % len(_STYLES)],
        "marker": markers[(number if points else number // len(_STYLES)) % len(markers)],
        "markevery": None if points else 0.1,
        "markersize": 5,
    }


def label_of(variable: xarray.DataArray) -> str:
    """Name, symbol and unit, for an axis or a legend."""
    name, attributes = str(variable.name), variable.attrs
    symbols = _DIMENSIONS if variable.name in variable.dims else _VARIABLES
    label, unit = symbols.get(name, (attributes.get("long_name", name.replace("_", " ")), None))
    unit = attributes.get("units", unit)
    return label if unit is None else f"{label} [{_UNITS.get(unit, unit)}]"
