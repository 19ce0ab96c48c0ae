"""Predicted probabilities of overturning beside what happened in tests."""

from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes

from ..validation import as_name
from .axes import (
    ABOVE,
    ACCENT,
    BESIDE,
    INK,
    NEUTRAL,
    check_result,
    get_axes,
    label_axes,
    tick_decades,
)

_MEASURES = {"pgv": "PGV [m/s]", "pga": "PGA [m/s²]"}
# Background of a number that lies on intervals.
_BACKDROP = {"facecolor": "w", "alpha": 0.8, "linewidth": 0, "pad": 1}
_PREDICTED = "predicted probability of overturning [-]"


def plot_reliability(scores: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the observed frequency of overturning over the predicted probability.

    Each mark is a bin of predictions for tests that were not fitted, with the confidence
    interval of the observed frequency and the number of tests. If the predicted probabilities
    are correct, the intervals reach the diagonal.

    Parameters
    ----------
    scores : xarray.Dataset
        Of `jaxrock.calibration.cross_validate`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    check_result("scores", scores, xarray.Dataset, "cross_validate(...)")
    ax = get_axes(ax, figsize=(7.4, 5.0))
    ax.plot([0, 1], [0, 1], "--", color=NEUTRAL, label="as predicted")
    # Bins without predictions are left out.
    bins = scores.isel(bin=scores.tests.values > 0)
    observed = bins.observed.values
    interval = f"{scores.attrs.get('confidence', 0.95):.0%} interval"
    label = f"observed, with\n{interval} and\nnumber of tests"
    reach = [observed - bins.observed_low, bins.observed_high - observed]
    look = {"color": INK, "elinewidth": 1, "capsize": 3, "label": label}
    ax.errorbar(bins.predicted, observed, reach, fmt="o", **look)
    for x, y, count in zip(bins.predicted.values, observed, bins.tests.values, strict=True):
        look: dict[str, Any] = {
            "textcoords": "offset points",
            "va": "center",
            "fontsize": "small",
        }
        # The weighted number need not be whole.
        ax.annotate(f"{round(float(count), 1):g}", (x, y), (6, 0), bbox=_BACKDROP, **look)
    brier = scores.brier.sel(predictor="blocks").dropna("split")
    deviation = f" $\\pm$ {float(brier.std(ddof=1)):.3f}" if brier.size > 1 else ""
    ax.set_title(f"Brier score {float(brier.mean()):.3f}{deviation}", fontsize="medium")
    # The limits leave room for the last number.
    ax.set(xlim=(-0.03, 1.12), ylim=(-0.03, 1.03), aspect="equal")
    ax.legend(**BESIDE, fontsize="small")
    return label_axes(ax, _PREDICTED, "observed frequency of overturning [-]")


def plot_outcomes(
    scores: xarray.Dataset, ax: Axes | None = None, measure: str = "pgv"
) -> Axes:
    """Draw the predicted probability of each test over its intensity, by its outcome.

    The probability is the mean over the splits in which the test was not fitted; a test that
    was fitted in all of them is left out. No curve is fitted to the marks. If the intensity
    alone decided the outcome, they would lie on one curve.

    Parameters
    ----------
    scores : xarray.Dataset
        Of `jaxrock.calibration.cross_validate`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.
    measure : {"pgv", "pga"}
        Intensity on the horizontal axis.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If there is no such measure.
    """
    check_result("scores", scores, xarray.Dataset, "cross_validate(...)")
    measure = as_name("measure", measure, _MEASURES)
    ax = get_axes(ax, figsize=(7.0, 4.5))
    probability = scores.probability.sel(predictor="blocks")
    tests = scores.isel(test=np.isfinite(probability.values))
    base_rate = float(tests.overturned.mean())
    look = {"color": NEUTRAL, "linestyle": "--", "linewidth": 1}
    ax.axhline(base_rate, label=f"base rate, {base_rate:.3f}", **look)
    for outcome, marker, colour, name in (
        (0, "o", INK, "stood"),
        (1, "^", ACCENT, "overturned"),
    ):
        chosen = tests.isel(test=tests.overturned.values == outcome)
        # Marks are hollow, so that all stay visible.
        look = {"linestyle": "", "markersize": 5, "markerfacecolor": "none", "color": colour}
        label = f"{name}, {chosen.test.size}"
        predicted = chosen.probability.sel(predictor="blocks")
        ax.plot(chosen[measure], predicted, marker, label=label, **look)
    ax.set(xscale="log", ylim=(-0.03, 1.03))
    tick_decades(ax.xaxis)
    ax.legend(**ABOVE, ncols=3)
    return label_axes(ax, _MEASURES[measure], _PREDICTED)
