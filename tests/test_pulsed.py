"""Resonance under pulses that last, against the closed forms as they become short."""

import jax
import numpy as np
import pytest

import jaxrock as jr

pytestmark = pytest.mark.float64
BLOCK, C, INTENSITY = jr.Block(0.4, 5.0), 0.7, 0.15


def half_sine(duration):
    return jr.HalfSine(INTENSITY / duration * np.pi / 2, duration)


@pytest.mark.thorough
def test_order_in_the_duration():
    scene = jr.Scene(BLOCK, C, INTENSITY)
    closed = [
        float(jr.stabilized_velocity(scene)),
        float(jr.stabilized_period(scene, jr.Nonlinear())),
        float(jr.stabilized_rotation(scene, jr.Nonlinear())),
        C,
    ]
    errors = []
    for duration in (4e-3, 2e-3, 1e-3):
        phase = jr.pulsed_phase(BLOCK, C, half_sine(duration))
        assert phase.stands
        errors.append(
            [
                abs(float(found) - expected)
                for found, expected in zip(
                    (phase.velocity, phase.period, phase.peak_rotation, phase.rate),
                    closed,
                    strict=True,
                )
            ]
        )
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 1, atol=0.02)


def test_fixed_point_and_rate():
    pulse = half_sine(0.04)
    phase = jr.pulsed_phase(BLOCK, C, pulse)
    velocity, errors = 0.0, []
    for _ in range(12):
        velocity = jr.pulsed_next_velocity(BLOCK, C, pulse, velocity)
        errors.append(float(phase.velocity - velocity))
    rates = np.array(errors[1:]) / errors[:-1]
    assert rates[-1] == pytest.approx(float(phase.rate), rel=1e-2)
    again = jr.pulsed_next_velocity(BLOCK, C, pulse, phase.velocity)
    assert float(again) == pytest.approx(float(phase.velocity), rel=1e-9)


@pytest.mark.thorough
def test_derivative():
    @jax.jit
    def ratio(at):
        phase = jr.pulsed_phase(BLOCK, at[1], jr.HalfSine(at[0], 0.04))
        return phase.rotation_ratio

    at = np.array([float(half_sine(0.04).amplitude), C])
    found = jax.jit(jax.grad(ratio))(at)
    for k, step in enumerate((1e-2, 1e-3)):
        shift = step * np.eye(2)[k]
        assert float(found[k]) == pytest.approx(
            float(ratio(at + shift) - ratio(at - shift)) / (2 * step), rel=1e-4
        )


def test_no_phase_and_no_motion():
    over = jr.pulsed_phase(BLOCK, C, jr.HalfSine(100.0, 0.1))
    assert not over.stands
    assert np.isnan(over.rotation_ratio)
    rest = jr.pulsed_phase(BLOCK, C, jr.HalfSine(1.0, 0.1))
    assert rest.stands
    assert rest.rotation_ratio == 0
    with pytest.raises(ValueError, match="restitution must be between 0 and 1"):
        jr.pulsed_phase(BLOCK, 1.5, half_sine(0.1))
    with pytest.raises(ValueError, match=r"rtol must be greater than 0 and at most 0\.001"):
        jr.pulsed_phase(BLOCK, C, half_sine(0.1), rtol=0.5)


@pytest.mark.thorough
def test_verge():
    """A phase just below it, none just above; slopes against differences; closed form."""

    def verge(at):
        block = jr.Block(at[0], at[1])
        return jr.critical_pulsed_amplitude(block, at[2], jr.HalfSine, at[3], rtol=1e-12)

    at = np.array([0.4, 5.0, 0.7, 0.05])
    found = verge(at)
    amplitude = float(found.amplitude)
    assert bool(found.lifts)
    for factor, stands in ((1 - 1e-5, True), (1 + 1e-5, False)):
        pulse = jr.HalfSine(amplitude * factor, 0.05)
        assert bool(jr.pulsed_phase(BLOCK, C, pulse).stands) == stands
    slopes = jax.jacfwd(lambda at: verge(at).amplitude)(at)
    for k, step in enumerate(1e-3 * at):

        def difference(h, k=k):
            low, high = (verge(at + s * h * np.eye(4)[k]).amplitude for s in (-1, 1))
            return float(high - low) / (2 * h)

        extrapolated = (4 * difference(step / 2) - difference(step)) / 3
        assert float(slopes[k]) == pytest.approx(extrapolated, rel=1e-7)
    closed = float(jr.critical_intensity(BLOCK, C, np.inf, jr.Nonlinear()))
    errors = [
        float(verge(np.array([0.4, 5.0, 0.7, duration])).intensity) - closed
        for duration in (4e-3, 2e-3, 1e-3)
    ]
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 1, atol=0.05)
    # Of long pulses the fixed point is lost before, where it meets another one.
    assert np.isnan(verge(np.array([0.4, 5.0, 0.95, 2.0])).amplitude)
