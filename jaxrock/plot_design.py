"""Figures of inverse design and sensitivity. Each takes ``ax=None`` and returns the axes."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray

    from .sensitivity import Swing
    from .worst import WorstTrain

_MARKS = (
    (0, "#00204d", ".", "without an impact"),
    (1, "#b5651d", "x", "after one impact"),
    (2, "#7c7b78", "+", "after more impacts"),
)


def plot_overturning_map(
    found: "xarray.Dataset", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw all boundaries of overturning, and what lies between them.

    Parameters
    ----------
    found : xarray.Dataset
        From `jaxrock.overturning_map`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = _axes(ax)
    found = found.sortby("frequency_ratio")
    ratios, edges = found.frequency_ratio.values, found.amplitude_ratio.values
    low, high = found.attrs["lowest_amplitude_ratio"], found.attrs["highest_amplitude_ratio"]
    levels = np.geomspace(low, high, 600)
    # Every boundary passed changes the fate.
    passed = (edges[:, :, None] <= levels).sum(axis=1)
    overturned = (passed + found.overturns_first.values[:, None]) % 2 == 1
    shade = np.where(overturned, 0.25, np.nan)
    if ratios.size > 1:
        ax.pcolormesh(
            ratios, levels, shade.T, cmap="Greys", vmin=0, vmax=1, shading="nearest", zorder=0
        )
    place = np.broadcast_to(ratios[:, None], edges.shape)
    impacts = np.minimum(found.impacts.values, 2)
    for mode, colour, marker, label in _MARKS:
        of_mode = (impacts == mode) & np.isfinite(edges)
        if of_mode.any():
            ax.plot(place[of_mode], edges[of_mode], marker, color=colour, markersize=4, label=label)
    ax.set_yscale("log")
    ax.set_ylim(low, high)
    ax.set_xlabel(r"frequency ratio $\omega_p/p$ [-]")
    angle = r"\alpha_c" if found.attrs["equation"] == "linearized" else r"\tan\alpha_c"
    ax.set_ylabel(rf"amplitude ratio $a_p/(g\,{angle})$ [-]")
    ax.set_title(f"{found.attrs['motion']}: overturns where shaded", fontsize="medium")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, loc="upper left")
    ax.grid(alpha=0.3)
    return ax


def plot_tornado(
    swing: "Swing", ax: "matplotlib.axes.Axes | None" = None, label: str = "answer"
) -> "matplotlib.axes.Axes":
    """Draw what each number can do to an answer within its range.

    Parameters
    ----------
    swing : Swing
        From `jaxrock.tornado`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.
    label : str
        Of the answer, with its unit.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = _axes(ax)
    rows = np.arange(len(swing.names))[::-1]
    for ends, limits, colour, name in (
        (swing.at_low, swing.low, "#00204d", "low"),
        (swing.at_high, swing.high, "#c9a227", "high"),
    ):
        width = np.nan_to_num(ends - swing.value)
        ax.barh(rows, width, left=swing.value, height=0.6, color=colour, label=f"at the {name} end")
        for row, limit, end in zip(rows, limits, ends, strict=True):
            if not np.isfinite(end):
                ax.text(swing.value, row, f" {name}: overturns ", ha="center", va="center")
                continue
            outward = end >= swing.value
            ax.annotate(
                f"{limit:.4g}",
                (end, row),
                xytext=(3 if outward else -3, 0),
                textcoords="offset points",
                ha="left" if outward else "right",
                va="center",
                fontsize="small",
            )
    ax.axvline(swing.value, color="0.2", linewidth=0.8)
    ax.set_yticks(rows, [name.replace("_", " ") for name in swing.names])
    ax.margins(x=0.12)
    ax.set_xlabel(label)
    ax.legend(frameon=False, loc="lower right")
    ax.grid(alpha=0.3, axis="x")
    return ax


def plot_sensitivity_map(
    slopes: "xarray.DataArray", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw a slope or an elasticity over two numbers, its sign by colour.

    Parameters
    ----------
    slopes : xarray.DataArray
        With two dimensions, the second one the horizontal axis; NaN stays white.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If there are not two dimensions.
    """
    if slopes.ndim != 2:
        raise ValueError(f"slopes must have two dimensions, got {slopes.dims}")
    ax = _axes(ax)
    vertical, horizontal = (str(name) for name in slopes.dims)
    values = slopes.values
    known = np.abs(values[np.isfinite(values)])
    # The steepest of all are at the verge, where a slope is infinite: they would hide the rest.
    limit = float(np.quantile(known, 0.95)) if known.size else 1.0
    mesh = ax.pcolormesh(
        slopes[horizontal].values,
        slopes[vertical].values,
        values,
        cmap="PuOr",
        vmin=-limit,
        vmax=limit,
        shading="nearest",
    )
    levels = ax.contour(
        slopes[horizontal].values,
        slopes[vertical].values,
        values,
        levels=np.linspace(-limit, limit, 13),
        colors="0.2",
        linewidths=0.6,
    )
    ax.clabel(levels, fontsize="x-small")
    label = slopes.attrs.get("long_name", str(slopes.name))
    ax.figure.colorbar(mesh, ax=ax, extend="both", label=label)
    for name, put in ((horizontal, ax.set_xlabel), (vertical, ax.set_ylabel)):
        unit = slopes[name].attrs.get("units", "1")
        put(slopes[name].attrs.get("long_name", name) + ("" if unit == "1" else f" [{unit}]"))
    return ax


def plot_convergence(
    train: "WorstTrain", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw how far each start was from the best train, step by step.

    Parameters
    ----------
    train : WorstTrain
        From `jaxrock.worst_train`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = _axes(ax)
    most = train.goal == "most rotation"
    best = np.nanmax(train.objectives) if most else np.nanmin(train.objectives)
    away = np.abs(train.history / best - 1)
    for path in away:
        ax.semilogy(np.maximum(path, 1e-16), color="#00204d", alpha=0.5, linewidth=0.9)
    ax.set_xlabel("step of the descent")
    ax.set_ylabel("distance from the best, relative [-]")
    ax.set_title(f"{train.goal}: {len(away)} starts", fontsize="medium")
    ax.grid(alpha=0.3)
    return ax


def plot_tradeoff(
    dataset: "xarray.Dataset", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw a work-precision diagram: error against time, a mark for every setting.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `jaxrock.measure_tradeoff`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        Filled marks are on the front of their batch, rings are the default settings.
    """
    ax = _axes(ax)
    rows = dataset.where(np.isfinite(dataset.error), drop=True)
    families: dict[str, list[int]] = {}
    for k in range(rows.setting.size):
        row = rows.isel(setting=k)
        parts = [str(row.rung.item())] + [str(row.solver.item())] * (row.solver.item() != "-")
        if row.locate.item() not in ("-", "step"):
            parts.append(f"to {row.locate.item()}")
        parts += ["float32"] * (int(row.bits) == 32)
        size = int(row.batch)
        families.setdefault(
            ", ".join(parts) + (f" ({size:,} at once)" if size > 1 else ""), []
        ).append(k)
    for number, (name, members) in enumerate(sorted(families.items())):
        marker, colour = "osD^vP*X"[number % 8], f"C{number % 10}"
        part = rows.isel(setting=members).sortby("error")
        time, error, front = (part[v].values for v in ("seconds", "error", "front"))
        ax.plot(time, error, "-", color=colour, linewidth=0.7, alpha=0.6)
        ax.plot(time, error, marker, color=colour, markersize=5, markerfacecolor="none", label=name)
        ax.plot(time[front == 1], error[front == 1], marker, color=colour, markersize=5)
    usual = rows.where(rows.default == 1, drop=True)
    ax.plot(usual.seconds, usual.error, "o", color="k", fillstyle="none", markersize=12)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("time an answer [s]")
    ax.set_ylabel("largest relative error [-]")
    ax.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    ax.grid(True, alpha=0.3)
    return ax


def _axes(ax: "matplotlib.axes.Axes | None") -> "matplotlib.axes.Axes":
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1]
