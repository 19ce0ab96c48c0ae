"""Scores of predicted probabilities, and rules in an intensity alone."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy import optimize, stats

from jaxrock.calibration.outcomes.scores import (
    compute_reliability,
    compute_scores,
    predict_by_intensity,
)

RANDOM = np.random.default_rng(8)
PROBABILITY = RANDOM.uniform(size=60)
OVERTURNED = RANDOM.uniform(size=60) < PROBABILITY


def test_scores_are_means_over_the_tests_that_were_not_fitted():
    splits = np.stack([PROBABILITY, PROBABILITY])
    splits[1, 7:] = np.nan
    p = np.where(OVERTURNED, PROBABILITY, 1 - PROBABILITY)
    expected = {"brier": (1 - p) ** 2, "log_score": -np.log(p), "accuracy": p > 0.5}
    for name, each in expected.items():
        means = [each.mean(), each[:7].mean()]
        np.testing.assert_allclose(compute_scores(splits, OVERTURNED)[name], means, rtol=1e-12)
    certain = np.array([1.0, 0.0])
    for overturned, scores in (([True, False], (0, 0, 1)), ([False, True], (1, math.inf, 0))):
        found = compute_scores(certain, np.array(overturned))
        assert (found["brier"], found["log_score"], found["accuracy"]) == scores


@pytest.mark.parametrize("name", ["brier", "log_score"])
@given(st.floats(0.001, 0.999), st.floats(0.001, 0.999))
def test_the_true_probability_has_the_best_expected_score(name, truth, claim):
    def expect(probability):
        scores = compute_scores(np.full((2, 1), probability), np.array([[True], [False]]))
        return np.array([truth, 1 - truth]) @ scores[name]

    assert expect(claim) - expect(truth) >= 0.999 * (claim - truth) ** 2 - 1e-14


def test_reliability_counts_each_test_once_in_its_bins():
    splits = np.tile(PROBABILITY, (4, 1))
    held_out = RANDOM.uniform(size=splits.shape) < 0.5
    splits[~held_out] = np.nan
    tested = held_out.any(axis=0)
    assert not tested.all()
    table = compute_reliability(splits, OVERTURNED, 0.8, bins=5)
    for k in range(5):
        inside = tested & (np.floor(5 * PROBABILITY) == k)
        count = int(inside.sum())
        overturned = int(OVERTURNED[inside].sum())
        assert table["tests"][k] == pytest.approx(count)
        assert table["predicted"][k] == pytest.approx(PROBABILITY[inside].mean())
        assert table["observed"][k] == pytest.approx(overturned / count)
        interval = stats.binomtest(overturned, count).proportion_ci(0.8, method="exact")
        assert table["observed_low"][k] == pytest.approx(interval.low, rel=1e-9)
        assert table["observed_high"][k] == pytest.approx(interval.high, rel=1e-9)


def test_a_rule_is_the_logistic_regression_of_greatest_posterior_density():
    intensity = 0.4 * np.exp(0.8 * RANDOM.standard_normal(80))
    overturned = RANDOM.uniform(size=80) < 1 / (1 + (intensity / 0.5) ** -2.5)
    fitted = np.arange(80) < 50
    known = np.log(intensity)
    standardized = (known - known[fitted].mean()) / known[fitted].std()

    def lose(x):
        logit = x[0] + x[1] * standardized[fitted]
        loss = sum(np.logaddexp(0, np.where(overturned[fitted], -logit, logit)))
        return loss + sum(np.square(x)) / 50

    options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000}
    best = optimize.minimize(lose, [0.0, 0.0], method="Nelder-Mead", options=options).x
    expected = 1 / (1 + np.exp(-best[0] - best[1] * standardized))
    computed = predict_by_intensity(intensity, overturned, fitted)
    np.testing.assert_allclose(computed, expected, atol=1e-6)
    # Whatever the unit, and whatever happened in the tests that are predicted.
    changed = predict_by_intensity(1000 * intensity, overturned ^ ~fitted, fitted)
    np.testing.assert_allclose(changed, computed, rtol=1e-6)
