"""Laws that free rocking has to obey, in both models, and between pulses."""

import math

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from references import stepping
from scipy.integrate import solve_ivp
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


@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_the_overturning_threshold(model):
    block = jr.Block(0.4, 5.0)
    velocity = jnp.asarray([0.999, 1.001]) * model.critical_velocity(block)
    peak = model.peak_rotation(block, velocity)
    assert 0.9 * block.critical_angle < peak[0] < block.critical_angle
    assert jnp.isnan(peak[1])
    assert jnp.isnan(model.half_cycle_duration(block, velocity)).tolist() == [False, True]
    time = 1.2 * model.half_cycle_duration(block, velocity)[0]
    later, _ = model.motion(block, velocity, time)
    assert later[0] < 0 < block.critical_angle < later[1]  # fell back, was carried over


@pytest.mark.parametrize("model", MODELS, ids=repr)
@pytest.mark.parametrize("part", [0.01, 0.7])
def test_the_time_since_a_weak_launch_keeps_its_digits(model, part):
    """Against 30 digits: x is a millionth, and the time a small part of the half-cycle."""
    block = jr.Block(0.4, 5.0)
    p = mpmath.mpf(float(block.frequency_parameter))
    critical = mpmath.mpf(float(block.critical_angle))
    x = mpmath.mpf(1e-6)
    with mpmath.workdps(30):
        time = part * x / p
        if isinstance(model, jr.Linearized):
            rotation = critical * (1 - mpmath.cosh(p * time) + x * mpmath.sinh(p * time))
            q = x * mpmath.cosh(p * time) - mpmath.sinh(p * time)
        else:
            # As y = sin((alpha_c - alpha) / 2)^2 has it, with m for the energy.
            scale = 2 * p * mpmath.sin(critical / 2)
            peak = part * x**2 * critical / 2
            rotation = peak * (1 - part / 4)

            def rate(angle):
                lift = 2 * mpmath.sin(angle / 2) * mpmath.sin(critical - angle / 2)
                return mpmath.sqrt((scale * x) ** 2 - 2 * p**2 * lift)

            q = rate(rotation) / scale
            time = mpmath.quad(lambda angle: 1 / rate(angle), [0, rotation])
    arguments = (float(rotation), float(x), float(q))
    answer = model._time_from_ground(block, *map(jnp.asarray, arguments))
    np.testing.assert_allclose(answer, float(time), rtol=128 * jnp.finfo(answer.dtype).eps)


def test_the_linearized_motion_says_when_it_leaves_the_numbers():
    """It grows without bound; the nonlinear one does not."""
    block = jr.Block(0.4, 5.0)
    time = jnp.asarray([0.1, 1e4])

    def total(velocity):
        return jnp.nansum(jr.Linearized().motion(block, velocity, time)[0])

    assert jnp.isnan(jr.Linearized().motion(block, 0.1, time)[0]).tolist() == [False, True]
    assert jnp.isfinite(jax.grad(total)(0.1))
    assert jnp.isfinite(jr.Nonlinear().motion(block, 0.1, time)[0]).all()


@pytest.mark.parametrize("model", MODELS, ids=repr)
@pytest.mark.parametrize("question", ["peak_rotation", "half_cycle_duration"])
def test_slopes_at_rest(model, question):
    """Both start from zero, the peak with the square of the velocity."""
    block = jr.Block(0.4, 5.0)
    slope = jax.grad(getattr(model, question), 1)(block, 0.0)
    deceleration = block.frequency_parameter**2 * (
        block.critical_angle
        if isinstance(model, jr.Linearized)
        else jnp.sin(block.critical_angle)
    )
    expected = 0.0 if question == "peak_rotation" else 2 / deceleration
    np.testing.assert_allclose(slope, expected, rtol=1e-6)


@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_a_masked_sum_differentiates_past_blocks_that_overturn(model):
    """With a parameter that all share: NaN times zero must not get in."""

    def total(shared, x):
        block = jr.Block(shared, 5.0)
        velocity = x * jax.lax.stop_gradient(model.critical_velocity(block))
        peak = model.peak_rotation(block, velocity)
        return jnp.nansum(peak), peak

    slope = jax.jit(jax.grad(total, has_aux=True))
    several, peaks = slope(0.4, jnp.asarray([0.3, 1.5, jnp.nan]))
    alone, _ = slope(0.4, jnp.asarray([0.3]))
    assert jnp.isnan(peaks).tolist() == [False, True, True]
    np.testing.assert_allclose(several, alone, rtol=1e-6)


@pytest.mark.thorough
@pytest.mark.float64
def test_released_on_still_ground():
    """Impacts come when the closed form says, a quarter of a rocking cycle and then halves."""
    block = jr.Block(0.1, 5.0)
    tilt = 0.1
    c = 0.9
    response = jr.respond(
        block,
        c,
        jr.Record([0.0, 0.0], 0.01),
        1.5,
        rotation=tilt,
        rtol=1e-12,
        model="linearized",
    )
    p = block.frequency_parameter
    critical = block.critical_angle
    share = 1 - tilt / critical
    launch = np.sqrt(1 - share**2) * c ** np.arange(1, 4)  # over p times the critical angle
    first = float(np.arccosh(1 / share) / p)
    times = first + np.append(0, np.cumsum(2 / p * np.arctanh(launch[:2])))
    np.testing.assert_allclose(response.impact_times[:3], times, rtol=1e-11)


def follow_with_scipy(rocker, jump, times, intensities, samples):
    """Rotation and velocity at samples: SciPy between pulses and impacts, which change velocity."""
    alpha = velocity = now = 0.0
    side = 0
    found = []
    stops = list(zip(times, intensities, strict=True))
    stops += [(time, None) for time in samples]
    for time, intensity in sorted(stops, key=lambda stop: (stop[0], stop[1] is None)):
        while side and now < time:

            def field(t, y, side=side):
                return [y[1], rocker.acceleration(y[0], side, (0.0, 0.0))]

            def lands(t, y, side=side, begin=now):
                return side * y[0] if t > begin + 1e-9 else 1.0

            lands.terminal = True
            lands.direction = -1
            path = solve_ivp(
                field, (now, time), [alpha, velocity], "DOP853",
                rtol=1e-11, atol=1e-14, events=lands,
            )  # fmt: skip
            now = path.t[-1]
            alpha, velocity = path.y[:, -1]
            if path.t_events[0].size:
                alpha = 0.0
                velocity = rocker.c * velocity
                side = -side
        now = time
        if intensity is None:
            found.append((alpha, velocity))
            continue
        side = side or math.copysign(1, intensity)
        turned = math.cos(rocker.angle - abs(alpha)) / math.cos(rocker.angle)
        velocity += jump * intensity * (1.0 if rocker.linearized else turned)
    return np.transpose(found)


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
    jump = float(block.pulse_velocity(1.0))
    theirs = follow_with_scipy(rocker, jump, times, intensities, samples)
    assert 1.2 < abs(theirs[0]).max() / rocker.angle < 2
    assert theirs[0].max() > 0
    np.testing.assert_allclose(ours[:, order], theirs, rtol=1e-6, atol=1e-9)
    # Alone, of another shape and traced it says the same.
    np.testing.assert_array_equal(ours[:, 7], np.array(train.history(samples[7])))
    traced = jax.jit(lambda time: train.history(time))(samples.reshape(1, -1))
    np.testing.assert_allclose(np.squeeze(traced), ours, rtol=1e-9, atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_a_history_before_the_first_pulse_and_after_overturning(model):
    train = jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.5, 1.5], [1.5, -5.0], model)
    rotation, velocity = np.array(train.history([0.0, 0.499, 0.5, 9.0, 99.0, np.nan]))
    assert (rotation[:3] == 0).all()
    assert (velocity[:2] == 0).all()
    assert velocity[2] == pytest.approx(
        float(train.rocker.block.pulse_velocity(1.5)), rel=1e-5
    )
    assert np.isnan([rotation[3:], velocity[3:]]).all()
    # A later pulse does not catch it: it passes the critical angle and rises up to twice that.
    ratio = np.array(train.history(np.linspace(0.5, 9, 400))[0]) / float(
        train.rocker.block.critical_angle
    )
    followed = ratio[: int(np.isnan(ratio).argmax())]
    assert (np.diff(followed) > 0).all()
    assert 1.9 < followed[-1] < 2.01
    assert np.isnan(ratio[followed.size :]).all()


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
    peak = [float(respond(0.2 + by).peak_rotation) for by in (step, -step)]
    slope = jax.jacfwd(lambda intensity: respond(intensity).peak_rotation)(0.2)
    assert float(slope) == pytest.approx((peak[0] - peak[1]) / (2 * step), rel=1e-6)
