"""Probabilities of outcomes, and Sobol indices of the parameters that they come from."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..sensitivity import OutcomeProbabilities, describe_parameter
from ..validation import as_name
from .axes import ABOVE, INK, LIGHT, LINE, NEUTRAL, check_result, get_axes, label_axes


def plot_outcome_probabilities(
    probabilities: OutcomeProbabilities, ax: Axes | None = None
) -> Axes:
    """Draw the probability of each outcome, with its interval and the value under each record.

    Parameters
    ----------
    probabilities : OutcomeProbabilities
        From `jaxrock.sensitivity.outcome_probabilities`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    source = "outcome_probabilities(...)"
    check_result("probabilities", probabilities, OutcomeProbabilities, source)
    ax = get_axes(ax, figsize=(5.6, 2.6))
    rows = np.arange(len(probabilities.outcomes))[::-1]
    ax.barh(rows, probabilities.probability, height=0.5, color=LIGHT, label="all samples")
    records = len(probabilities.by_record)
    if records > 1:
        # The values stand side by side within the bar, since many are 0 or 1.
        heights = rows + np.linspace(-0.2, 0.2, records)[:, None]
        look: dict[str, Any] = {"color": NEUTRAL, "marker": ".", "linestyle": ""}
        labels = ["under each record", *[None] * (rows.size - 1)]
        ax.plot(probabilities.by_record, heights, **look, label=labels)
    reach = [
        probabilities.probability - probabilities.low,
        probabilities.high - probabilities.probability,
    ]
    look = {"fmt": "none", "ecolor": INK, "capsize": 5}
    look["label"] = "95 % interval"
    ax.errorbar(probabilities.probability, rows, xerr=np.abs(reach), **look)
    names = zip(probabilities.outcomes, probabilities.probability, strict=True)
    ax.set_yticks(rows, [f"{outcome}: {probability:.3f}" for outcome, probability in names])
    ax.set_xlim(-0.02, 1.02)
    ax.legend(**ABOVE, ncols=3)
    return label_axes(ax, "probability [-]", "", grid="x")


def plot_sobol_indices(
    probabilities: OutcomeProbabilities, answer: str = "peak", ax: Axes | None = None
) -> Axes:
    """Draw which part of the variance of an answer comes from each parameter.

    The first-order index is the part of a parameter alone. The total index includes its
    interactions with other parameters. Lines are standard errors.

    Parameters
    ----------
    probabilities, answer : OutcomeProbabilities, str
        From `jaxrock.sensitivity.outcome_probabilities`, and one of its answers.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If there is no such answer.
    """
    source = "outcome_probabilities(...)"
    check_result("probabilities", probabilities, OutcomeProbabilities, source)
    answer = as_name("answer", answer, probabilities.answers)
    ax = get_axes(ax, figsize=(5.0, 1.6 + 0.5 * len(probabilities.sources)))
    k = probabilities.answers.index(answer)
    rows = np.arange(len(probabilities.sources))[::-1]
    for label, heights, colour, values, errors in (
        ("first order", rows + 0.2, LIGHT, probabilities.first, probabilities.first_error),
        ("total", rows - 0.2, INK, probabilities.total, probabilities.total_error),
    ):
        look = {"color": colour, "error_kw": {"ecolor": NEUTRAL, "capsize": 2}}
        ax.barh(heights, values[k], height=0.36, xerr=errors[k], label=label, **look)
    ax.axvline(0, color=LINE, linewidth=0.8)
    ax.set_yticks(rows, [describe_parameter(name) for name in probabilities.sources])
    # An index or its error may reach beyond 0 and 1.
    low, high = ax.get_xlim()
    ax.set_xlim(min(0.0, low), max(1.05, high))
    ax.legend(**ABOVE, ncols=2)
    return label_axes(ax, f"Sobol index: {answer} [-]", "", grid="x")
