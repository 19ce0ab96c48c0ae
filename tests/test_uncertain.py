"""Uncertain parameters, alone and correlated: what is drawn, against SciPy and closed forms."""

import numpy as np
import pytest
from scipy import stats

import jaxrock as jr
from jaxrock.sensitivity import draw_normal_numbers

DOUBLE = pytest.mark.float64
BLOCK = jr.Block(0.25, 4.0)
ANGLE = "critical_angle"
FREQUENCY = "frequency_parameter"
NUMBERS = ("half_width", "slenderness", "gravity", "inertia_ratio")


def compute_log_deviation(coefficient):
    """The standard deviation of the logarithm of a lognormal parameter."""
    return np.sqrt(np.log1p(np.square(coefficient)))


@DOUBLE
def test_draws_are_a_net():
    """One point in each of n strips of equal probability: what random numbers do not have."""
    n = 1024
    coefficients = {"width": 0.1, "restitution": 0.08}
    z, again, others = (
        jr.Uncertain(coefficients, samples=n, seed=seed).draw(BLOCK, 0.8).normal
        for seed in (3, 3, 4)
    )
    for column in z.T:
        assert sorted(np.floor(n * stats.norm.cdf(column)).astype(int)) == list(range(n))
    np.testing.assert_array_equal(z, again)
    assert (z != others).any()


@DOUBLE
def test_what_is_not_uncertain_stays():
    """The other side beside a side, the shape beside a half-width, p beside an angle."""
    draws = jr.Uncertain({"width": 0.1, "inertia_ratio": 0.02}).draw(BLOCK, 0.8)
    np.testing.assert_allclose(2 * draws.block.half_width * draws.block.slenderness, 2.0)
    assert np.ptp(draws.block.half_width) > 0.01
    assert (draws.restitution == 0.8).all()
    sized = jr.Uncertain({"half_width": 0.1}).draw(BLOCK, 0.8).block
    np.testing.assert_allclose(sized.slenderness, 4.0, rtol=1e-12)
    leaning = jr.Uncertain({ANGLE: 0.3}).draw(BLOCK, 0.8).block
    assert np.ptp(leaning.slenderness) > 1
    expected = np.full(64, BLOCK.frequency_parameter)
    np.testing.assert_allclose(leaning.frequency_parameter, expected, rtol=1e-12)


@DOUBLE
def test_blocks_drawn_by_critical_angle_and_frequency_parameter():
    """Those of lognormal samples by SciPy."""
    block = jr.Block(np.full(3, 0.25), 4.0, inertia_ratio=1.25)
    coefficients = {FREQUENCY: 0.05, ANGLE: 0.2, "gravity": 0.01}
    draws = jr.Uncertain(coefficients, samples=64, seed=2).draw(
        block, np.array([0.7, 0.8, 0.9])
    )
    uniform = stats.norm.cdf(draw_normal_numbers(3, 64, 2))
    medians = (block.frequency_parameter, block.critical_angle, block.gravity)
    samples = [
        stats.lognorm(compute_log_deviation(c), scale=np.asarray(median)[..., None]).ppf(
            column
        )
        for median, c, column in zip(medians, coefficients.values(), uniform.T, strict=True)
    ]
    expected = jr.Block.from_parameters(*np.broadcast_arrays(*samples), inertia_ratio=1.25)
    for name in NUMBERS:
        drawn, right = np.broadcast_arrays(getattr(draws.block, name), getattr(expected, name))
        np.testing.assert_allclose(drawn, right, rtol=1e-12)


@DOUBLE
def test_an_object_is_drawn_as_if_it_were_alone():
    """Medians and coefficients differ from object to object, the points do not."""
    half_width = np.array([0.1, 0.2, 0.3])
    restitution = np.array([0.7, 0.8, 0.9])
    coefficients = np.array([0.0, 0.02, 0.05])
    options = {"samples": 8, "seed": 3}
    uncertain = jr.Uncertain({"width": 0.1, "restitution": coefficients}, **options)
    draws = uncertain.draw(jr.Block(half_width, 4.0), restitution)
    for k in range(3):
        alone = jr.Uncertain({"width": 0.1, "restitution": coefficients[k]}, **options)
        single = alone.draw(jr.Block(half_width[k], 4.0), restitution[k])
        np.testing.assert_array_equal(draws.normal, single.normal)
        np.testing.assert_allclose(draws.restitution[k], single.restitution, rtol=1e-12)
        for name in NUMBERS:
            values = getattr(draws.block, name)[k]
            np.testing.assert_allclose(values, getattr(single.block, name), rtol=1e-12)


@DOUBLE
def test_samples_have_the_mean_and_the_deviation_asked_for():
    for restitution, variation in ((0.05, 1e-3), (0.05, 0.1), (0.8, 0.02), (0.9, 0.1)):
        coefficients = {"width": variation, "restitution": variation}
        draws = jr.Uncertain(coefficients, samples=2**14).draw(BLOCK, restitution)
        assert draws.restitution.mean() == pytest.approx(restitution, rel=0.002 * variation)
        assert draws.restitution.std() == pytest.approx(restitution * variation, rel=0.01)
        total = (1 - restitution) / (restitution * variation**2) - 1
        beta = stats.beta(restitution * total, (1 - restitution) * total)
        uniform = stats.norm.cdf(draws.normal[:, 1])
        np.testing.assert_allclose(beta.cdf(draws.restitution), uniform, atol=1e-9)
        width = 2 * draws.block.half_width
        assert np.median(width) == pytest.approx(0.5, rel=0.01 * variation)
        assert width.std() / width.mean() == pytest.approx(variation, rel=0.01)


@DOUBLE
def test_samples_have_the_correlations():
    """Of the normal numbers; the distributions of single parameters stay as they are."""
    n = 4096
    coefficients = {ANGLE: 0.1, "gravity": 0.01, "restitution": 0.08, FREQUENCY: 0.05}
    names = list(coefficients)
    correlations = {
        ("restitution", ANGLE): 0.4,
        (ANGLE, FREQUENCY): -0.7,
        ("restitution", FREQUENCY): 0.2,
    }
    uncertain = jr.Uncertain(coefficients, correlations=correlations, samples=n)
    block, restitution, normal, _ = uncertain.draw(BLOCK, 0.8)
    expected = np.eye(4)
    for pair, value in correlations.items():
        row, column = map(names.index, pair)
        expected[row, column] = expected[column, row] = value
    # Four standard deviations of the correlation of independent samples.
    bound = 4 * (1 - expected**2) / np.sqrt(n)
    assert (abs(np.corrcoef(normal.T) - expected) <= bound + 1e-12).all()
    angles = np.log(np.asarray(block.critical_angle) / float(BLOCK.critical_angle))
    np.testing.assert_allclose(angles, compute_log_deviation(0.1) * normal[:, 0], atol=1e-9)
    assert stats.spearmanr(restitution, normal[:, 2]).statistic == pytest.approx(1)
    for column in normal.T:
        # Kolmogorov's bound, which one sample in a thousand exceeds.
        assert stats.kstest(column, "norm").statistic < 1.95 / np.sqrt(n)
    alone = jr.Uncertain(coefficients, samples=n)
    # The first name, and one that is correlated with none before it, keep their points.
    points = alone.draw(BLOCK, 0.8).normal
    np.testing.assert_array_equal(normal[:, :2], points[:, :2])
    np.testing.assert_array_equal(points, draw_normal_numbers(4, n, 0))
    zero = {("restitution", ANGLE): 0.0}
    assert jr.Uncertain(coefficients, correlations=zero, samples=n) == alone
