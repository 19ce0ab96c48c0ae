import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxrock as jr

MODELS = [jr.Linearized(), jr.Nonlinear()]


def scene(restitution=0.7, intensity=0.15, half_width=0.4, slenderness=5.0):
    return jr.Scene(jr.Block(half_width, slenderness), restitution, intensity)


@given(st.floats(0, 1, width=32), st.integers(1, 40))
def test_half_cycle_velocity_is_the_map_iterated(restitution, number):
    eps = float(jnp.finfo(jnp.result_type(float)).eps)
    one = scene(restitution)
    velocity = jr.launch_velocity(one)
    for _ in range(number - 1):
        velocity = jr.resonance.next_velocity(one, velocity)
    found = jr.half_cycle_velocity(one, number)
    np.testing.assert_allclose(found, velocity, rtol=2 * (number + 2) * eps)


@pytest.mark.float64
@given(st.floats(0.0625, 0.9375, width=32), st.integers(1, 8))
def test_half_cycles_tend_to_the_limit_as_powers_of_restitution(restitution, number):
    one = scene(restitution)
    limit = jr.stabilized_velocity(one)
    short = 1 - jr.half_cycle_velocity(one, number) / limit
    np.testing.assert_allclose(short, restitution**number, rtol=1e-6)


@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_stabilized_quantities_follow_from_the_limit(model, eps):
    one = scene()
    limit = jr.stabilized_velocity(one)
    peak = model.peak_rotation(one.block, limit)
    first = model.peak_rotation(one.block, jr.launch_velocity(one))
    expected = {
        jr.stabilized_rotation: peak,
        jr.rotation_ratio: peak / one.block.critical_angle,
        jr.amplification: peak / first,
        jr.stabilized_period: 2 * model.half_cycle_duration(one.block, limit),
        jr.overturning_margin: 1 - (limit / model.critical_velocity(one.block)) ** 2,
    }
    for function, value in expected.items():
        np.testing.assert_allclose(function(one, model), value, rtol=50 * eps)


@pytest.mark.parametrize("model", MODELS, ids=repr)
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9, 0.99, 1.0])
def test_overturning_half_cycle_is_the_first_to_reach_the_critical_velocity(
    model, restitution
):
    intensity = np.geomspace(1e-3, 3, 60)
    scenes = scene(restitution, intensity)
    found = np.asarray(jr.overturning_half_cycle(scenes, model))
    critical = float(model.critical_velocity(scenes.block))
    assert found.min() == 1
    for value, first in zip(found, np.asarray(jr.launch_velocity(scenes)), strict=True):
        velocity = first
        number = 1
        while velocity < critical and number < 20000:
            velocity = restitution * velocity + first
            number = number + 1
        assert value == (number if velocity >= critical else np.inf)


def answers_without_limit(shared):
    """Everything that is infinite or NaN without loss."""
    loss = jnp.asarray([0.5, 0.0, 0.5, 0.0])
    one = jr.Scene(jr.Block(shared, 5.0), 1 - loss, jnp.asarray([0.1, 0.1, 0.0, 0.0]))
    yield from (f(one) for f in (jr.rotation_ratio, jr.stabilized_period, jr.amplification))
    yield jr.overturning_margin(one)
    yield jr.stabilized_velocity(one)
    yield jr.half_cycle_velocity(one, jnp.inf)
    yield jr.resonance.equivalent_damping(shared * loss)


def test_elements_without_limit_leave_the_derivatives_of_others_alone():
    def kept(shared):
        answers = [
            jnp.where(jnp.isfinite(v), v, 0).sum() for v in answers_without_limit(shared)
        ]
        return jnp.stack(answers)

    @jax.jit
    @jax.vmap
    def values_and_slopes(shared):
        values, pull = jax.vjp(kept, shared)
        return values, jax.vmap(pull)(jnp.eye(values.size))[0]

    step = 1e-3
    values, slopes = values_and_slopes(0.4 + step * np.array([-1.0, 0.0, 1.0]))
    assert jnp.isfinite(slopes).all()
    difference = (values[2] - values[0]) / (2 * step)
    np.testing.assert_allclose(slopes[1], difference, rtol=0.02, atol=1e-3)


@pytest.mark.float64
@pytest.mark.parametrize(
    ("restitution", "number"), [(0.5, 2000), (0.99, 10**5), (0.9, 3), (1, 7)]
)
def test_second_derivatives_of_many_half_cycles(restitution, number):
    def share(c):
        return jr.critical_intensity(jr.Block(0.4, 5.0), c, number)

    second = jax.grad(jax.grad(share))(float(restitution))
    unit = share(0.0)
    if number < 10:
        exact = mp.diff(lambda c: 1 / sum(c**j for j in range(number)), mp.mpf(restitution), 2)
    else:
        exact = mp.diff(lambda c: (1 - c) / (1 - c**number), mp.mpf(restitution), 2)
    np.testing.assert_allclose(second / unit, float(exact), rtol=1e-9, atol=1e-12)
