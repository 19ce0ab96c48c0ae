"""Speed against accuracy."""

from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes

from .axes import BESIDE, POINTS, axes_or_new, draws, labelled


@draws("dataset : xarray.Dataset\n    Of `jaxrock.accuracy.measure_tradeoff`.")
def plot_tradeoff(dataset: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw a work-precision diagram: error against time, a mark for every setting.

    Filled marks are on the front of their batch, rings are the default settings.
    """
    ax = axes_or_new(ax, figsize=(8, 5))
    rows = dataset.where(np.isfinite(dataset.error), drop=True)
    families: dict[str, list[int]] = {}
    for k in range(rows.setting.size):
        row = rows.isel(setting=k)
        level, solver, size = row.level.item(), row.solver.item(), int(row.batch)
        name = level if solver == "-" else f"{level}, {solver}"
        name += ", float32" if row.bits == 32 else ""
        families.setdefault(name + (f" ({size:,} at once)" if size > 1 else ""), []).append(k)
    for number, (name, members) in enumerate(sorted(families.items())):
        family = rows.isel(setting=members).sortby("error")
        time, error, front = (family[v].values for v in ("seconds", "error", "front"))
        look: dict[str, Any] = POINTS[number % len(POINTS)] | {"color": f"C{number % 10}"}
        ax.plot(time, error, linewidth=0.8, fillstyle="none", label=name, **look)
        ax.plot(time[front == 1], error[front == 1], **look)[0].set_linestyle("")
    default = rows.where(rows.default == 1, drop=True)
    if default.setting.size:
        ring = {"fillstyle": "none", "markersize": 12, "label": "default"}
        ax.plot(default.seconds, default.error, "ko", **ring)
    ax.set(xscale="log", yscale="log")
    ax.legend(**BESIDE, fontsize="x-small")
    return labelled(ax, "time per answer [s]", "largest relative error [-]")
