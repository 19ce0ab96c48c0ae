"""Scores of predicted probabilities and distributions, and rules in an intensity alone."""

import itertools
import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy import integrate, optimize, stats

import jaxrock as jr
from jaxrock.calibration.outcomes.intensity_rules import fit_intensity_rule, measure_tests
from jaxrock.calibration.outcomes.scores import (
    accuracy,
    brier_score,
    compare_distributions,
    compute_crps,
    compute_reliability,
    log_score,
    weight_held_out,
)
from jaxrock.ground_motion import measure_drift

RANDOM = np.random.default_rng(8)
PROBABILITY = RANDOM.uniform(size=60)
OVERTURNED = RANDOM.uniform(size=60) < PROBABILITY
WEIGHTS = RANDOM.uniform(size=60)
SCORES = {
    "brier": (brier_score, lambda p, o: (p - o) ** 2),
    "log": (log_score, lambda p, o: -math.log(p if o else 1 - p)),
    "accuracy": (accuracy, lambda p, o: float((p > 0.5) == o)),
}


@pytest.mark.parametrize(("score", "of_test"), SCORES.values(), ids=SCORES)
def test_scores_are_weighted_means_over_tests(score, of_test):
    parts = [of_test(p, o) for p, o in zip(PROBABILITY, OVERTURNED, strict=True)]
    assert score(PROBABILITY, OVERTURNED) == pytest.approx(sum(parts) / 60, rel=1e-13)
    weighted = sum(w * part for w, part in zip(WEIGHTS, parts, strict=True)) / sum(WEIGHTS)
    assert score(PROBABILITY, OVERTURNED, WEIGHTS) == pytest.approx(weighted, rel=1e-13)
    # Of several splits, and without tests that are NaN.
    splits = np.stack([PROBABILITY, PROBABILITY])
    splits[1, 7:] = np.nan
    expected = [sum(parts) / 60, sum(parts[:7]) / 7]
    np.testing.assert_allclose(score(splits, OVERTURNED), expected, rtol=1e-13)
    assert np.isnan(score(np.full(3, np.nan), OVERTURNED[:3]))


@pytest.mark.parametrize("score", [brier_score, log_score])
@given(st.floats(0.001, 0.999), st.floats(0.0, 1.0))
def test_the_true_probability_has_the_best_expected_score(score, truth, claim):
    outcomes = np.array([True, False])
    weights = np.array([truth, 1 - truth])
    honest = score(np.full(2, truth), outcomes, weights)
    claimed = score(np.full(2, claim), outcomes, weights)
    assert claimed >= honest * (1 - 1e-14)
    # By (claim - truth)^2 at least: of the logarithm by the inequality of Pinsker.
    assert claimed - honest >= 0.999 * (claim - truth) ** 2 - 1e-14


def test_scores_of_certain_predictions():
    certain = np.array([1.0, 0.0])
    right = np.array([True, False])
    assert log_score(certain, right) == brier_score(certain, right) == 0
    assert accuracy(certain, right) == 1
    for k in range(2):
        single = certain[k : k + 1]
        assert log_score(single, ~right[k : k + 1]) == math.inf
        assert brier_score(single, ~right[k : k + 1]) == 1
    # What has no weight does not count, though it is infinite.
    assert log_score(certain, np.array([True, True]), np.array([1.0, 0.0])) == 0
    # No digits of small probabilities are lost.
    tiny = log_score(np.array([1e-20]), np.array([False]))
    assert tiny == pytest.approx(1e-20, rel=1e-15, abs=0)
    halves = np.array([0.5, 0.5, np.nextafter(0.5, 1)])
    assert accuracy(halves, np.array([True, False, True])) == pytest.approx(2 / 3)


def test_reliability_counts_each_test_in_its_bin():
    table = compute_reliability(PROBABILITY, OVERTURNED, np.ones(60), bins=5, confidence=0.8)
    for k in range(5):
        inside = [math.floor(5 * p) == k for p in PROBABILITY]
        count = sum(inside)
        overturned = int(sum(OVERTURNED[inside]))
        assert table.tests[k] == count > 0
        assert (table.bin_low[k], table.bin_high[k]) == (k / 5, (k + 1) / 5)
        assert table.predicted[k] == pytest.approx(sum(PROBABILITY[inside]) / count)
        assert table.observed[k] == pytest.approx(overturned / count)
        interval = stats.binomtest(overturned, count).proportion_ci(0.8, method="exact")
        assert table.observed_low[k] == pytest.approx(interval.low, rel=1e-9)
        assert table.observed_high[k] == pytest.approx(interval.high, rel=1e-9)


def test_reliability_at_the_ends_of_bins_and_without_tests():
    probability = np.array([0.0, 0.3, 0.7, 1.0, 1.0])
    overturned = np.array([False, True, False, True, True])
    table = compute_reliability(probability, overturned, np.ones(5))
    np.testing.assert_array_equal(np.flatnonzero(table.tests), [0, 3, 7, 9])
    np.testing.assert_array_equal(table.predicted[[0, 3, 7, 9]], [0, 0.3, 0.7, 1])
    empty = table.tests == 0
    for values in table[2:6]:
        np.testing.assert_array_equal(np.isnan(values), empty)
    # All or none overturned.
    assert table.observed_low[0] == 0
    assert table.observed_high[9] == 1
    assert table.observed_low[9] == pytest.approx(0.05**0.5)


def test_reliability_of_splits_counts_each_test_once():
    probability = np.tile(PROBABILITY, (4, 1))
    held_out = RANDOM.uniform(size=probability.shape) < 0.5
    probability[~held_out] = np.nan
    weights = weight_held_out(probability)
    tested = held_out.any(axis=0)
    assert not tested.all()
    np.testing.assert_allclose(weights.sum(axis=0), tested, rtol=1e-15)
    assert (weights[~held_out] == 0).all()
    table = compute_reliability(probability, OVERTURNED, weights)
    # Where all splits predict the same, it is the table of the tests that were predicted.
    expected = compute_reliability(PROBABILITY, OVERTURNED, tested.astype(float))
    for name in table._fields:
        np.testing.assert_allclose(
            getattr(table, name), getattr(expected, name), rtol=1e-12, err_msg=name
        )
    np.testing.assert_array_equal(weight_held_out(PROBABILITY), np.ones(60))


def test_an_interval_of_a_count_that_is_not_whole():
    table = compute_reliability(
        np.full(3, 0.5), np.array([True, False, True]), np.array([0.5, 1.0, 0.25]), bins=1
    )
    assert table.observed[0] == pytest.approx(0.75 / 1.75)
    # Quantiles of beta distributions: their integrals are the tails.
    for value, a, b, tail in (
        (table.observed_low[0], 0.75, 2.0, 0.05),
        (table.observed_high[0], 1.75, 1.0, 0.95),
    ):
        # Substituted, so that the integrand is finite at 0.
        below, _ = integrate.quad(lambda u: (1 - u ** (1 / a)) ** (b - 1) / a, 0, value**a)  # noqa: B023
        whole = math.gamma(a) * math.gamma(b) / math.gamma(a + b)
        assert below / whole == pytest.approx(tail, rel=1e-8)


SAMPLES = RANDOM.gamma(2.0, size=(3, 20))
SAMPLES[:, :5] = 0.0  # as of blocks that do not rock
SAMPLE_WEIGHTS = RANDOM.uniform(size=20) * (RANDOM.uniform(size=20) < 0.8)
OBSERVED = np.array([0.0, 1.5, 30.0])


def test_crps_is_the_integral_of_the_squared_difference():
    scores = compute_crps(SAMPLES, SAMPLE_WEIGHTS, OBSERVED)
    for samples, observed, score in zip(SAMPLES, OBSERVED, scores, strict=True):

        def integrand(x, samples=samples, observed=observed):
            below = SAMPLE_WEIGHTS[samples <= x].sum() / SAMPLE_WEIGHTS.sum()
            return (below - (x >= observed)) ** 2

        places = np.unique([*samples, observed])
        pieces = itertools.pairwise(places)
        integral = sum(integrate.quad(integrand, *piece)[0] for piece in pieces)
        assert score == pytest.approx(integral, rel=1e-9)


def test_crps_is_mean_distance_less_half_the_distance_of_samples():
    weights = RANDOM.uniform(size=SAMPLES.shape)
    weights[:, ::3] = 0
    scores = compute_crps(SAMPLES, weights, OBSERVED)
    for k in range(3):
        w = weights[k] / weights[k].sum()
        distance = sum(w * abs(SAMPLES[k] - OBSERVED[k]))
        apart = w @ abs(SAMPLES[k][:, None] - SAMPLES[k]) @ w
        assert scores[k] == pytest.approx(distance - apart / 2, rel=1e-12)
    # Samples without weight may be anything, as rotations of blocks that overturned are.
    unknown = np.where(weights > 0, SAMPLES, RANDOM.choice([np.nan, np.inf], SAMPLES.shape))
    np.testing.assert_array_equal(compute_crps(unknown, weights, OBSERVED), scores)


def test_crps_where_it_is_known():
    half_normal = stats.norm.ppf((np.arange(4000) + 0.5) / 4000)[None]
    even = np.ones(4000)
    # Of the standard normal distribution: (sqrt(2) - 1) / sqrt(pi) at its middle.
    middle = compute_crps(half_normal, even, np.zeros(1))
    assert middle == pytest.approx((2**0.5 - 1) / math.pi**0.5, rel=1e-4)
    # Of a single sample it is the distance.
    assert compute_crps(np.array([[2.0]]), np.ones(1), np.array([-1.0])) == 3
    assert compute_crps(np.array([[2.0, np.inf]]), np.ones(2), np.zeros(1)) == np.inf
    assert np.isnan(compute_crps(np.array([[2.0]]), np.zeros(1), np.zeros(1)))
    assert np.isnan(compute_crps(np.array([[2.0]]), np.ones(1), np.array([np.nan])))


def test_distributions_are_compared_with_the_mixture_of_all_tests():
    samples = RANDOM.gamma(2.0, size=(30, 400))
    observed = RANDOM.gamma(2.5, size=30)
    weights = RANDOM.uniform(size=400)
    weights[::7] = 0
    samples[:, ::7] = np.nan

    def mixture(x):
        return np.array([(weights @ (samples <= value).T).mean() for value in x]) / sum(
            weights
        )

    statistic, p_value = stats.ks_1samp(observed, mixture)
    comparison = compare_distributions(samples, weights, observed)
    # The reference takes the mixture for continuous, within a jump.
    assert comparison.distance == pytest.approx(statistic, abs=2e-4)
    assert comparison.p_value == pytest.approx(p_value, rel=5e-3)


def test_peaks_that_are_equal_do_not_count_as_different():
    """Six of ten blocks do not rock, in the tests as in the prediction."""
    observed = np.array([0.0] * 6 + [1.0, 2.0, 3.0, 4.0])
    samples = np.tile(observed, (10, 1))
    exact = compare_distributions(samples, np.ones(10), observed)
    assert exact.distance == pytest.approx(0, abs=1e-12)
    assert exact.p_value == pytest.approx(1)
    # Against the difference of both functions wherever either jumps.
    shifted = np.where(samples > 0, samples + 1.5, np.where(np.arange(10) < 3, 0.5, 0.0))
    places = np.unique([*shifted.ravel(), *observed])
    differences = [(shifted <= x).mean() - (observed <= x).mean() for x in places]
    distance = max(map(abs, differences))
    comparison = compare_distributions(shifted, np.ones(10), observed)
    assert comparison.distance == pytest.approx(distance, rel=1e-12)
    assert comparison.p_value == pytest.approx(stats.kstwo.sf(distance, 10), rel=1e-9)


def mixed_tests(count, seed=3):
    """Intensities and outcomes of tests by a logistic rule."""
    random = np.random.default_rng(seed)
    intensity = 0.4 * np.exp(0.8 * random.standard_normal(count))
    truth = 1 / (1 + (intensity / 0.5) ** -2.5)
    return intensity, random.uniform(size=count) < truth


@pytest.mark.parametrize("weighted", [False, True])
def test_a_rule_is_the_logistic_regression_of_greatest_likelihood(weighted):
    intensity, overturned = mixed_tests(50)
    assert 10 < overturned.sum() < 40
    weights = np.linspace(0.0, 2.0, 50) if weighted else None
    weight = np.ones(50) if weights is None else weights
    rule = fit_intensity_rule(intensity, overturned, weights)

    # By the median and the dispersion, without a gradient.
    def loss(x):
        logit = np.log(intensity / np.exp(x[0])) / np.exp(x[1])
        return sum(weight * np.logaddexp(0, np.where(overturned, -logit, logit)))

    options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000}
    known = optimize.minimize(loss, [0.0, 0.0], method="Nelder-Mead", options=options)
    grid = np.geomspace(0.05, 3.0, 30)
    likeliest = 1 / (1 + np.exp(-np.log(grid / np.exp(known.x[0])) / np.exp(known.x[1])))
    probability = rule.probability(grid)
    # The prior changes nothing that would be seen in a picture.
    np.testing.assert_allclose(probability, likeliest, atol=0.01)
    # The equations of the score, to some tenth of a test.
    residuals = weight * (overturned - rule.probability(intensity))
    logarithm = np.log(intensity)
    mean = np.average(logarithm, weights=weight)
    deviation = np.average((logarithm - mean) ** 2, weights=weight) ** 0.5
    standardized = (logarithm - mean) / deviation
    intercept = rule.intercept + rule.slope * mean
    slope = rule.slope * deviation
    assert abs(sum(residuals)) < 0.1
    assert abs(sum(residuals * standardized)) < 0.15
    # With the priors they are zero.
    assert sum(residuals) == pytest.approx(intercept / 25, abs=1e-8)
    assert sum(residuals * standardized) == pytest.approx(slope / 25, abs=1e-8)


def test_a_rule_does_not_depend_on_the_unit():
    intensity, overturned = mixed_tests(50)
    rule = fit_intensity_rule(intensity, overturned)
    in_millimetres = fit_intensity_rule(1000 * intensity, overturned)
    assert in_millimetres.slope == pytest.approx(rule.slope, rel=1e-7)
    np.testing.assert_allclose(
        in_millimetres.probability(1000 * intensity), rule.probability(intensity), rtol=1e-7
    )
    assert rule.probability(np.zeros(1)) == 0


@pytest.mark.parametrize(
    ("intensity", "overturned"),
    [
        ([0.1, 0.2, 0.3, 0.4], [False, False, True, True]),
        ([0.1, 0.2, 0.3, 0.4], [True] * 4),
        ([0.1, 0.2, 0.3, 0.4], [False] * 4),
        ([0.3], [True]),
        ([0.1] * 10, [True, True] + [False] * 8),
        ([0.1, 10.0] * 500, [False, True] * 500),
    ],
    ids=["separated", "all", "none", "single", "of one intensity", "many separated"],
)
def test_a_rule_is_finite_whatever_happened(intensity, overturned):
    intensity = np.array(intensity)
    overturned = np.array(overturned)
    rule = fit_intensity_rule(intensity, overturned)
    probability = rule.probability(intensity)
    assert np.isfinite(rule).all()
    assert ((probability > 0) & (probability < 1)).all()
    assert log_score(probability, overturned) < math.log(2)
    if len(set(intensity)) == 1:
        assert rule.slope == pytest.approx(0, abs=1e-9)


def test_an_intensity_of_zero_is_refused():
    with pytest.raises(
        ValueError,
        match=r"intensity must be finite and greater than 0, got 0 \(out of range: 1",
    ):
        fit_intensity_rule(np.array([0.0, 0.3]), np.array([False, True]))


def test_tests_are_measured_without_drift_and_on_the_ground():
    step = 0.01
    samples = np.random.default_rng(2).standard_normal((2, 1000))
    # At rest at the end, where straight lines between samples are integrated exactly.
    samples -= (samples.sum(axis=1) - 0.5 * (samples[:, 0] + samples[:, -1]))[:, None] / 999
    offsets = np.array([0.3, -2.0])
    steady = jr.Suite([jr.Record(row, step) for row in samples]).scaled(np.array([2.0, -1.0]))
    table = jr.Suite(
        [jr.Record(row + a, step) for row, a in zip(samples, offsets, strict=True)]
    ).scaled(np.array([2.0, -1.0]))
    for suite in (table, table.on_floor(period=0.3)):
        measures = measure_tests(suite)
        np.testing.assert_allclose(measures["pgv"], steady.measure("pgv"), rtol=1e-9)
        np.testing.assert_allclose(measures["pga"], table.measure("pga"), rtol=1e-12)
    # With the drift it is the measure of the record, and the end is the offset's.
    for record, offset in zip(table, offsets, strict=True):
        drift = measure_drift(record)
        scale = abs(float(record.scale))
        known = float(jr.ground_motion.intensity_measure(record, "pgv"))
        assert scale * drift.peak == pytest.approx(known, rel=1e-12)
        assert drift.end == pytest.approx(offset * 999 * step, rel=1e-9)
