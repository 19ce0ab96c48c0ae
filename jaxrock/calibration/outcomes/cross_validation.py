"""Scores of predicted outcomes on tests that were not fitted."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO
from ...ground_motion import Suite, describe_suite, measure_drift
from ...host import add_names, format_table, make_dataset
from ...resonance import ModelLike, Nonlinear
from ...validation import Flags, Number, Reals, as_array
from .answer import OutcomeFit, make_outcome_fit
from .campaign import Campaign, CampaignFit, check_campaign, fit_parts
from .likelihood import Points, compute_probability
from .posterior import scale_to_prior
from .prior import Prior, PriorLike
from .scores import compute_reliability, compute_scores, predict_by_intensity

if TYPE_CHECKING:
    import xarray

_PREDICTORS = ("blocks", "pgv", "pga", "base rate")
_CONFIDENCE = 0.9  # of intervals of observed frequencies
_SCORES = ("brier", "log_score", "accuracy")
# Dimensions, long name and unit of the variables of a dataset of scores.
_OVER_SPLITS = ("predictor", "split")
_VARIABLES = {
    "brier": (_OVER_SPLITS, "Brier score", "1"),
    "log_score": (_OVER_SPLITS, "logarithmic score", "1"),
    "accuracy": (_OVER_SPLITS, "fraction of outcomes with a probability above 1/2", "1"),
    "probability": (("predictor", "test"), "mean probability where not fitted", "1"),
    "overturned": ("test", "1 where the block overturned", "1"),
    "pgv": ("test", "peak ground velocity without drift", "m/s"),
    "pga": ("test", "peak ground acceleration", "m/s2"),
    "predicted": ("bin", "mean predicted probability", "1"),
    "observed": ("bin", "frequency of overturning", "1"),
    "observed_low": ("bin", "lower end of the interval of the frequency", "1"),
    "observed_high": ("bin", "upper end of the interval of the frequency", "1"),
    "tests": ("bin", "number of tests, each counted once", "1"),
}


def cross_validate(  # noqa: PLR0913
    suite: Suite,
    overturned: Flags,
    groups: Sequence[object] | None = None,
    *,
    splits: int = 40,
    seed: int = 0,
    prior: PriorLike | None = None,
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
    suite, overturned, prior, samples, model, gravity, inertia_ratio, one_sided
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
        prior=prior,
        samples=samples,
        seed=seed,
        model=model,
        gravity=gravity,
        inertia_ratio=inertia_ratio,
        one_sided=one_sided,
    )
    return fit_and_score(campaign, splits)[1]


def fit_and_score(campaign: Campaign, splits: int) -> tuple[OutcomeFit, "xarray.Dataset"]:
    """Fit a campaign whole and by halves, from one sample, and score the halves."""
    if type(splits) is not int or splits < 1:
        raise ValueError(f"splits must be a whole number from 1 on, got {splits!r:.60}")
    number = len(campaign.groups)
    if number < 2:
        raise ValueError(
            "groups must have at least two names, one to fit and one to predict, got only"
            f" {campaign.groups[0]!r}"
        )
    subsets = [np.ones(len(campaign.overturned), bool)]
    for split in range(splits):
        order = np.random.default_rng(campaign.seed + split).permutation(number)
        subsets.append(np.isin(campaign.group, order[: number // 2]))
    fitted = fit_parts(campaign, subsets)
    return make_outcome_fit(campaign, fitted), _score(campaign, fitted, subsets[1:])


def _score(
    campaign: Campaign, fitted: CampaignFit, subsets: Sequence[np.ndarray]
) -> "xarray.Dataset":
    """Score the predictions of all splits."""
    overturned = campaign.overturned
    measures = measure_tests(campaign.suite)
    probability = np.full((len(_PREDICTORS), len(subsets), overturned.size), np.nan)
    for split, subset in enumerate(subsets):
        standard = as_array(fitted.modes[split + 1].standard)
        prior, points, data = fitted.evidence
        blocks = _predict(standard, prior, points, data.outcomes)[: overturned.size]
        rules = [predict_by_intensity(m, overturned, subset) for m in measures.values()]
        base_rate = np.full(overturned.size, overturned[subset].mean())
        predictions = np.stack([np.asarray(blocks, float), *rules, base_rate])
        probability[:, split, ~subset] = predictions[:, ~subset]
    times = np.sum(~np.isnan(probability[0]), axis=0)
    values = {
        **compute_scores(probability, overturned),
        "probability": np.nansum(probability, axis=1) / np.where(times, times, np.nan),
        "overturned": overturned.astype(np.int8),
        **measures,
        **compute_reliability(probability[0], overturned, _CONFIDENCE),
    }
    variables = {
        name: (dimensions, values[name], {"long_name": long_name, "units": unit})
        for name, (dimensions, long_name, unit) in _VARIABLES.items()
    }
    seeds = campaign.seed + np.arange(len(subsets))
    bins = np.arange(values["tests"].size)
    coordinates = {
        "split": ("split", seeds, {"long_name": "seed of the split"}),
        "bin": ("bin", bins, {"long_name": "bin of probability"}),
    }
    attributes = {
        "splits": len(subsets),
        "seed": campaign.seed,
        "groups": len(campaign.groups),
        "blocks": len(fitted.evidence.points.coordinates),
        "confidence": _CONFIDENCE,
        "model": campaign.simulator.model.name,
        **describe_suite(campaign.suite),
    }
    dataset = make_dataset("Predicted outcomes of tests", variables, coordinates, attributes)
    names = np.array(campaign.groups)[campaign.group]
    dataset["group"] = ("test", names, {"long_name": "group of the test"})
    return add_names(
        dataset,
        predictor=(_PREDICTORS, "predictor of the outcome"),
        test=(campaign.suite.names, "test"),
    )


@jax.jit
def _predict(standard: Reals, prior: Prior, points: Points, outcomes: Reals) -> Reals:
    """Predict the probabilities of all tests by a population."""
    return compute_probability(scale_to_prior(standard, prior), points, outcomes)


def measure_tests(suite: Suite) -> dict[str, np.ndarray]:
    """Measure the intensities of motions of tests, as they are scaled.

    The peak ground velocity is the one without the drift, a straight line from rest to the
    velocity at the end: a shaking table starts and ends at rest, and an accelerometer with an
    offset makes it seem to move on. The intensities of a suite on a floor refer to the ground.

    Parameters
    ----------
    suite : Suite
        Concrete, of one scale for each record.

    Returns
    -------
    dict
        ``"pgv"`` [m/s] and ``"pga"`` [m/s2], each of shape (tests,). Both are exact for lines
        between samples.
    """
    records = suite.records if suite.ground is None else suite.ground.records
    velocities = [abs(float(r.scale)) * measure_drift(r).steady for r in records]
    return {"pgv": np.array(velocities), "pga": np.asarray(suite.measure("pga"), float)}


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
        # One split has no standard deviation.
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
    names = ("group", "pgv", "pga", "overturned")
    columns = {"name": scores.test.values.tolist()}
    columns |= {name: scores[name].values.tolist() for name in names}
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
    title = f"scores for tests that were not fitted, {scores.sizes['split']} splits"
    return format_table(title, table.pop("predictor"), **table)
