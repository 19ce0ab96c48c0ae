"""Derivatives and elasticities of rates, and rates of many objects and of uncertain ones."""

import jax
import mpmath
import numpy as np
import pytest
from references.half_sine_rates import OFTEN, POWER, closed_rate, hazard, pulses

import jaxrock as jr

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough
CURVE = ([0.2, 0.6, 1.5, 4.0], [1e-2, 1e-3, 1e-4, 1e-5])
PARAMETERS = {
    "half_width": 0.1,
    "slenderness": 4.0,
    "gravity": 9.81,
    "inertia_ratio": 2.0,
    "restitution": 0.7,
}


def sine_site(**options):
    """A second of a sine, sampled coarsely: three boundaries."""
    sine = jr.Record(3 * np.sin(2 * np.pi * 0.02 * np.arange(51)), 0.02)
    return jr.risk.Site(jr.Suite([sine]), jr.risk.Hazard(*CURVE), **options)


@DOUBLE
def test_elasticities_under_a_sine():
    """Against the rates at both ends, by located boundaries."""
    site = sine_site()
    *block, restitution = PARAMETERS.values()
    answer = jr.risk.rate_elasticities(jr.Block(*block), restitution, site, change=0.02)
    assert answer.names == tuple(PARAMETERS)
    ends = np.array([*PARAMETERS.values()])[:, None, None] * np.ones((5, 2))
    for k in range(5):
        ends[k, k] *= 1 + 0.02 * np.array([-1, 1])
    *blocks, restitutions = ends.reshape(5, -1)
    rates = jr.risk.overturning_rate(jr.Block(*blocks), restitutions, site).rate
    low, high = np.reshape(rates, (5, 2)).T
    exact = (high - low) / 0.04 / float(answer.rate.rate)
    np.testing.assert_allclose(answer.elasticity, exact, atol=1e-3)
    assert float(answer.elasticity[0]) == pytest.approx(-0.289, abs=1e-3)
    assert "over +-2%" in str(answer)


SHAPE = (0.25, 4.0, 4 / 3)  # half-width, slenderness, inertia ratio
LEVELS = np.geomspace(0.9, 6.0, 40)


@DOUBLE
@SLOW
def test_derivatives_against_differences():
    """With respect to the block, the restitution and the rates of the hazard, in both modes."""
    at = (*PARAMETERS.values(), np.array(CURVE[1]))
    suite = sine_site().suite
    levels = np.geomspace(0.2, 4.0, 60).clip(0.2, 4.0)

    def rate(*at):
        site = jr.risk.Site(suite, jr.risk.Hazard(CURVE[0], at[5]), levels=levels)
        return jr.risk.overturning_rate(jr.Block(*at[:4]), at[4], site).rate

    value, reverse = jax.value_and_grad(rate, range(6))(*at)
    derivatives = np.concatenate([np.array(reverse[:5], float), np.asarray(reverse[5])])
    numbers = np.concatenate([np.array(at[:5]), at[5]])
    differences = []
    for k, number in enumerate(numbers):
        step = 1e-4 * number * np.eye(9)[k]
        ends = (numbers + step, numbers - step)
        high, low = (float(rate(*end[:5], end[5:])) for end in ends)
        differences.append((high - low) / (2e-4 * number))
    scale = float(value) / numbers
    np.testing.assert_allclose(derivatives / scale, differences / scale, atol=1e-4)
    # The rate is proportional to the rates of the hazard.
    assert np.dot(derivatives[5:], at[5]) == pytest.approx(float(value), rel=1e-12)
    directions = np.eye(9)[:, :5], np.eye(9)[:, 5:]
    forward = [
        float(jax.jvp(rate, at, (*map(float, of_five), of_hazard))[1])
        for of_five, of_hazard in zip(*directions, strict=True)
    ]
    np.testing.assert_allclose(forward / scale, derivatives / scale, rtol=1e-9, atol=1e-12)
    compiled = jax.jit(rate)(*at)
    assert float(compiled) == pytest.approx(float(value), rel=1e-9)


@DOUBLE
@SLOW
def test_derivatives_in_closed_form():
    numbers = (*SHAPE, OFTEN, POWER, 0.85)
    suite = pulses(400)

    def rate(*at):
        ends = np.array([0.5, 8.0])
        site = jr.risk.Site(suite, jr.risk.Hazard(ends, at[3] * ends ** -at[4]), levels=LEVELS)
        block = jr.Block(at[0], at[1], inertia_ratio=at[2])
        return jr.risk.overturning_rate(block, at[5], site, model="linearized").rate

    def exact(*at):
        return closed_rate("pgv", *at[:3], often=at[3], power=at[4])

    value, reverse = jax.value_and_grad(rate, range(6))(*numbers)
    assert float(value) == pytest.approx(float(exact(*numbers[:5])), rel=1e-6)
    expected = [
        float(mpmath.diff(exact, numbers[:5], tuple(int(k == of) for k in range(5))))
        for of in range(5)
    ]
    np.testing.assert_allclose(reverse[:5], expected, rtol=1e-6)
    assert abs(float(reverse[5])) < 1e-12 * float(value)  # no impact comes before
    forward = jax.jvp(rate, numbers, (*SHAPE, 0.0, 0.0, 0.0))[1]
    assert float(forward) == pytest.approx(np.dot(expected[:3], SHAPE), rel=1e-6)


def two_sines():
    """No two boundaries lie between neighbouring levels, of which either could be located."""
    along = np.sin(2 * np.pi * np.linspace(0, 1, 51))
    suite = jr.Suite([jr.Record(3 * along, duration / 50) for duration in (0.8, 1.0)])
    return jr.risk.Site(suite, jr.risk.Hazard(*CURVE))


@DOUBLE
def test_the_rate_of_samples_is_the_mean_of_theirs():
    site = two_sines()
    block = jr.Block(np.array([0.1, 0.12]), 4.0)
    uncertain = jr.Uncertain({"restitution": 0.05, "half_width": 0.1}, samples=4, seed=3)
    answer = jr.risk.overturning_rate(block, 0.7, site, uncertain)
    draws = uncertain.draw(block, 0.7)
    flat = jax.tree.map(np.ravel, draws.block)
    exact = jr.risk.overturning_rate(flat, draws.restitution.ravel(), site)
    by_sample = np.reshape(exact.rate, (2, 4))
    # Each boundary is located to 1e-4, on either side.
    np.testing.assert_allclose(answer.sample_rates, by_sample, rtol=1e-4)
    np.testing.assert_allclose(answer.rate, by_sample.mean(axis=1), rtol=1e-4)
    contributions = np.reshape(exact.contributions, (2, 2, 4)).mean(axis=-1)
    np.testing.assert_allclose(answer.contributions, contributions, rtol=1e-4)
    error = np.asarray(answer.contributions).std(axis=0, ddof=1) / np.sqrt(2)
    np.testing.assert_allclose(answer.standard_error, error, rtol=1e-12)
    assert answer.boundaries is None


@DOUBLE
@SLOW
def test_the_rate_of_an_uncertain_block_in_closed_form():
    """The mean over a lognormal half-width, by Gauss and Hermite's rule."""
    site = jr.risk.Site(pulses(100), hazard, levels=np.geomspace(0.5, 12.0, 100))
    uncertain = jr.Uncertain({"half_width": 0.2}, samples=256)
    answer = jr.risk.overturning_rate(
        jr.Block(*SHAPE[:2]), 0.85, site, uncertain, model="linearized"
    )
    places, weights = np.polynomial.hermite_e.hermegauss(12)
    sigma = np.sqrt(np.log1p(0.2**2))
    rates = [
        float(closed_rate("pgv", SHAPE[0] * np.exp(sigma * z), *SHAPE[1:])) for z in places
    ]
    exact = np.dot(weights, rates) / weights.sum()
    assert float(answer.rate) == pytest.approx(exact, rel=2e-3)
    deviation = np.sqrt(np.dot(weights, (rates - exact) ** 2) / weights.sum())
    assert float(answer.sample_rates.std()) == pytest.approx(deviation, rel=0.02)
    assert "256 samples of uncertain parameters" in str(answer)
