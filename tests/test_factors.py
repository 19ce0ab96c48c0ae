"""Factors on a motion: the one that lifts a block, and those between standing and falling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import record
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.overturning import uplift_factor

pytestmark = pytest.mark.float64
BLOCK = jr.Block(0.3, 3.0)
MODELS = first_by_default(["nonlinear", "linearized"])


def with_vertical(samples=200):
    vertical = 8 * np.random.default_rng(7).standard_normal(samples)
    return jr.Record(record(samples).acceleration, 0.02, vertical)


@pytest.mark.parametrize("model", MODELS)
def test_uplift_sample_by_sample(model):
    """The ground that falls away helps: the largest acceleration need not lift first."""
    motion = with_vertical()
    found = uplift_factor(BLOCK, motion, model=model)
    tangent = 1 / 3 if model == "nonlinear" else np.arctan(1 / 3)
    horizontal = np.asarray(motion.acceleration)
    vertical = np.asarray(motion.vertical)
    # y f > (g + v f) tan; not at all where the ground comes up faster than it pushes.
    needed = abs(horizontal) - vertical * tangent
    expected = 9.81 * tangent / needed.max()
    assert found == pytest.approx(expected, rel=1e-12)
    assert needed.argmax() != abs(horizontal).argmax()
    for factor, lifted in ((0.999, False), (1.001, True)):
        response = jr.respond_batch(BLOCK, 0.5, motion.scaled(factor * expected), model=model)
        assert (response.peak_rotation > 0) == lifted


def test_uplift_of_other_motions_and_blocks():
    blocks = jr.Block(0.3, np.array([3.0, 4.0, 5.0]))
    for motion in (jr.Sine(2.0, 0.5), jr.Harmonic(-2.0, 6.0, 3), jr.Ricker(2.0, 0.5)):
        np.testing.assert_allclose(
            uplift_factor(blocks, motion), 9.81 / blocks.slenderness / 2, rtol=1e-12
        )
    still = jr.Record(np.zeros(20), 0.02)
    assert uplift_factor(BLOCK, still) == np.inf


def test_slopes_of_the_uplift():
    motion = with_vertical()

    def factor(x):
        return uplift_factor(jr.Block(0.3, x[0], 9.81 * x[1]), motion)

    at = np.array([3.0, 1.0])
    for k, step in enumerate(1e-6 * np.eye(2)):
        change = float(factor(at + step) - factor(at - step)) / 2e-6
        assert jax.grad(factor)(jnp.asarray(at))[k] == pytest.approx(change, rel=1e-7)
    values, slopes = jax.vmap(jax.value_and_grad(lambda s: factor((s, 1.0))))(
        jnp.asarray([3.0, -3.0])
    )
    assert jnp.isnan(values).tolist() == [False, True]
    assert slopes[1] == 0


def test_of_a_pulse_it_is_the_amplitude():
    """And the block stands again in the windows between the boundaries."""
    slim = jr.Block(0.1, 5.0)
    pulse = jr.Sine(4.0, 0.5)
    factors = float(uplift_factor(slim, pulse)) * np.geomspace(1, 10, 60)
    found = jr.overturning_boundaries(slim, 0.9, pulse, "factor", factors)
    amplitude = jr.critical_amplitude(slim, 0.9, jr.Sine, 0.5)
    np.testing.assert_allclose(4 * found.value, amplitude.value, rtol=1e-9)
    np.testing.assert_array_equal(found.windows, [found.value[1:]])
    inside = jr.overturning_boundaries(slim, 0.9, pulse, "factor", factors[factors < 2])
    np.testing.assert_allclose(inside.windows, [[found.value[1], np.inf]], rtol=1e-12)
    above = factors[(factors > 0.8) & (factors < 2)]
    above = jr.overturning_boundaries(slim, 0.9, pulse, "factor", above)
    assert above.overturns_first
    np.testing.assert_allclose(above.windows, inside.windows, rtol=1e-12)
    below = jr.overturning_boundaries(slim, 0.9, pulse, "factor", [0.1, 0.2])
    assert below.windows.shape == (0, 2)
