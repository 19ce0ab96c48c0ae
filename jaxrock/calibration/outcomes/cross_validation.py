"""Scores of predicted outcomes on tests that were not fitted."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO
from ...ground_motion import Suite, describe_suite
from ...host import add_names, format_table, make_dataset
from ...resonance import ModelLike, Nonlinear
from ...validation import Flags, Number, Numbers
from .answer import OutcomeFit
from .campaign import Campaign, CampaignFit, check_campaign, fit_parts
from .fit import make_outcome_fit
from .intensity_rules import fit_intensity_rule, measure_tests
from .likelihood import average_weights, compute_probability
from .population import unpack_population
from .prior import PriorLike
from .scores import (
    accuracy,
    brier_score,
    compare_distributions,
    compute_crps,
    compute_reliability,
    log_score,
    weight_held_out,
)

if TYPE_CHECKING:
    import xarray

    from ...host import Labelled

PREDICTORS = ("blocks", "pgv", "pga", "base rate")
_CONFIDENCE = 0.9  # of intervals of observed frequencies
PEAK_SCORES = ("crps", "ks_distance", "ks_p_value")
_SCORES = {
    "brier": ("Brier score", brier_score),
    "log_score": ("logarithmic score", log_score),
    "accuracy": ("fraction of outcomes with a probability above 1/2", accuracy),
}


def cross_validate(  # noqa: PLR0913
    suite: Suite,
    overturned: Flags,
    groups: Sequence[object] | None = None,
    *,
    splits: int = 40,
    seed: int = 0,
    prior: PriorLike | None = None,
    peak_rotations: Numbers | None = None,
    samples: int | None = None,
    model: ModelLike = Nonlinear(),
    gravity: Number = 9.81,
    inertia_ratio: Number = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
) -> "xarray.Dataset":
    """Score predicted outcomes: fit on half of the groups, predict the others, many times.

    Groups stay whole: with tests of one earthquake in both halves, scores would be too good.
    A split with seed k fits the first half, rounded down, of a permutation of the sorted
    names of the groups by ``numpy.random.default_rng(k)``.

    Parameters
    ----------
    suite, overturned, prior, peak_rotations, samples, model, gravity, inertia_ratio, one_sided
        As in `fit_outcomes`.
    groups : sequence of str, optional
        A name for each test, such as that of the earthquake; by default each test is a group.
    splits : int
        Number of random splits into halves.
    seed : int
        Seed of the first split; each further split has the next seed. Also the seed of the
        Sobol points.

    Returns
    -------
    xarray.Dataset
        - Over predictor and split: ``brier``, ``log_score`` and ``accuracy`` on the tests
          that were not fitted. The predictors are ``blocks``, the fitted population; ``pgv``
          and ``pga``, logistic rules in the logarithm of one measure, fitted to the same half
          (PGV without the drift of a record); and ``base rate``, the frequency of overturning
          in that half.
        - Over predictor and test: ``probability`` of overturning, the mean over the splits in
          which the test was not fitted.
        - Over test: ``overturned``, ``group``, ``pgv`` [m/s], ``pga`` [m/s2].
        - Over bin, the reliability of the predictor ``blocks``: ``predicted`` mean probability,
          ``observed`` frequency with its Clopper-Pearson interval ``observed_low`` to
          ``observed_high``, and the number of ``tests``, each of which counts once over all
          splits.
        - If peaks are given, over split: ``crps`` [rad], the continuous ranked probability
          score of blocks that stand; ``ks_distance`` and ``ks_p_value`` of the
          Kolmogorov-Smirnov test that measured and predicted peaks have the same
          distribution. Over test: ``peak_rotation`` [rad].

    Raises
    ------
    ValueError
        As in `fit_outcomes`; if there are less than two groups, or no split.

    Examples
    --------
    >>> import jaxrock as jr, numpy as np
    >>> suite = jr.example_suite().scaled(np.linspace(0.5, 2.0, 20))
    >>> overturned = jr.respond_batch(jr.Block(0.1, 6.0), 0.9, suite).overturned
    >>> earthquakes = [name.rpartition(" ")[0] for name in suite.names]
    >>> scores = jr.calibration.cross_validate(
    ...     suite, overturned, earthquakes, splits=3, samples=256
    ... )
    >>> print(scores.sizes["test"], scores.brier.dims)
    20 ('predictor', 'split')
    """
    campaign = check_campaign(
        suite,
        overturned,
        groups,
        peak_rotations,
        prior,
        samples,
        seed,
        model,
        gravity,
        inertia_ratio,
        one_sided,
    )
    return fit_and_score(campaign, splits)[1]


def fit_and_score(campaign: Campaign, splits: int) -> tuple[OutcomeFit, "xarray.Dataset"]:
    """Fit a campaign whole and by halves, from one sample, and score the halves."""
    parts = _draw_parts(campaign, splits)
    everything = np.ones(len(campaign.overturned), bool)
    fitted = fit_parts(campaign, [everything, *parts])
    fit = make_outcome_fit(campaign, fitted)
    return fit, _score(campaign, fitted, parts)


def _draw_parts(campaign: Campaign, splits: int) -> list[np.ndarray]:
    """Draw which tests are fitted, for each split."""
    if type(splits) is not int or splits < 1:
        raise ValueError(f"splits must be a whole number from 1 on, got {splits!r:.60}")
    number = len(campaign.groups)
    if number < 2:
        raise ValueError(
            "groups must have at least two names, one to fit and one to predict, got only"
            f" {campaign.groups[0]!r}"
        )
    parts = []
    for split in range(splits):
        order = np.random.default_rng(campaign.seed + split).permutation(number)
        parts.append(np.isin(campaign.group, order[: number // 2]))
    return parts


def _score(
    campaign: Campaign, fitted: CampaignFit, parts: Sequence[np.ndarray]
) -> "xarray.Dataset":
    """Score the predictions of all splits."""
    overturned = campaign.overturned
    measures = measure_tests(campaign.suite)
    probability = np.full((len(PREDICTORS), len(parts), overturned.size), np.nan)
    for split, part in enumerate(parts):
        held_out = ~part
        predicted = _predict(fitted, split + 1)[: overturned.size]
        rules = [
            fit_intensity_rule(measures[name][part], overturned[part]).probability(
                measures[name][held_out]
            )
            for name in ("pgv", "pga")
        ]
        base_rate = np.full(held_out.sum(), overturned[part].mean())
        probability[:, split, held_out] = [predicted[held_out], *rules, base_rate]
    reliability = compute_reliability(
        probability[0], overturned, weight_held_out(probability[0]), confidence=_CONFIDENCE
    )
    held_out_splits = (~np.isnan(probability[0])).sum(axis=0)
    mean = np.nansum(probability, axis=1) / np.where(held_out_splits, held_out_splits, np.nan)
    variables: dict[str, Labelled] = {
        name: (("predictor", "split"), score(probability, overturned), _describe(words, "1"))
        for name, (words, score) in _SCORES.items()
    }
    variables["probability"] = (
        ("predictor", "test"),
        mean,
        _describe("probability of overturning, mean of splits that did not fit the test", "1"),
    )
    variables["overturned"] = (
        "test",
        overturned.astype(np.int8),
        _describe("1 where the block overturned", "1"),
    )
    variables["group"] = (
        "test",
        np.array(campaign.groups)[campaign.group],
        {"long_name": "group of the test"},
    )
    variables["pgv"] = (
        "test",
        measures["pgv"],
        _describe("peak ground velocity without drift", "m/s"),
    )
    variables["pga"] = ("test", measures["pga"], _describe("peak ground acceleration", "m/s2"))
    words = {
        "bin_low": "lower end of a bin of probability",
        "bin_high": "upper end of a bin of probability",
        "predicted": "mean predicted probability",
        "observed": "frequency of overturning",
        "observed_low": "lower end of the interval of the frequency",
        "observed_high": "upper end of the interval of the frequency",
        "tests": "number of tests, each counted once",
    }
    for name, long_name in words.items():
        variables[name] = ("bin", getattr(reliability, name), _describe(long_name, "1"))
    if campaign.peak_rotations is not None:
        variables |= _score_peaks(campaign, fitted, parts)
    coordinates: dict[str, Labelled] = {
        "split": (
            "split",
            campaign.seed + np.arange(len(parts)),
            {"long_name": "seed of the split"},
        ),
        "bin": (
            "bin",
            np.arange(reliability.tests.size),
            {"long_name": "bin of probability"},
        ),
    }
    attributes: dict[str, object] = {
        "splits": len(parts),
        "seed": campaign.seed,
        "groups": len(campaign.groups),
        "blocks": len(fitted.sample.coordinates),
        "confidence": _CONFIDENCE,
        "model": campaign.simulator.model.name,
        **describe_suite(campaign.suite),
    }
    dataset = make_dataset("Predicted outcomes of tests", variables, coordinates, attributes)
    return add_names(
        dataset,
        predictor=(PREDICTORS, "predictor of the outcome"),
        test=(campaign.suite.names, "test"),
    )


def _describe(long_name: str, units: str) -> dict[str, str]:
    """Make the attributes of a variable."""
    return {"long_name": long_name, "units": units}


def _predict(fitted: CampaignFit, part: int) -> np.ndarray:
    """Predict the probabilities of all tests by the population fitted to a part."""
    population = unpack_population(fitted.searched[part].free)
    return np.asarray(
        compute_probability(population, fitted.sample.points, fitted.data.outcomes), float
    )


def _score_peaks(
    campaign: Campaign, fitted: CampaignFit, parts: Sequence[np.ndarray]
) -> dict[str, "Labelled"]:
    """Score predicted peaks of blocks that stand, in the tests where one was measured."""
    peaks = fitted.sample.peaks
    measured = campaign.peak_rotations
    assert peaks is not None
    assert measured is not None
    scores = np.full((3, len(parts)), np.nan)
    for split, part in enumerate(parts):
        population = unpack_population(fitted.searched[split + 1].free)
        of_blocks = np.asarray(average_weights(population, fitted.sample.points), float)
        weights = np.where(fitted.sample.overturned, 0.0, of_blocks)
        scored = ~part & ~np.isnan(measured) & (weights.sum(axis=1) > 0)
        if not scored.any():
            continue
        samples = peaks[scored].astype(float)
        crps = compute_crps(samples, weights[scored], measured[scored])
        compared = compare_distributions(samples, weights[scored], measured[scored])
        scores[:, split] = np.mean(crps), compared.distance, compared.p_value
    words = {
        "crps": _describe("continuous ranked probability score of peaks", "rad"),
        "ks_distance": _describe("Kolmogorov-Smirnov distance of peaks", "1"),
        "ks_p_value": _describe("p-value of the Kolmogorov-Smirnov test of peaks", "1"),
    }
    variables: dict[str, Labelled] = {
        name: ("split", values, words[name])
        for name, values in zip(words, scores, strict=True)
    }
    variables["peak_rotation"] = ("test", measured, _describe("measured peak rotation", "rad"))
    return variables


def tabulate_scores(scores: "xarray.Dataset") -> dict[str, list[Any]]:
    """List mean and standard deviation of each score over the splits, a row a predictor.

    Parameters
    ----------
    scores : xarray.Dataset
        From `cross_validate`.

    Returns
    -------
    dict of list
    """
    columns = {"predictor": scores.predictor.values.tolist()}
    for name in _SCORES:
        columns[name] = scores[name].mean("split").values.tolist()
        # One split says nothing of others.
        several = scores[name] if scores.sizes["split"] > 1 else scores[name] * np.nan
        columns[f"{name}_deviation"] = several.std("split", ddof=1).values.tolist()
    return columns


def tabulate_tests(scores: "xarray.Dataset") -> dict[str, list[Any]]:
    """List the tests with their motions, outcomes and predictions, a row each.

    Parameters
    ----------
    scores : xarray.Dataset
        From `cross_validate`.

    Returns
    -------
    dict of list
    """
    names = ("group", "pgv", "pga", "overturned", "peak_rotation")
    columns = {"name": scores.test.values.tolist()}
    columns |= {name: scores[name].values.tolist() for name in names if name in scores}
    for predictor in scores.predictor.values.tolist():
        probability = scores.probability.sel(predictor=predictor)
        columns[f"probability by {predictor}"] = probability.values.tolist()
    return columns


def describe_scores(scores: "xarray.Dataset") -> str:
    """Write the scores of all predictors.

    Parameters
    ----------
    scores : xarray.Dataset
        From `cross_validate`.

    Returns
    -------
    str
    """
    table = tabulate_scores(scores)
    columns = {
        name: [
            f"{mean:.3f}" if np.isnan(deviation) else f"{mean:.3f} ± {deviation:.3f}"
            for mean, deviation in zip(table[name], table[f"{name}_deviation"], strict=True)
        ]
        for name in _SCORES
    }
    title = f"scores for tests that were not fitted, {scores.sizes['split']} splits"
    lines = [format_table(title, table["predictor"], **columns)]
    if "crps" in scores:
        means = (float(scores[name].mean("split")) for name in PEAK_SCORES)
        lines.append(
            "peak rotations: CRPS {:.4g} rad, Kolmogorov-Smirnov distance {:.3f}, its p-value"
            " {:.3g}".format(*means)
        )
    return "\n".join(lines)
