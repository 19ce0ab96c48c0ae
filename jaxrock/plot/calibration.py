"""Fits of measurements: half-cycles and restitution of a block that rocks freely."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from ..calibration import FreeRockingFit
from ..tables import write_label
from .axes import (
    ACCENT,
    BESIDE,
    INK,
    LINE,
    NEUTRAL,
    QUANTILE,
    check_result,
    label_axes,
    make_figure,
)


def plot_free_rocking_fit(fit: FreeRockingFit, ax: Axes | None = None) -> FigureBase:
    """Draw measured and fitted half-cycle durations, and C of each impact over its velocity.

    Each duration is drawn between the two impacts of its half-cycle. Impacts that are missing
    or were left out are marked at the foot. For peaks without times only C is drawn. If C is
    constant, 95 % of the impacts lie in the grey band, which is wider for slower impacts. If
    a constant C does not explain the data, a weighted line through the impacts shows how C
    changes.

    Parameters
    ----------
    fit : FreeRockingFit
        From `jaxrock.calibration.fit_free_rocking`, one test.
    ax : matplotlib.axes.Axes, optional
        Axes of `matplotlib.pyplot.subplots`, in whose place the panels stand; by default they
        stand in a new figure.

    Returns
    -------
    matplotlib.figure.Figure or matplotlib.figure.SubFigure

    Raises
    ------
    ValueError
        If `fit` is of several tests.
    """
    check_result("fit", fit, FreeRockingFit, "fit_free_rocking(impact_times)")
    if np.ndim(fit.restitution):
        shape = np.shape(fit.restitution)
        raise ValueError(f"fit must be of one test, got an array of shape {shape}")
    timed = fit.impact_times.size > 1
    figure = make_figure(ax, (7.5, 6.4 if timed else 3.4))
    panels = figure.subplots(1 + timed, squeeze=False)[:, 0]
    if timed:
        _draw_durations(fit, panels[0])
    _draw_restitutions(fit, panels[-1])
    return figure


def _draw_durations(fit: FreeRockingFit, ax: Axes) -> None:
    """Draw measured and fitted half-cycle durations over the number of the impact."""
    used = np.asarray(fit.used)
    numbers = np.asarray(fit.impact_numbers)
    measured = np.asarray(fit.impact_times)
    computed = measured + np.asarray(fit.time_residuals)
    # Two times with a missing impact in between enclose two half-cycles, neither of them
    # known.
    whole = np.diff(numbers[used]) == 1
    between = numbers[used][:-1][whole] + 0.5
    ax.plot(between, np.diff(measured[used])[whole], "o", color=INK, label="measured")
    ax.plot(between, np.diff(computed[used])[whole], color=ACCENT, label="fitted")
    missing = np.setdiff1d(np.arange(numbers[0], numbers[-1]), numbers)
    look = {"color": LINE, "fillstyle": "none", "transform": ax.get_xaxis_transform()}
    if missing.size:
        ax.plot(missing, np.full(missing.shape, 0.05), "x", label="impact missing", **look)
    if not used.all():
        left_out = numbers[~used]
        ax.plot(left_out, np.full(left_out.shape, 0.05), "^", label="time left out", **look)
    ax.set_ylim(bottom=0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(**BESIDE)
    label_axes(ax, "number of the impact [-]", "half-cycle duration [s]")


def _draw_restitutions(fit: FreeRockingFit, ax: Axes) -> None:
    """Draw C of each impact over the velocity before it, and the C that was fitted."""
    # Impacts with a known restitution, from the slowest on.
    known = np.flatnonzero(np.isfinite(fit.restitutions))
    known = known[np.argsort(np.asarray(fit.velocity_ratios)[known])]
    velocities, restitutions, errors = (
        np.asarray(values)[known]
        for values in (fit.velocity_ratios, fit.restitutions, fit.restitution_errors)
    )
    name = "each impact, with standard\nerror by the noise of this fit"
    ax.plot(velocities, restitutions, "o", color=INK, label=name)
    look = {"ecolor": INK, "elinewidth": 0.8, "capsize": 2}
    ax.errorbar(velocities, restitutions, errors, fmt="none", **look)
    constant = float(fit.restitution)
    error = float(fit.standard_errors["restitution"])
    name = f"constant: {constant:#.4g}\n$\\pm$ {error:.2g}"
    ax.axhline(constant, color=ACCENT, label=name)
    # The band shows the errors of single impacts: the error of the constant is much smaller,
    # and its band would hide behind the line.
    reach = QUANTILE * errors
    name = "95 % of the impacts, if $C$\nis constant (noise alone)"
    band = {"color": NEUTRAL, "alpha": 0.3, "linewidth": 0, "zorder": 0, "label": name}
    ax.fill_between(velocities, constant - reach, constant + reach, **band)
    if not fit.is_constant and known.size > 1:
        slope, start = np.polyfit(velocities, restitutions, 1, w=1 / errors)
        name = "weighted line"
        line = start + slope * velocities
        ax.plot(velocities, line, color=LINE, linestyle="--", label=name)
    # Values of C lie close together: matplotlib would print them as offsets from one value.
    ax.ticklabel_format(useOffset=False)
    ax.legend(**BESIDE)
    label_axes(ax, write_label("velocity_ratio"), write_label("restitution"))
