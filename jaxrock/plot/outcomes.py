"""Predicted probabilities of overturning beside what happened in tests."""

import numpy as np
import xarray
from matplotlib.axes import Axes

from ..validation import as_name
from .axes import (
    ABOVE,
    ACCENT,
    BACKDROP,
    BESIDE,
    INK,
    NEUTRAL,
    check_dataset,
    get_axes,
    label_axes,
    tick_decades,
)

_MEASURES = {"pgv": "PGV [m/s]", "pga": "PGA [m/s²]"}


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
    check_dataset("scores", scores, ("probability", "overturned"), "cross_validate(...)")
    ax = get_axes(ax, figsize=(6.6, 5.0))
    ax.plot([0, 1], [0, 1], "--", color=NEUTRAL, label="as predicted")
    # Bins into which no prediction fell have nothing to show.
    bins = scores.isel(bin=scores.tests.values > 0)
    predicted, observed, low, high = (
        bins[name].values
        for name in ("predicted", "observed", "observed_low", "observed_high")
    )
    about = scores.attrs
    interval = f"{about['confidence']:.0%} interval" if "confidence" in about else "interval"
    ax.plot(
        predicted,
        observed,
        "o",
        color=INK,
        label=f"observed, with\n{interval} and\nnumber of tests",
    )
    reach = [observed - low, high - observed]
    ax.errorbar(predicted, observed, reach, fmt="none", ecolor=INK, elinewidth=1, capsize=3)
    for x, y, count in zip(predicted, observed, bins.tests.values, strict=True):
        ax.annotate(
            # By weights it need not be whole.
            f"{round(float(count), 1):g}",
            (x, y),
            (6, 0),
            textcoords="offset points",
            va="center",
            fontsize="small",
            bbox=BACKDROP,
        )
    brier = scores.brier.sel(predictor="blocks").values
    ax.set_title(f"Brier score {np.nanmean(brier):.3f}{_describe_splits(brier)}")
    # With room for the last number.
    ax.set(xlim=(-0.03, 1.1), ylim=(-0.03, 1.03), aspect="equal")
    ax.legend(**BESIDE, fontsize="small")
    return label_axes(
        ax,
        "predicted probability of overturning [-]",
        "observed frequency of overturning [-]",
    )


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
    check_dataset("scores", scores, ("probability", "overturned"), "cross_validate(...)")
    measure = as_name("measure", measure, _MEASURES)
    ax = get_axes(ax, figsize=(7.0, 4.5))
    probability = scores.probability.sel(predictor="blocks").values
    is_known = ~np.isnan(probability)
    probability = probability[is_known]
    intensity = scores[measure].values[is_known]
    overturned = scores.overturned.values[is_known] == 1
    base_rate = overturned.mean()
    label = f"base rate, {base_rate:.3f}"
    ax.axhline(base_rate, color=NEUTRAL, linestyle="--", linewidth=1, label=label)
    # Hollow, so that marks are seen on one another.
    look = {"linestyle": "", "markersize": 5, "markerfacecolor": "none"}
    for outcome, marker, colour, name in (
        (False, "o", INK, "stood"),
        (True, "^", ACCENT, "overturned"),
    ):
        chosen = overturned == outcome
        label = f"{name}, {chosen.sum()}"
        ax.plot(
            intensity[chosen], probability[chosen], marker, color=colour, label=label, **look
        )
    ax.set(xscale="log", ylim=(-0.03, 1.03))
    tick_decades(ax.xaxis)
    ax.legend(**ABOVE, ncols=3, fontsize="small")
    return label_axes(ax, _MEASURES[measure], "predicted probability of overturning [-]")


def _describe_splits(values: np.ndarray) -> str:
    """Describe the standard deviation of a score over the splits, if there are several."""
    known = values[~np.isnan(values)]
    if known.size < 2:
        return ""
    return f" $\\pm$ {known.std(ddof=1):.3f} over {known.size} splits"
