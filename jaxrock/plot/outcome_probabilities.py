"""Probabilities of outcomes, and Sobol indices of the parameters that they come from."""

import numpy as np
from matplotlib.axes import Axes

from ..sensitivity import (
    OutcomeProbabilities,
    describe_index,
    describe_parameter,
    is_index_known,
)
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
    check_result(
        "probabilities", probabilities, OutcomeProbabilities, "outcome_probabilities(...)"
    )
    ax = get_axes(ax, figsize=(5.6, 2.6))
    rows = np.arange(len(probabilities.outcomes))[::-1]
    ax.barh(rows, probabilities.probability, height=0.5, color=LIGHT, label="all samples")
    records = len(probabilities.by_record)
    if records > 1:
        # Side by side in the width of the bar: many are 0 or 1.
        places = rows[:, None] + np.linspace(-0.2, 0.2, records)
        points = (probabilities.by_record.T.ravel(), places.ravel())
        ax.plot(*points, ".", color=NEUTRAL, label="under each record")
    # One line with gaps, and so one entry in the legend.
    gap = np.full(len(rows), np.nan)
    ends = np.stack([probabilities.low, probabilities.high, gap], axis=1).ravel()
    label = f"{probabilities.confidence:.0%} interval"
    ax.plot(ends, np.repeat(rows, 3), "-|", color=INK, markersize=10, label=label)
    # Numbers beside the names: within the axes they would lie on intervals and points.
    names = zip(probabilities.outcomes, probabilities.probability, strict=True)
    ax.set_yticks(rows, [f"{outcome}: {probability:.3f}" for outcome, probability in names])
    ax.set_xlim(-0.02, 1.02)
    ax.legend(**ABOVE, ncols=3, fontsize="small")
    return label_axes(ax, "probability [-]", "", grid="x")


def plot_sobol_indices(
    probabilities: OutcomeProbabilities, answer: str = "peak", ax: Axes | None = None
) -> Axes:
    """Draw which part of the variance of an answer comes from each parameter.

    The first-order index is the part of a parameter alone. The total index includes its
    interactions with other parameters. An index that noise hides has words instead of a bar.

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
    check_result(
        "probabilities", probabilities, OutcomeProbabilities, "outcome_probabilities(...)"
    )
    answer = as_name("answer", answer, probabilities.answers)
    ax = get_axes(ax, figsize=(5.0, 1.6 + 0.5 * len(probabilities.sources)))
    k = probabilities.answers.index(answer)
    rows = np.arange(len(probabilities.sources))[::-1]
    # An answer that does not vary, or in too few samples, has no indices.
    varies = bool(np.isfinite(probabilities.first[k]).any())
    for kind, shift, colour in (("first", 0.2, LIGHT), ("total", -0.2, INK)):
        values = getattr(probabilities, kind)[k]
        errors = getattr(probabilities, f"{kind}_error")[k]
        pairs = list(zip(values, errors, strict=True))
        known = np.array([is_index_known(*pair) for pair in pairs])
        for row, pair in zip(rows[~known] + shift, np.array(pairs)[~known], strict=True):
            if varies:
                ax.text(0.01, row, describe_index(*pair), va="center", fontsize="x-small")
        values = np.where(known, values, 0.0)
        errors = np.where(known, errors, 0.0)
        ax.barh(
            rows + shift,
            values,
            height=0.36,
            xerr=errors,
            color=colour,
            error_kw={"ecolor": NEUTRAL, "capsize": 2},
            label={"first": "first order", "total": "total"}[kind],
        )
    ax.axvline(0, color=LINE, linewidth=0.8)
    ax.set_yticks(rows, [describe_parameter(name) for name in probabilities.sources])
    if not varies:
        words = "no indices: too few samples differ"
        ax.text(0.5, 0.5, words, ha="center", va="center", transform=ax.transAxes)
    # Estimates of an index near 1 have errors that reach beyond it.
    ax.set_xlim(0.0, max(1.05, ax.get_xlim()[1]))
    ax.legend(**ABOVE, ncols=2, fontsize="small")
    return label_axes(ax, f"Sobol index: {answer} [-]", "", grid="x")
