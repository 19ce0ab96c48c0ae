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
        parts = [str(row.level.item())] + [str(row.solver.item())] * (row.solver.item() != "-")
        if row.locate.item() not in ("-", "step"):
            parts.append(f"to {row.locate.item()}")
        parts += ["float32"] * (int(row.bits) == 32)
        size = int(row.batch)
        families.setdefault(
            ", ".join(parts) + (f" ({size:,} at once)" if size > 1 else ""), []
        ).append(k)
    for number, (name, members) in enumerate(sorted(families.items())):
        colour, look = f"C{number % 10}", ("-", "--", ":", "-.")[number // len(_MARKERS) % 4]
        marker = _MARKERS[number % len(_MARKERS)]
        part = rows.isel(setting=members).sortby("error")
        time, error, front = (part[v].values for v in ("seconds", "error", "front"))
        line = f"{marker}{look}"
        ax.plot(time, error, line, color=colour, lw=0.8, ms=5, fillstyle="none", label=name)
        ax.plot(time[front == 1], error[front == 1], marker, color=colour, markersize=5)
    usual = rows.where(rows.default == 1, drop=True)
    if usual.setting.size:
        ring = {"fillstyle": "none", "markersize": 12, "label": "default"}
        ax.plot(usual.seconds, usual.error, "ko", **ring)
    ax.set_xscale("log")
    ax.set_yscale("log")
    legend_beside(ax, fontsize="x-small")
    return labelled(ax, "time an answer [s]", "largest relative error [-]")
