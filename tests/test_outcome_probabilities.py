"""Probabilities of outcomes and their errors, against SciPy, closed forms, direct sampling."""

import numpy as np
import pytest
from scipy import integrate, stats
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.sensitivity.distributions import (
    compute_scores,
    draw_normal_numbers,
    map_normal_numbers,
)
from jaxrock.sensitivity.outcome_statistics import (
    compute_derivatives,
    compute_interval,
    compute_sobol_indices,
)

float64 = pytest.mark.float64
BLOCK = jr.Block.from_size(width=0.2, height=0.8)


def find_beta(mean, variation):
    """SciPy's Beta distribution with a mean and a coefficient of variation."""
    total = (1 - mean) / (mean * variation**2) - 1
    return stats.beta(mean * total, (1 - mean) * total)


@float64
def test_derivatives_of_a_probability_are_those_of_its_closed_form():
    """Of the probability that a product with a lognormal number is large."""
    names = ("width", "restitution")
    values = np.array([0.5, 0.8])
    variations = np.array([0.1, 0.08])
    limit = 0.42

    def compute_probability(values, variations):
        deviation = np.sqrt(np.log1p(variations[0] ** 2))
        beta = find_beta(values[1], variations[1])

        def integrand(x):
            return stats.norm.sf(np.log(limit / x / values[0]) / deviation) * beta.pdf(x)

        ends = beta.ppf([1e-13, 1 - 1e-13])
        return integrate.quad(integrand, *ends, epsabs=1e-13, points=[beta.mean()])[0]

    z = draw_normal_numbers(2, 2**16, 0)
    samples = map_normal_numbers(names, z, values, variations).T
    outcome = (samples[0] * samples[1] > limit).astype(float)[None]
    assert outcome.mean() == pytest.approx(compute_probability(values, variations), abs=2e-3)
    h = 1e-4
    for k, name in enumerate(names):
        score = compute_scores(name, samples[k], values[k], variations[k])
        step = h * np.eye(2)[k]
        low, high = (compute_probability(values * (1 + s * step), variations) for s in (-1, 1))
        derivative, error = compute_derivatives(outcome, score[:, None])
        assert abs(derivative[0] - (high - low) / (2 * h)) < 3 * error[0]
    # Of several records, whose derivatives differ, the records are the sample.
    slopes = np.array([[0.2], [0.5], [1.1]])
    derivative, error = compute_derivatives(slopes * z[:, 0], z[:, :1])
    assert derivative[0] == pytest.approx(0.6, rel=1e-3)
    assert error[0] == pytest.approx(slopes.std(ddof=1) / 3**0.5, rel=1e-2)


@float64
def test_interval_of_a_suite():
    """The records are the units: exact where their shares are 0 or 1, and it covers."""
    for hits in (0, 3, 20):
        shares = np.repeat([1.0, 0.0], [hits, 20 - hits])
        exact = stats.binomtest(hits, 20).proportion_ci(0.95)
        assert compute_interval(shares, 4096) == pytest.approx(exact, abs=0.01)
    rng = np.random.default_rng(0)
    mean = 0.2
    covered = widths = 0
    for _ in range(100):
        low, high = compute_interval(rng.beta(0.2, 0.8, 12), 4096)
        covered += low <= mean <= high
        widths += (high - low) / 100
    assert covered >= 94
    assert widths < 0.55
    # Of one record, the samples are the units.
    low, high = compute_interval(np.array([0.5]), 4096)
    assert (low, high) == pytest.approx((0.4846, 0.5154), abs=1e-4)


@float64
def test_sobol_indices_with_records():
    """Of y = (1 + r) x1 + x2 + x1 x2 + 3 r, r = -1, 0 or 1: variances by hand."""
    rng = np.random.default_rng(0)
    n = 2**15
    first, second = rng.standard_normal((2, 2, n))

    def answer(x):
        r = np.array([-1.0, 0.0, 1.0])[:, None]
        return np.stack([(1 + r) * x[0] + x[1] + x[0] * x[1] + 3 * r, np.ones((3, n))])

    mixed = []
    for k in range(2):
        x = first.copy()
        x[k] = second[k]
        mixed.append(answer(x))
    found = compute_sobol_indices(answer(first), answer(second), np.stack(mixed))
    # E (1 + r)^2 = 5/3, the mean slope is 1; 9 var(r) = 6.
    whole = 5 / 3 + 1 + 1 + 6
    np.testing.assert_allclose(found["first"][0], np.array([1, 1, 6]) / whole, atol=0.015)
    total = np.array([5 / 3 + 1, 1 + 1, 6 + 2 / 3]) / whole
    np.testing.assert_allclose(found["total"][0], total, atol=0.015)
    assert np.isnan(found["first"][1]).all()


# Answers at samples (2, n) under records, as a block gives them: it rarely overturns, or often,
# or with a heavy tail.
ANSWERS = {
    "stands or overturns": lambda x: [np.where(x[1] > 1.6, 1.0, 0.4 + 0.05 * np.sign(x[0]))],
    "overturns": lambda x: [x[0] + 0.5 * x[1] + np.sin(20 * x[0] * x[1]) > 0.5],
    "a heavy tail": lambda x: [x[0] + np.exp(0.8 * x[1])],
    "several records": lambda x: [x[0] + 0.5 * x[1] > limit for limit in (-0.5, 0.3, 1.5)],
    "records and a tail": lambda x: [x[0] + a * np.exp(0.7 * x[1]) for a in (0, 1, 2)],
}


@float64
@pytest.mark.parametrize("name", first_by_default(ANSWERS))
def test_errors_of_sobol_indices_are_those_of_repetitions(name):
    """With independent samples: those of Sobol points have errors that are mostly smaller."""
    rng = np.random.default_rng(0)
    indices, errors = [], []
    for _ in range(800):
        first, second = rng.standard_normal((2, 2, 512))
        mixed = [np.stack([second[0], first[1]]), np.stack([first[0], second[1]])]
        parts = [np.asarray(ANSWERS[name](x), float)[None] for x in (first, second, *mixed)]
        found = compute_sobol_indices(parts[0], parts[1], np.stack(parts[2:]))
        indices.append([found[name][0] for name in ("first", "total")])
        errors.append([found[f"{name}_error"][0] for name in ("first", "total")])
    for index, error in zip(
        np.swapaxes(indices, 0, 1), np.swapaxes(errors, 0, 1), strict=True
    ):
        stated = np.sqrt(np.mean(error**2, axis=0))
        np.testing.assert_allclose(stated / index.std(axis=0), 1, atol=0.13)


RECORD = jr.example_record().scaled(2.0)
VARIATIONS = {"width": 0.02, "restitution": 0.05, "factor": 0.1}


def sample_directly(width, count):
    """By random numbers of another generator, and distributions of SciPy."""
    rng = np.random.default_rng(1)
    values = {"restitution": find_beta(0.8, VARIATIONS["restitution"]).rvs(count, rng)}
    for name in ("width", "factor"):
        deviation = np.sqrt(np.log(1 + VARIATIONS[name] ** 2))
        values[name] = np.exp(deviation * rng.standard_normal(count))
    blocks = jr.Block.from_size(width=width * values["width"], height=0.8)
    motions = RECORD.scaled(values["factor"])
    found = jr.respond_batch(blocks, values["restitution"], motions, RECORD.end + 10)
    fell = np.asarray(found.overturned)
    large = np.asarray(found.peak_rotation) > 0.5 * np.asarray(blocks.critical_angle)
    return values, np.stack([np.asarray(found.peak_rotation) > 0, large | fell, fell])


@pytest.mark.thorough
@float64
def test_probabilities_in_a_chaotic_window_against_direct_sampling():
    count, samples = 2048, 512
    uncertain = jr.Uncertain(VARIATIONS, samples=samples)
    found = jr.sensitivity.outcome_probabilities(BLOCK, 0.8, RECORD, uncertain)
    values, outcomes = sample_directly(0.2, count)
    direct = outcomes.mean(axis=1)
    assert 0.4 < direct[2] < 0.6
    noise = np.sqrt(direct * (1 - direct) * (1 / count + 1 / samples)) + 1e-4
    assert (abs(found.probability - direct) < 3.5 * noise).all(), (found.probability, direct)
    assert (found.low <= direct + 3 * noise).all()
    # The slope to a median, from the same random numbers around another one.
    step = 0.01
    down, up = (sample_directly(0.2 * np.exp(s), count)[1][2].mean() for s in (-step, step))
    k = found.sources.index("width")
    noise = found.by_median_error[3, k] + np.sqrt(0.25 / count) / step
    assert abs(found.by_median[3, k] - (up - down) / (2 * step)) < 4 * noise
    # The first-order index, as the variance of means in bins of equal probability.
    whole = direct[2] * (1 - direct[2])
    for k, name in enumerate(found.sources):
        bins = np.array_split(outcomes[2][np.argsort(values[name])], 20)
        first = (np.var([each.mean() for each in bins]) - 19 / count * whole) / whole
        assert abs(found.first[3, k] - first) < 4 * found.first_error[3, k] + 1 / count**0.5


@pytest.mark.thorough
@float64
def test_a_suite_is_its_records():
    records = [jr.example_record().scaled(factor) for factor in (0.5, 2.0)]
    coefficients = {"half_width": 0.05, "gravity": 0.01, "factor": 0.1}
    uncertain = jr.Uncertain(coefficients, samples=256)
    both, *each = (
        jr.sensitivity.outcome_probabilities(BLOCK, 0.8, motion, uncertain, ratio=0.3)
        for motion in (jr.Suite(records), *records)
    )
    np.testing.assert_array_equal(both.by_record, [single.probability for single in each])
    np.testing.assert_array_equal(both.peak, [single.peak[0] for single in each])
    assert both.sources == ("half_width", "gravity", "factor", "record")
    assert both.high[2] - both.low[2] > 0.5  # of two records


@pytest.mark.thorough
@float64
def test_pulses_and_noise():
    pulse = jr.HalfSine(3.5, 0.5)
    coefficients = {"duration": 0.1, "restitution": 0.05, "factor": 0.1}
    uncertain = jr.Uncertain(coefficients, samples=512)
    found = jr.sensitivity.outcome_probabilities(BLOCK, 0.8, pulse, uncertain)
    # It overturns without an impact, or not at all: the restitution decides nothing.
    assert found.first[3, 1] == 0
    assert 0.1 < found.probability[2] < 0.9
    assert "0.000 +- 0.000" in str(found)
    rare = jr.sensitivity.outcome_probabilities(BLOCK, 0.8, pulse.scaled(0.8), uncertain)
    assert 0 < rare.probability[2] < 20 / 512
    assert np.isnan(rare.first[3]).all()
    values = found.inputs
    pulses = jr.HalfSine(3.5 * values["factor"], values["duration"])
    response = jr.respond_batch(BLOCK, values["restitution"], pulses, pulses.end + 10)
    # The rotation is highest after the end of the pulse.
    large = response.overturned | (response.peak_rotation > 0.5 * BLOCK.critical_angle)
    for outcome, expected in ((2, response.overturned), (1, large)):
        assert found.probability[outcome] == np.asarray(expected).mean()
