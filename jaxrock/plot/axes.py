"""Shared parts of the figures: axes, labels with units, levels, legends, line styles."""

from collections.abc import Sequence
from typing import Any, Literal

import matplotlib.pyplot as plt
import xarray
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ..block import SIZES_IN_WORDS
from ..validation import check_kind

# INK and NEUTRAL are close to the start and the middle of cividis, the map that colours the
# curves of spectra. Its lightness rises all the way, so that it can be read in grey as well.
INK = "#00204d"
ACCENT = "#b5651d"
LIGHT = "#d9b44a"
NEUTRAL = "#7c7b78"
LINE = "0.2"
RATIO = r"rotation ratio $\alpha/\alpha_c$ [-]"
QUANTILE = 1.96  # of the normal distribution, for 95 %

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
# Behind a text that lies on curves.
BACKDROP: dict[str, Any] = {"facecolor": "w", "alpha": 0.8, "linewidth": 0, "pad": 2}

# Curves differ without colours, too: by line style first and marker next, since many markers
# hide a line. A point has no line style, so that points differ by their marker first.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (9, 3)), (0, (2, 1, 1, 3)))
_MARKERS = ("", "o", "s", "D", "^", "v", "P", "*", "X")
_LOOKS = [{"linestyle": s, "marker": m, "markersize": 5} for m in _MARKERS for s in _STYLES]
CURVES: list[dict[str, object]] = [{**look, "markevery": 0.1} for look in _LOOKS]
POINTS: list[dict[str, object]] = [_LOOKS[k + 7 * m] for k in range(7) for m in range(1, 9)]

# Names in words and units, by the names in the code.
_LABELS = {
    "free_period": (r"period $2\pi/p$ of the block", "s"),
    "slenderness": (r"slenderness $\lambda$", "1"),
    "width": ("width $2b$", "m"),
    "height": ("height $2a$", "m"),
    "half_width": ("half-width $b$", "m"),
    "inertia_ratio": (r"inertia ratio $\kappa$", "1"),
    "restitution": ("restitution $C$", "1"),
    "intensity": ("pulse intensity $I$", "m s-1"),
    "amplitude": ("amplitude", "m s-2"),
    "duration": ("pulse duration", "s"),
    "pulse_duration": ("pulse duration", "s"),
    "frequency": ("frequency of the floor", "rad s-1"),
    "scale": ("factor on the motion", "1"),
    "factor": ("factor on the motion", "1"),
    "rotation_ratio": (r"rotation ratio $\alpha^*_{max}/\alpha_c$", "1"),
    "peak_rotation": (r"peak rotation $\alpha^*_{max}$", "rad"),
    "stabilized_period": ("stabilized period $T^*$", "s"),
    "amplification": (r"amplification $\zeta$", "1"),
    "overturning_margin": ("overturning margin", "1"),
    "overturning_half_cycle": ("half-cycle that overturns", "1"),
    "critical_intensity": ("critical intensity", "m s-1"),
}
# What is written where a block gets another shape: also what stays as it is.
_VARIED = {
    "slenderness": (r"slenderness at this width, $\lambda$", "1"),
    "width": (f"{SIZES_IN_WORDS['width']}, $2b$", "m"),
    "height": (f"{SIZES_IN_WORDS['height']}, $2a$", "m"),
    "half_width": (f"{SIZES_IN_WORDS['half_width']}, $b$", "m"),
}
_UNITS = {"1": "-", "m s-1": "m/s", "m s-2": "m/s²", "rad s-1": "rad/s"}


def check_result(name: str, value: object, kind: type, source: str) -> None:
    """Check that what is to be drawn is the result of a function; `source` is its call."""
    check_kind(name, value, kind, hint=f"; {source} gives one")


def check_dataset(name: str, value: object, variables: Sequence[str], source: str) -> None:
    """Check that what is to be drawn is a dataset with these variables; `source` gives one."""
    check_result(name, value, xarray.Dataset, source)
    assert isinstance(value, xarray.Dataset)
    missing = [variable for variable in variables if variable not in value.variables]
    if missing:
        raise ValueError(
            f"{name} must be a dataset with {', '.join(variables)}, got one without"
            f" {missing[0]}; {source} gives one"
        )


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


def add_strip_above(ax: Axes, low: float, high: float) -> Axes:
    """Make axes over the top of `ax`, which shows `low` to `high` below them."""
    # The limits of `ax` leave room for the strip, and the ticks end where it begins.
    height = 0.28  # as a fraction of `ax`
    ax.set_ylim(low, low + (high - low) / (1 - height))
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(-high, high)
    ax.set_yticks([tick for tick in ticks if low < tick < high])
    ax.yaxis.label.set_y((1 - height) / 2)
    above = ax.inset_axes((0, 1 - height, 1, height), sharex=ax)
    above.axhline(0, color=LINE, linewidth=0.6)
    above.tick_params(labelbottom=False)
    return above


def tick_decades(axis: Axis, steps: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Label an axis, logarithmic by now, at these multiples of the powers of ten, in decimals."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def write_amplitude_ratio(symbol: str, model: str) -> str:
    """Write the label of an amplitude over the acceleration that lifts a block."""
    angle = r"\alpha_c" if model == "linearized" else r"\tan\alpha_c"
    return rf"amplitude ratio ${symbol}/(g\,{angle})$ [-]"


def write_label(variable: xarray.DataArray) -> str:
    """Write name, symbol and unit of a variable or a coordinate, for an axis or a legend."""
    name = str(variable.name)
    attributes = variable.attrs
    named = _LABELS.get(name, (attributes.get("long_name", name.replace("_", " ")), None))
    return _append_unit(named[0], attributes.get("units", named[1]))


def write_parameter_label(name: str, *, varied: bool = False) -> str:
    """Write name, symbol and unit of a parameter, by the name that it has in the code.

    Where a size is `varied` while others stay, the label says what stays.
    """
    labels = _LABELS | _VARIED if varied else _LABELS
    return _append_unit(*labels.get(name, (name.replace("_", " "), None)))


def _append_unit(label: str, unit: str | None) -> str:
    """Append a unit of the CF conventions, as it is printed, to a label."""
    return label if unit is None else f"{label} [{_UNITS.get(unit, unit)}]"
