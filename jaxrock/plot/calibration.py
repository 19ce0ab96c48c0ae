"""Fits of measurements: half-cycles and restitution of a block that rocks freely."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from ..calibration import FreeRockingFit
from .axes import ACCENT, BESIDE, INK, LINE, NEUTRAL, QUANTILE, check_result, label_axes

_SIGNIFICANT = 0.05  # p-value below which C is drawn as changing


def plot_free_rocking_fit(fit: FreeRockingFit, figure: Figure | None = None) -> Figure:
    """Draw measured and fitted half-cycle durations, and C of each impact over its velocity.

    Each duration is drawn between the two impacts of its half-cycle. Impacts that are missing
    or were left out are marked at the foot. For peaks without times only C is drawn. If C is
    constant, 95 % of the impacts lie in the grey band, which is wider for slower impacts. If
    a constant C does not explain the data, a line shows C linear in the velocity. If p is
    fitted too, there is no such line, since p would change with such a C; the legend says so.

    Parameters
    ----------
    fit, figure : FreeRockingFit, matplotlib.figure.Figure
        From `jaxrock.calibration.fit_free_rocking`, one test; the figure to draw on, a new one
        by default.

    Returns
    -------
    matplotlib.figure.Figure

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
    if figure is None:
        figure = plt.figure(figsize=(7.5, 6.4 if timed else 3.4), layout="constrained")
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
    # Between an impact and the next but one lie two half-cycles, and neither is known.
    whole = np.diff(numbers[used]) == 1
    between = numbers[used][:-1][whole] + 0.5
    durations = [np.diff(times[used])[whole] for times in (measured, computed)]
    ax.plot(between, durations[0], "o", color=INK, label="measured")
    ax.plot(between, durations[1], color=ACCENT, label="fitted")
    missing = np.setdiff1d(np.arange(numbers[0], numbers[-1]), numbers)
    for impacts, marker, name in (
        (missing, "x", "impact missing"),
        (numbers[~used], "^", "time left out"),
    ):
        if impacts.size:
            ax.plot(
                impacts,
                np.full(impacts.shape, 0.05),
                marker,
                color=LINE,
                fillstyle="none",
                label=name,
                transform=ax.get_xaxis_transform(),  # the height in parts of the axes
            )
    ax.set_yscale("log")
    # In a narrow range there are few powers of 10 and their multiples, perhaps none to label.
    narrow = not whole.any() or np.ptp(np.log(durations)) < 1.5
    if narrow:
        ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    else:
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlim(numbers[0] - 0.5, numbers[-1] + 0.5)
    ax.legend(**BESIDE)
    label_axes(ax, "number of the impact [-]", "half-cycle duration [s]")


def _draw_restitutions(fit: FreeRockingFit, ax: Axes) -> None:
    """Draw C of each impact over the velocity before it, and the C that was fitted."""
    velocities, restitutions, errors = (
        np.asarray(values)
        for values in (fit.velocity_ratios, fit.restitutions, fit.restitution_errors)
    )
    name = "each impact, with standard\nerror by the noise of this fit"
    ax.plot(velocities, restitutions, "o", color=INK, label=name)
    ax.errorbar(
        velocities, restitutions, errors, fmt="none", ecolor=INK, elinewidth=0.8, capsize=2
    )
    constant = float(fit.restitution)
    error = float(fit.standard_errors["restitution"])
    name = f"constant: {constant:#.4g}\n$\\pm$ {error:.2g}"
    ax.axhline(constant, color=ACCENT, label=name)
    # By the errors of single impacts: the error of the constant is the least of all, by far,
    # and a band as narrow would hide behind the line.
    known = np.flatnonzero(np.isfinite(errors))
    known = known[np.argsort(velocities[known])]
    reach = QUANTILE * errors[known]
    name = "95 % of the impacts, if $C$\nis constant (noise alone)"
    band = {"color": NEUTRAL, "alpha": 0.3, "linewidth": 0, "zorder": 0, "label": name}
    ax.fill_between(velocities[known], constant - reach, constant + reach, **band)
    # A C that changes with the velocity alters p as well, so that where p was fitted there is
    # no line that belongs to the points: the legend says so.
    chance = float(fit.restitution_change_p_value)
    if chance < _SIGNIFICANT and float(fit.standard_errors["frequency_parameter"]) > 0:
        name = f"p-value of a constant {chance:.2g};\na change alters $p$ as well"
        ax.plot([], [], " ", label=name)
    elif chance < _SIGNIFICANT and np.isfinite(restitutions).any():
        name = f"linear in the velocity,\np-value {chance:.2g}"
        ax.plot(*_compute_trend_line(fit), color=LINE, linestyle="--", label=name)
    # Values of C lie close together: matplotlib would print differences to one of them.
    ax.ticklabel_format(useOffset=False)
    ax.legend(**BESIDE)
    label_axes(
        ax, "velocity before the impact over the critical one [-]", "restitution $C$ [-]"
    )


def _compute_trend_line(fit: FreeRockingFit) -> tuple[np.ndarray, np.ndarray]:
    """Compute the ends of the line of a C that is linear in the velocity.

    The line goes through the mean of the points, weighted by their errors. The fit says how
    much C changes from the first impact to the last; the velocities there follow from the
    constant C.
    """
    last = _find_last_impact(fit)
    # The velocity falls by the factor C at each impact: before the second one it is the launch
    # ratio times C, and so on up to the last.
    velocities = float(fit.launch_ratio) * float(fit.restitution) ** np.array([0, last - 2])
    slope = float(fit.restitution_change) / (velocities[0] - velocities[1])
    ratios, restitutions, errors = (
        np.asarray(values)
        for values in (fit.velocity_ratios, fit.restitutions, fit.restitution_errors)
    )
    known = np.isfinite(restitutions)
    weights = errors[known] ** -2.0
    middle = np.average(ratios[known], weights=weights)
    height = np.average(restitutions[known], weights=weights)
    return velocities, height + slope * (velocities - middle)


def _find_last_impact(fit: FreeRockingFit) -> int:
    """Find the number of the last impact that the measurements say something about."""
    if fit.impact_times.size > 1:
        return int(np.asarray(fit.impact_numbers)[np.asarray(fit.used)][-1])
    return int(np.flatnonzero(np.isfinite(np.asarray(fit.rotation_residuals)))[-1]) + 1
