"""Measured speed against accuracy."""

import itertools
from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes

from .axes import ACCENT, BESIDE, INK, LIGHT, NEUTRAL, check_result, get_axes, label_axes

_COLOURS = {"linearized": LIGHT, "nonlinear": ACCENT, "batch": INK, "adaptive": NEUTRAL}
_MARKERS = "os^DvPX*"


def plot_tradeoff(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw a work-precision diagram: error against time, a mark for every setting.

    A line is a level of fidelity, by its colour, with a solver or a number of answers that are
    computed at once, by its mark, in one precision. A setting is on the front of its batch if
    no setting that is at least as accurate is faster.

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
    check_result("dataset", dataset, xarray.Dataset, "measure_tradeoff(scene)")
    ax = get_axes(ax, figsize=(8.6, 5.4))
    rows = dataset.where(np.isfinite(dataset.error), drop=True).sortby("error")
    rows = rows.isel(setting=np.argsort(rows.level.values, kind="stable"))
    # Settings that differ only in the varied parameter make a line.
    lines: dict[tuple[str, str, float], list[int]] = {}
    for k in range(rows.setting.size):
        row = rows.isel(setting=k)
        many = f"{int(row.batch):,} at once" if row.batch > 1 else "one at a time"
        text = many if row.solver == "-" else row.solver.item()
        lines.setdefault((row.level.item(), text, row.bits.item()), []).append(k)
    markers = dict(zip(dict.fromkeys(text for _, text, _ in lines), itertools.cycle(_MARKERS)))
    for (level, text, bits), members in lines.items():
        line = rows.isel(setting=members)
        front = line.isel(setting=line.front.values == 1)
        look: dict[str, Any] = {
            "color": _COLOURS[level],
            "marker": markers[text],
            "markersize": 6,
        }
        style: dict[str, Any] = {"linestyle": ":" if bits == 32 else "-", "fillstyle": "none"}
        name = f"{level}, {text}{', float32' * (bits == 32)}"
        ax.plot(line.seconds, line.error, linewidth=0.9, label=name, **look, **style)
        ax.plot(front.seconds, front.error, linestyle="", **look)
    ax.plot([], "P", color="k", label="filled: on the front")
    default = rows.isel(setting=rows.default.values == 1)
    if default.setting.size:
        ring = {"fillstyle": "none", "markersize": 13, "label": "default"}
        ax.plot(default.seconds, default.error, "ko", **ring)
    ax.set(xscale="log", yscale="log")
    ax.legend(**BESIDE, fontsize="small")
    return label_axes(ax, "time per answer [s]", "largest relative error [-]")
