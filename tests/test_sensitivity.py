"""Slopes against differences, scatter against samples, global measures against known indices."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrock as jr

pytestmark = pytest.mark.float64
WALL = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)


def test_sensitivities():
    found = jr.sensitivities(jr.rotation_ratio, WALL)
    assert found.names == ("half_width", "slenderness", "gravity", "restitution", "intensity")
    at = dict(zip(found.names, found.at, strict=True))

    def value(**change):
        n = at | change
        block = jr.Block(n["half_width"], n["slenderness"], n["gravity"])
        return float(jr.rotation_ratio(jr.Scene(block, n["restitution"], n["intensity"])))

    for k, (name, x) in enumerate(at.items()):
        h = 1e-4 * x
        low, middle, high = value(**{name: x - h}), value(), value(**{name: x + h})
        assert found.gradient[k] == pytest.approx((high - low) / (2 * h), rel=1e-5)
        assert found.elasticity[k] == pytest.approx(found.gradient[k] * x / middle, rel=1e-12)
        curvature = (high - 2 * middle + low) / h**2
        assert found.hessian[k, k] == pytest.approx(curvature, rel=1e-3)
    assert "restitution" in str(found)


@pytest.mark.thorough
def test_sensitivities_of_a_driven_answer():
    def peak(at):
        pulse = jr.HalfSine(at["amplitude"], 0.3)
        return jr.respond(jr.Block(0.2, 5.0), at["restitution"], pulse, 3.0).peak_rotation

    found = jr.sensitivities(peak, {"amplitude": 4.0, "restitution": 0.9})
    h = 1e-4
    for k, name in enumerate(found.names):
        at = dict(zip(found.names, found.at, strict=True))
        difference = peak(at | {name: at[name] + h}) - peak(at | {name: at[name] - h})
        assert found.gradient[k] == pytest.approx(float(difference) / (2 * h), rel=1e-5, abs=1e-9)


def test_tornado():
    ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8), "gravity": (9.81, 9.81)}
    found = jr.tornado(jr.rotation_ratio, WALL, ranges)
    assert found.names == ("restitution", "slenderness", "gravity")
    slender = [float(jr.rotation_ratio(jr.Scene(jr.Block(0.4, s), 0.7, 0.15))) for s in (4.0, 6.0)]
    np.testing.assert_allclose([found.at_low[1], found.at_high[1]], slender, rtol=1e-12)
    assert found.value == found.at_low[2] == found.at_high[2]


def test_scatter():
    variation = {"half_width": 0.03, "restitution": 0.01, "intensity": 0.04}
    found = jr.propagate(jr.rotation_ratio, WALL, variation)
    samples = jr.monte_carlo(jr.rotation_ratio, WALL, variation, 200_000)
    assert found.mean == pytest.approx(samples.mean(), rel=1e-3)
    assert found.deviation == pytest.approx(samples.std(), rel=1e-2)
    assert found.holds
    # Near the verge the samples that overturn have no answer, which no derivative sees.
    near = jr.Scene(WALL.block, 0.7, 0.28)
    scatter = {"restitution": 0.05, "intensity": 0.1}
    assert np.isnan(jr.monte_carlo(jr.rotation_ratio, near, scatter, 2000)).mean() > 0.2
    assert not jr.propagate(jr.rotation_ratio, near, scatter).holds
    # Second order is nearer than first.
    assert abs(found.mean - samples.mean()) < 0.2 * abs(found.mean_first - samples.mean())
    assert abs(found.deviation - samples.std()) < abs(found.deviation_first - samples.std())
    assert sum(found.shares.values()) == pytest.approx(1)


def scenes():
    rng = np.random.default_rng(0)
    for k in range(10):
        block = jr.Block(rng.uniform(0.1, 0.8), rng.uniform(2.5, 9))
        c = rng.uniform(0.4, 0.93)
        model = (jr.Linearized(), jr.Nonlinear())[k % 2]
        critical = float(jr.critical_intensity(block, c, jnp.inf, model))
        yield jr.Scene(block, c, critical * rng.uniform(0.7, 1.2)), model, rng.uniform(0.02, 0.1)


@pytest.mark.thorough
def test_probability_of_overturning():
    """Ten scenes, coefficients of variation of up to 10 %, against 100,000 samples."""
    seen = []
    for scene, model, variation in scenes():

        def margin(scene, model=model):
            return jr.overturning_margin(scene, model)

        scatter = dict.fromkeys(("half_width", "slenderness", "intensity"), 0.1)
        scatter["restitution"] = variation
        found = jr.failure_probability(margin, scene, scatter)
        share = (jr.monte_carlo(margin, scene, scatter, 100_000, seed=1) < 0).mean()
        assert found.holds
        assert abs(found.probability - share) < 0.01
        seen.append(found.probability)
    assert min(seen) < 0.1
    assert max(seen) > 0.6


@pytest.mark.thorough
def test_probability_of_a_driven_fate():
    block = jr.Block(0.1, 5.0)

    def margin(at):
        pulse = jr.HalfSine(at["amplitude"], at["duration"])
        return jr.respond_batch(block, 0.9, pulse, pulse.end).margin

    at, scatter = {"amplitude": 5.0, "duration": 0.27}, {"amplitude": 0.1, "duration": 0.1}
    found = jr.failure_probability(margin, at, scatter)
    assert found.holds
    rng = np.random.default_rng(4)
    width = np.sqrt(np.log1p(0.1**2))
    many = {k: v * np.exp(width * rng.standard_normal(100_000)) for k, v in at.items()}
    pulses = jr.HalfSine(many["amplitude"], many["duration"])
    share = float(jr.respond_batch(block, 0.9, pulses, pulses.end).overturned.mean())
    assert 0.05 < share < 0.95
    assert abs(found.probability - share) < 0.01


def test_where_the_method_does_not_hold_it_says_so():
    """A margin with a window of survival narrower than the scatter."""

    def margin(at):
        return (at["x"] - 1.05) * (at["x"] - 1.1) * (at["x"] - 0.95)

    assert not jr.failure_probability(margin, {"x": 1.0}, {"x": 0.1}).holds
    assert not jr.failure_probability(lambda at: 1.0 + 0 * at["x"], {"x": 1.0}, {"x": 0.1}).holds


def test_global_sensitivities():
    """A sum, whose Sobol indices are the shares of the variance."""
    ranges = {"a": (0.0, 1.0), "b": (0.0, 3.0)}
    found = jr.global_sensitivities(
        lambda at: at["a"] + at["b"], {"a": 0.5, "b": 0.5}, ranges, samples=50_000
    )
    np.testing.assert_allclose(found.measure, 1)
    np.testing.assert_allclose(found.bound, 12 / np.pi**2 * np.array([0.1, 0.9]), rtol=0.02)
    assert found.left_out == 0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: jr.propagate(jr.rotation_ratio, WALL, {"height": 0.1}), "none of half_width"),
        (lambda: jr.propagate(jr.rotation_ratio, WALL, {"intensity": -1.0}), "at least 0"),
        (lambda: jr.sensitivities(lambda s: jnp.ones(2), WALL), "answer must be one number"),
        (lambda: jr.sensitivities(jr.rotation_ratio, {"x": np.ones(2)}), "single numbers"),
        (
            lambda: jr.global_sensitivities(jr.rotation_ratio, WALL, {"intensity": (1.0, 0.0)}),
            "from a low value to a higher one",
        ),
        (
            lambda: jr.failure_probability(jr.rotation_ratio, WALL, {"intensity": 0.0}),
            "greater than 0 for at least one",
        ),
    ],
)
def test_bad_input(call, words):
    with pytest.raises(ValueError, match=words):
        call()
