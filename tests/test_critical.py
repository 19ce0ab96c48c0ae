import jax.numpy as jnp
import numpy as np
import pytest

import jaxrock as jr

RUNGS = [jr.Linearized(), jr.Nonlinear()]


@pytest.mark.float64
@pytest.mark.parametrize("model", RUNGS, ids=repr)
@pytest.mark.parametrize("half_cycles", [1, 2, 5, 30, np.inf])
def test_a_hair_below_stands_and_a_hair_above_overturns(model, half_cycles):
    rng = np.random.default_rng(3)
    number = 1000
    block = jr.Block(10 ** rng.uniform(-2, 1, number), 10 ** rng.uniform(-0.5, 2, number))
    restitution = rng.uniform(0, 0.95, number)
    critical = jr.critical_intensity(block, restitution, half_cycles, model)
    below = jr.Scene(block, restitution, critical * (1 - 1e-9))
    above = jr.Scene(block, restitution, critical * (1 + 1e-9))
    assert (jr.overturning_half_cycle(below, model) > half_cycles).all() or half_cycles == np.inf
    assert (jr.overturning_half_cycle(above, model) <= half_cycles).all()
    if half_cycles == np.inf:
        assert (jr.overturning_margin(below, model) > 0).all()
        assert (jr.overturning_margin(above, model) < 0).all()


def test_more_half_cycles_need_weaker_pulses_down_to_the_limit():
    block = jr.Block(0.4, 5.0)
    number = jnp.asarray([1.0, 2.0, 5.0, 10.0, 100.0, jnp.inf])
    intensity = jr.critical_intensity(block, 0.7, number)
    assert (jnp.diff(intensity) <= 0).all()
    assert intensity[0] > 3 * intensity[-1]
    np.testing.assert_allclose(intensity[-1], 0.3 * intensity[0], rtol=1e-6)


def test_without_loss_any_pulse_overturns_in_the_end():
    block = jr.Block(0.4, 5.0)
    assert jr.critical_intensity(block, 1.0) == 0
    single, hundred = jr.critical_intensity(block, 1.0, jnp.asarray([1.0, 100.0]))
    np.testing.assert_allclose(single, 100 * hundred, rtol=1e-6)
