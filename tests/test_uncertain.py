"""Critical angle and frequency parameter as uncertain parameters, and correlated ones."""

import pickle

import numpy as np
import pytest
from references.half_sine_rates import closed_rate, hazard, pulses
from scipy import stats

import jaxrock as jr
from jaxrock.sensitivity import draw_normal_numbers

DOUBLE = pytest.mark.float64
BLOCK = jr.Block(0.25, 4.0)
ANGLE = "critical_angle"
FREQUENCY = "frequency_parameter"


def log_width(coefficient):
    """The standard deviation of the logarithm of a lognormal parameter."""
    return np.sqrt(np.log1p(np.square(coefficient)))


@DOUBLE
@pytest.mark.parametrize("restitution", [0.8, np.array([0.7, 0.8, 0.9])])
def test_blocks_drawn_by_critical_angle_and_frequency_parameter(restitution):
    """Those of lognormal samples by SciPy, of one block and of many."""
    half_width = np.full(np.shape(restitution), 0.25)
    block = jr.Block(half_width, 4.0, inertia_ratio=1.25)
    coefficients = {FREQUENCY: 0.05, ANGLE: 0.2, "gravity": 0.01}
    draws = jr.Uncertain(coefficients, samples=64, seed=2).draw(block, restitution)
    uniform = stats.norm.cdf(draw_normal_numbers(3, 64, 2))
    medians = (block.frequency_parameter, block.critical_angle, block.gravity)
    samples = [
        stats.lognorm(log_width(c), scale=np.asarray(median)[..., None]).ppf(column)
        for median, c, column in zip(medians, coefficients.values(), uniform.T, strict=True)
    ]
    samples = np.broadcast_arrays(*samples)
    expected = jr.Block.from_parameters(*samples, inertia_ratio=1.25)
    for name in ("half_width", "slenderness"):
        drawn = getattr(draws.block, name)
        assert drawn.dtype == np.float64
        np.testing.assert_allclose(drawn, getattr(expected, name), rtol=1e-12)
    np.testing.assert_allclose(draws.block.gravity, expected.gravity, rtol=1e-12)
    assert (draws.block.inertia_ratio == 1.25).all()


@DOUBLE
def test_an_angle_alone_leaves_the_frequency_parameter():
    draws = jr.Uncertain({ANGLE: 0.3}).draw(BLOCK, 0.8)
    assert np.ptp(draws.block.slenderness) > 1
    frequencies = jr.Block(draws.block.half_width, draws.block.slenderness).frequency_parameter
    np.testing.assert_allclose(frequencies, BLOCK.frequency_parameter, rtol=1e-12)


@DOUBLE
@pytest.mark.parametrize("restitution", [0.05, 0.5, 0.8, 0.9])
@pytest.mark.parametrize("variation", [1e-3, 0.02, 0.1])
def test_samples_have_the_mean_and_the_deviation_asked_for(restitution, variation):
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
    for (first, second), value in correlations.items():
        row = names.index(first)
        column = names.index(second)
        expected[row, column] = value
        expected[column, row] = value
    # Four standard deviations of the correlation of independent samples.
    bound = 4 * (1 - expected**2) / np.sqrt(n)
    assert (abs(np.corrcoef(normal.T) - expected) <= bound + 1e-12).all()
    angles = np.log(np.asarray(block.critical_angle) / float(BLOCK.critical_angle))
    np.testing.assert_allclose(angles, log_width(0.1) * normal[:, 0], atol=1e-9)
    assert stats.spearmanr(restitution, normal[:, 2]).statistic == pytest.approx(1)
    alone = jr.Uncertain(coefficients, samples=n).draw(BLOCK, 0.8)
    # The first name, and one that is correlated with none before it, keep their points.
    np.testing.assert_array_equal(normal[:, :2], alone.normal[:, :2])
    for name, column in zip(names, normal.T, strict=True):
        # Kolmogorov's bound, which one sample in a thousand exceeds.
        assert stats.kstest(column, "norm").statistic < 1.95 / np.sqrt(n), name


@DOUBLE
def test_without_correlations_the_points_are_those_of_independent_parameters():
    coefficients = {"width": 0.1, "restitution": 0.05, "inertia_ratio": 0.02}
    alone = jr.Uncertain(coefficients, seed=3)
    uncorrelated = jr.Uncertain(
        coefficients, correlations={("restitution", "width"): 0.0}, seed=3
    )
    assert uncorrelated == alone == jr.Uncertain(coefficients, correlations={}, seed=3)
    draws = alone.draw(BLOCK, 0.8)
    points = draw_normal_numbers(3, 64, 3)
    np.testing.assert_array_equal(draws.normal, points)
    half_width = 0.5 * np.exp(log_width(0.1) * points[:, 0]) / 2
    np.testing.assert_allclose(draws.block.half_width, half_width, rtol=1e-15)


def test_correlations_are_a_value():
    """Immutable, the same in either order, and what they print."""
    coefficients = {"width": 0.02, "restitution": 0.05, "gravity": 0.01}
    correlations = {
        ("gravity", "width"): -0.25,
        (np.str_("restitution"), "width"): np.array(0.4),
    }
    uncertain = jr.Uncertain(coefficients, correlations=correlations)
    again = jr.Uncertain(
        coefficients,
        correlations={("width", "restitution"): 0.4, ("width", "gravity"): -0.25},
    )
    assert uncertain == again != jr.Uncertain(coefficients)
    assert pickle.loads(pickle.dumps(uncertain)) == uncertain
    assert {uncertain: 1}[again] == 1
    assert uncertain.correlations == {
        ("width", "restitution"): 0.4,
        ("width", "gravity"): -0.25,
    }
    assert jr.Uncertain(coefficients, correlations=uncertain.correlations) == uncertain
    assert str(uncertain) == (
        "coefficients of variation: width 0.02, restitution 0.05, gravity 0.01; correlations:"
        " width and restitution 0.4, width and gravity -0.25; 64 samples, seed 0"
    )


@pytest.mark.parametrize("sign", [-1, 1])
def test_perfect_correlation(sign):
    """A singular matrix is allowed: both parameters are decided by one number."""
    uncertain = jr.Uncertain(
        {"restitution": 0.05, "width": 0.1, "height": 0.2},
        correlations={
            ("restitution", "width"): sign,
            ("restitution", "height"): 0.5,
            ("height", "width"): 0.5 * sign,
        },
    )
    normal = uncertain.draw(BLOCK, 0.8).normal
    np.testing.assert_array_equal(normal[:, 1], sign * normal[:, 0])
    assert np.corrcoef(normal[:, 0], normal[:, 2])[0, 1] == pytest.approx(0.5, abs=0.05)


@DOUBLE
def test_the_rate_of_perfectly_correlated_parameters():
    """The mean of the closed form over blocks that become wider and more slender together."""
    coefficients = {"half_width": 0.1, "slenderness": 0.05}
    uncertain = jr.Uncertain(
        coefficients, correlations={("half_width", "slenderness"): 1.0}, samples=8
    )
    site = jr.risk.Site(pulses(400), hazard, levels=np.geomspace(0.9, 6.0, 12))
    answer = jr.risk.overturning_rate(BLOCK, 0.85, site, uncertain, model="linearized")
    z = draw_normal_numbers(2, 8, 0)[:, 0]
    half_widths = 0.25 * np.exp(log_width(0.1) * z)
    slendernesses = 4.0 * np.exp(log_width(0.05) * z)
    exact = [
        float(closed_rate("pgv", *size, 4 / 3))
        for size in zip(half_widths, slendernesses, strict=True)
    ]
    np.testing.assert_allclose(answer.sample_rates, exact, rtol=5e-4)
    assert float(answer.rate) == pytest.approx(np.mean(exact), rel=1e-4)


@DOUBLE
def test_a_tornado_moves_an_angle_at_this_frequency_parameter():
    scene = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    bars = jr.tornado(jr.rotation_ratio, scene, {ANGLE: (0.15, 0.25)})
    frequency = scene.block.frequency_parameter
    for at_end, angle in ((bars.at_low, 0.15), (bars.at_high, 0.25)):
        block = jr.Block.from_parameters(frequency, angle)
        ratio = jr.rotation_ratio(jr.Scene(block, 0.7, 0.15))
        np.testing.assert_allclose(at_end, float(ratio), rtol=1e-12)


def test_a_dataset_lists_correlations():
    uncertain = jr.Uncertain(
        {ANGLE: 0.1, "restitution": 0.05},
        correlations={("restitution", ANGLE): 0.4},
        samples=2,
    )
    curves = jr.risk.fragility(
        BLOCK, 0.85, pulses(50)[:1], [1.0, 2.0], uncertain=uncertain, model="linearized"
    )
    assert curves.attrs["uncertain"] == str(uncertain)
