"""Speed against accuracy."""

from typing import TYPE_CHECKING

import numpy as np

from .axes import axes_or_new, draws, labelled, legend_beside

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray

_MARKERS = "osD^vP*X"


@draws
def plot_tradeoff(
    dataset: "xarray.Dataset", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw a work-precision diagram: error against time, a mark for every setting.

    Filled marks are on the front of their batch, rings are the default settings.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `jaxrock.accuracy.measure_tradeoff`.
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
        marker = _MARKERS[number % len(_MARKERS)]
        line, colour = ("-", "--", ":", "-.")[number // len(_MARKERS) % 4], f"C{number % 10}"
        family = rows.isel(setting=members).sortby("error")
        time, error, front = (family[v].values for v in ("seconds", "error", "front"))
        look = {"color": colour, "lw": 0.8, "ms": 5, "fillstyle": "none", "label": name}
        ax.plot(time, error, marker + line, **look)
        ax.plot(time[front == 1], error[front == 1], marker, color=colour, markersize=5)
    default = rows.where(rows.default == 1, drop=True)
    if default.setting.size:
        ring = {"fillstyle": "none", "markersize": 12, "label": "default"}
        ax.plot(default.seconds, default.error, "ko", **ring)
    ax.set_xscale("log")
    ax.set_yscale("log")
    legend_beside(ax, fontsize="x-small")
    return labelled(ax, "time per answer [s]", "largest relative error [-]")
