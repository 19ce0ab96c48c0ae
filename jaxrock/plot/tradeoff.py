"""Speed against accuracy."""

from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes

from .axes import ABOVE, ACCENT, INK, LIGHT, NEUTRAL, axes_or_new, draws, labelled

_FAMILIES = {
    "linearized": (LIGHT, "^"),
    "nonlinear": (ACCENT, "s"),
    "batch": (INK, "o"),
    "adaptive": (NEUTRAL, "D"),
}


@draws("dataset : xarray.Dataset\n    Of `jaxrock.accuracy.measure_tradeoff`.")
def plot_tradeoff(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw a work-precision diagram: error against time, a mark for every setting.

    Colour and mark tell the levels of fidelity apart. Written at a line is the solver, or how
    many answers are computed at once. On the front of a batch nothing is faster and as
    accurate.
    """
    ax = axes_or_new(ax, figsize=(8, 5.4))
    rows = dataset.where(np.isfinite(dataset.error), drop=True).sortby("error")
    for level, (colour, marker) in _FAMILIES.items():
        if level in rows.level:
            ax.plot([], marker, color=colour, label=level)
    lines: dict[tuple[str, ...], list[int]] = {}
    for k in range(rows.setting.size):
        row = rows.isel(setting=k)
        many = f"{int(row.batch):,} at once" if row.batch > 1 else "one at a time"
        text = many if row.solver == "-" else row.solver.item()
        key = row.level.item(), text, "float32" if row.bits == 32 else ""
        lines.setdefault(key, []).append(k)
    ends: dict[tuple[str, ...], np.ndarray] = {}
    for (level, text, precision), members in lines.items():
        colour, marker = _FAMILIES[level]
        line = rows.isel(setting=members)
        time, error, front = (line[v].values for v in ("seconds", "error", "front"))
        look: dict[str, Any] = {"color": colour, "marker": marker}
        look |= {"markersize": 4, "linestyle": ":"} if precision else {"markersize": 7}
        ax.plot(time, error, linewidth=0.9, fillstyle="none", **look)
        ax.plot(time[front == 1], error[front == 1], **look)[0].set_linestyle("")
        ends[level, text] = np.array([time[-1], error[-1]])
    _write(ax, ends)
    if (rows.bits == 32).any():
        ax.plot([], ":", color="k", marker="o", markersize=4, label="float32: small, dotted")
    ax.plot([], "P", color="k", label="filled: on the front")
    default = rows.where(rows.default == 1, drop=True)
    if default.setting.size:
        ring = {"fillstyle": "none", "markersize": 13, "label": "default"}
        ax.plot(default.seconds, default.error, "ko", **ring)
    ax.set(xscale="log", yscale="log")
    ax.margins(0.12, 0.08)
    ax.legend(**ABOVE, ncols=4, fontsize="small")
    return labelled(ax, "time per answer [s]", "largest relative error [-]")


def _write(ax: Axes, ends: dict[tuple[str, ...], np.ndarray]) -> None:
    """Write what tells the lines of a level apart, at the less accurate end of each."""
    taken: list[tuple[np.ndarray, str]] = []
    for (level, text), end in ends.items():
        near = [other for at, other in taken if (abs(np.log10(at / end)) < [1, 0.7]).all()]
        if text not in near:  # else the same is written there already
            beside: dict[str, Any] = {"xytext": (9, 2), "ha": "left"}
            above: dict[str, Any] = {"xytext": (0, 8 + 11 * len(near)), "ha": "center"}
            place = beside if level == "adaptive" else above
            ax.annotate(
                text, tuple(end), textcoords="offset points", fontsize="small", **place
            )
            taken.append((end, text))
