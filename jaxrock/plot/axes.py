"""What the figures share: axes, labels with units, colours and styles."""

import inspect
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray

_Function = TypeVar("_Function", bound=Callable[..., Any])

INK, ACCENT, LIGHT, NEUTRAL = "#00204d", "#b5651d", "#d9b44a", "#7c7b78"
RATIO = r"rotation ratio $\alpha/\alpha_c$ [-]"

# So that curves differ without colours. Once all styles are used, markers come on top.
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

_AX = """ax : matplotlib.axes.Axes, optional
    Axes to draw on; new ones by default."""
_RETURNS = """Returns
-------
matplotlib.axes.Axes
    What was drawn on."""


def draws(function: _Function) -> _Function:
    """Add to a docstring what every figure has: the parameter ``ax``, and the axes returned."""
    if function.__doc__:
        parts = re.split(r"\n\n(?=[A-Z][a-z]+\n---)", inspect.cleandoc(function.__doc__))
        for k, part in enumerate(parts):
            if part.startswith("Parameters\n"):
                parts[k : k + 1] = [f"{part}\n{_AX}", _RETURNS]
        function.__doc__ = "\n\n".join(parts)
    return function


def axes_or_new(ax: "matplotlib.axes.Axes | None", **settings: Any) -> "matplotlib.axes.Axes":
    """The axes given, or new ones."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained", **settings)[1]


def labelled(ax: "matplotlib.axes.Axes", x: str, y: str) -> "matplotlib.axes.Axes":
    """The axes, with labels and a grid."""
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.grid(alpha=0.3)
    return ax


def legend_beside(ax: "matplotlib.axes.Axes", **settings: Any) -> None:
    """A legend to the right, where it hides nothing."""
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, **settings)


def shades(number: int) -> np.ndarray:
    """Colours from dark to light, stopping short of what is too pale to read."""
    import matplotlib

    return matplotlib.colormaps["cividis"](np.linspace(0, 0.85, number))


def style(number: int, *, points: bool = False) -> dict[str, Any]:
    """What tells the curve of that number from 62 others: its line, and a marker if needed."""
    round_ = number if points else number // len(_STYLES)
    return {
        "linestyle": _STYLES[number % len(_STYLES)],
        "marker": (_MARKERS[1:] if points else _MARKERS)[round_ % (len(_MARKERS) - points)],
        "markevery": None if points else 0.1,
        "markersize": 5,
    }


def label_of(variable: "xarray.DataArray") -> str:
    """Name, symbol and unit, for an axis or a legend."""
    name, given = str(variable.name), variable.attrs
    known = _DIMENSIONS if variable.name in variable.dims else _VARIABLES
    label, unit = known.get(name, (given.get("long_name", name.replace("_", " ")), None))
    unit = given.get("units", unit)
    return label if unit is None else f"{label} [{_UNITS.get(unit, unit)}]"
