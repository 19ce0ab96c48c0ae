"""What the figures share: axes, labels with units, levels, legends, line styles."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import matplotlib.pyplot as plt
import xarray
from matplotlib.axes import Axes

_Function = TypeVar("_Function", bound=Callable[..., Any])

INK = "#00204d"
ACCENT = "#b5651d"
LIGHT = "#d9b44a"
NEUTRAL = "#7c7b78"
LINE = "0.2"
RATIO = r"rotation ratio $\alpha/\alpha_c$ [-]"

# Where a legend hides nothing: on the right, or in a row above.
BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1, 0.5), "frameon": False}
ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1), "frameon": False}

# Curves differ without colours, too: by line style first and marker next, points by marker
# first.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (9, 3)), (0, (2, 1, 1, 3)))
_MARKERS = ("", "o", "s", "D", "^", "v", "P", "*", "X")
_LOOKS = [{"linestyle": s, "marker": m, "markersize": 5} for m in _MARKERS for s in _STYLES]
CURVES: list[dict[str, Any]] = [{**look, "markevery": 0.1} for look in _LOOKS]
POINTS: list[dict[str, Any]] = [_LOOKS[k + 7 * m] for k in range(7) for m in range(1, 9)]

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

_SHARED = """
ax : matplotlib.axes.Axes, optional
    Axes to draw on; new ones by default.

Returns
-------
matplotlib.axes.Axes
    The axes drawn on."""


def draws(parameter: str = "") -> Callable[[_Function], _Function]:
    """Add to a docstring its only `parameter`, and what every figure has: ``ax``, axes returned."""
    section = f"\n\nParameters\n----------\n{parameter}" if parameter else ""

    def described(function: _Function) -> _Function:
        head, raises, errors = inspect.cleandoc(function.__doc__ or "").partition(
            "\n\nRaises\n"
        )
        function.__doc__ = f"{head}{section}{_SHARED}{raises}{errors}"
        return function

    return described


def axes_or_new(ax: Axes | None, **settings: Any) -> Axes:
    """`ax`, or new axes."""
    return plt.subplots(layout="constrained", **settings)[1] if ax is None else ax


def labelled(ax: Axes, x: str, y: str, grid: Any = "both") -> Axes:
    """Label the axes, and give them a grid."""
    ax.set(xlabel=x, ylabel=y)
    ax.grid(axis=grid, alpha=0.3)
    return ax


def add_level(ax: Axes, level: float, name: str | None) -> None:
    """Draw a level to both sides of 0, with one entry in the legend, or none."""
    for sign, label in ((1, name), (-1, None)):
        ax.axhline(sign * level, color=NEUTRAL, linestyle="--", linewidth=0.8, label=label)


def label_of(variable: xarray.DataArray) -> str:
    """Name, symbol and unit, for an axis or a legend."""
    name = str(variable.name)
    attributes = variable.attrs
    symbols = _DIMENSIONS if variable.name in variable.dims else _VARIABLES
    named = symbols.get(name, (attributes.get("long_name", name.replace("_", " ")), None))
    return _with_unit(named[0], attributes.get("units", named[1]))


def label_of_number(name: str) -> str:
    """Name, symbol and unit of a number that an answer depends on, by its name in the code."""
    return _with_unit(*_DIMENSIONS.get(name, (name.replace("_", " "), None)))


def _with_unit(label: str, unit: str | None) -> str:
    return label if unit is None else f"{label} [{_UNITS.get(unit, unit)}]"
