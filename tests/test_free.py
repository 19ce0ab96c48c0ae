"""Laws that free rocking has to obey, in both models, and between pulses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from references import stepping
from references.trains import follow_train
from tools.selection import first_by_default

import jaxrock as jr

MODELS = [jr.Linearized(), jr.Nonlinear()]
models = st.sampled_from(MODELS)
slenderness = st.floats(0.25, 100, width=32)
half_width = st.floats(0.0078125, 100, width=32)
ratio = st.floats(0.0009765625, 0.9990234375, width=32)


def energy(model, block, rotation, velocity):
    """Per unit of moment of inertia: kinetic, and potential as the model has it."""
    p = block.frequency_parameter
    critical = block.critical_angle
    if isinstance(model, jr.Linearized):
        return velocity**2 / 2 + p**2 * rotation * (critical - rotation / 2)
    # cos(critical - rotation) - cos(critical), without its cancellation
    lift = 2 * jnp.sin(rotation / 2) * jnp.sin(critical - rotation / 2)
    return velocity**2 / 2 + p**2 * lift


@given(models, half_width, slenderness, ratio, st.floats(0, 1, width=32))
def test_energy_is_conserved_along_the_motion(model, b, lam, x, share):
    eps = float(jnp.finfo(jnp.result_type(float)).eps)
    block = jr.Block(b, lam)
    velocity = x * model.critical_velocity(block)
    time = share * model.half_cycle_duration(block, velocity)
    found = energy(model, block, *model.motion(block, velocity, time))
    np.testing.assert_allclose(found, velocity**2 / 2, rtol=1000 * eps / (1 - x))


@given(models, half_width, slenderness, ratio)
def test_motion_peaks_at_half_time_and_returns(model, b, lam, x):
    eps = float(jnp.finfo(jnp.result_type(float)).eps)
    tolerance = 500 * eps / (1 - x)
    block = jr.Block(b, lam)
    velocity = x * model.critical_velocity(block)
    peak = model.peak_rotation(block, velocity)
    duration = model.half_cycle_duration(block, velocity)
    rotation, speed = model.motion(block, velocity, duration / 2)
    np.testing.assert_allclose(rotation, peak, rtol=tolerance)
    assert abs(speed) < tolerance * velocity
    rotation, speed = model.motion(block, velocity, duration)
    assert abs(rotation) < tolerance * peak
    np.testing.assert_allclose(speed, -velocity, rtol=tolerance)


@given(models, half_width, slenderness, ratio, st.floats(1.0009765625, 2, width=32))
def test_peak_grows_with_velocity_and_shrinks_with_size(model, b, lam, x, factor):
    block = jr.Block(b, lam)
    velocity = x * model.critical_velocity(block) / factor
    peak = model.peak_rotation(block, velocity)
    assert model.peak_rotation(block, velocity * factor) > peak
    pulse = velocity / block.pulse_velocity(1.0)
    larger = jr.Block(b * factor, lam)
    assert model.peak_rotation(larger, larger.pulse_velocity(pulse)) < peak


@pytest.mark.float64
@pytest.mark.parametrize("question", ["peak_rotation", "half_cycle_duration"])
@pytest.mark.parametrize("x", [1e-3, 0.5, 0.9])
def test_nonlinear_tends_to_linearized_as_slenderness_squared(question, x):
    lam = jnp.asarray([10.0, 100.0, 1000.0])
    block = jr.Block(0.4, lam)
    velocity = x * jr.Nonlinear().critical_velocity(block)
    linearized, nonlinear = (getattr(model, question)(block, velocity) for model in MODELS)
    difference = np.asarray(abs(linearized / nonlinear - 1))
    rate = np.log10(difference[:-1] / difference[1:])
    np.testing.assert_allclose(rate, 2, atol=0.02)


@pytest.mark.float64
@pytest.mark.parametrize("model", first_by_default(reversed(MODELS)), ids=repr)
def test_the_history_of_a_train_is_scipys(model):
    """Outward and inward, on the way up and down, through impacts, until it has overturned."""
    block = jr.Block(0.4, 3.0)
    c = 0.8
    rocker = stepping.Rocker(0.4, 3.0, c, linearized=model == jr.Linearized())
    times = np.array([0.2, 0.35, 0.9, 1.9, 2.0])
    intensities = np.array([0.5, 0.3, 0.4, -0.3, -1.4])
    train = jr.respond_to_train(block, c, times, intensities, model)
    assert bool(train.overturned)
    samples = np.append(np.linspace(0, 2.8, 42), times)
    ours = np.array(train.history(samples))
    order = np.argsort(samples, kind="stable")
    theirs = np.array(follow_train(rocker, times, intensities, samples)[:2])
    assert 1.2 < abs(theirs[0]).max() / rocker.angle < 2
    assert theirs[0].max() > 0
    np.testing.assert_allclose(ours[:, order], theirs, rtol=1e-6, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("model", first_by_default(MODELS), ids=repr)
def test_derivatives_of_a_train_and_its_history(model):
    def respond(intensity):
        pulses = jnp.stack([jnp.asarray(0.3), intensity])
        return jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.0, 0.25], pulses, model)

    def rotation(intensity, time):
        return respond(intensity).history(time)

    times = jnp.asarray([0.1, 0.3, 0.6, 0.8])
    slope, rate = jax.jacfwd(lambda i, t: rotation(i, t)[0], (0, 1))(0.2, times)
    np.testing.assert_allclose(np.diagonal(rate), rotation(0.2, times)[1], rtol=1e-9)
    step = 1e-6
    numeric = (rotation(0.2 + step, times)[0] - rotation(0.2 - step, times)[0]) / (2 * step)
    np.testing.assert_allclose(slope, numeric, rtol=1e-5, atol=1e-9)
    assert slope[0] == 0
    assert (np.asarray(slope[1:]) != 0).all()
