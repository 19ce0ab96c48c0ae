"""Measured speed against accuracy."""

import numpy as np
import xarray
from matplotlib.axes import Axes

from .axes import ABOVE, ACCENT, INK, LIGHT, NEUTRAL, check_dataset, get_axes, label_axes

_FAMILIES = {
    "linearized": (LIGHT, "^"),
    "nonlinear": (ACCENT, "s"),
    "batch": (INK, "o"),
    "adaptive": (NEUTRAL, "D"),
}


def plot_tradeoff(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw a work-precision diagram: error against time, a mark for every setting.

    Colour and mark show the level of fidelity. The label of a line is the solver, or the
    number of answers computed at once. A setting is on the front of its batch if no setting
    that is at least as accurate is faster.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `jaxrock.accuracy.measure_tradeoff`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    check_dataset("dataset", dataset, ("error",), "measure_tradeoff(scene).dataset")
    ax = get_axes(ax, figsize=(8.0, 5.4))
    rows = dataset.where(np.isfinite(dataset.error), drop=True).sortby("error")
    for level, (colour, marker) in _FAMILIES.items():
        if level in rows.level:
            ax.plot([], marker, color=colour, label=level)

    # Settings that differ in nothing but the dial that is turned make a line.
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
        style = ":" if precision else "-"
        (whole,) = ax.plot(time, error, style, linewidth=0.9, fillstyle="none")
        (best,) = ax.plot(time[front == 1], error[front == 1], linestyle="")
        for drawn in (whole, best):
            drawn.set(color=colour, marker=marker, markersize=4 if precision else 7)
        # Both precisions of a level and a solver share a text, at the end of the later one.
        ends[level, text] = np.array([time[-1], error[-1]])

    _write_line_names(ax, ends)
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
    return label_axes(ax, "time per answer [s]", "largest relative error [-]")


def _write_line_names(ax: Axes, ends: dict[tuple[str, ...], np.ndarray]) -> None:
    """Write the names of the lines of a level, at the less accurate end of each."""
    taken: list[tuple[np.ndarray, str]] = []
    for (level, text), end in ends.items():
        # Less than a factor of 10 in time and of 5 in error apart, texts would overlap.
        near = [other for at, other in taken if (abs(np.log10(at / end)) < [1, 0.7]).all()]
        if text not in near:  # else the same is written there already
            # The lines of the adaptive integrator are steep: beside them there is room.
            beside = level == "adaptive"
            ax.annotate(
                text,
                tuple(end),
                (9, 2) if beside else (0, 8 + 11 * len(near)),
                textcoords="offset points",
                ha="left" if beside else "center",
                fontsize="small",
            )
            taken.append((end, text))
