"""A coefficient of restitution that depends on velocity, edited into the impact law."""

import functools

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxrock as jr
from jaxrock import impact

BLOCK = jr.Block(half_width=0.2, slenderness=5.0)
C = 0.9
LOSS = 0.2  # of C per rad/s


class Lossy(impact.ImpactLaw):
    linear = False

    def restitution_at(self, restitution, velocity):
        return restitution - LOSS * velocity


@pytest.fixture
def law(monkeypatch):
    """Programs are compiled with a law, and must not outlive it."""
    jax.clear_caches()
    monkeypatch.setattr(impact, "LAW", Lossy())
    yield
    jax.clear_caches()


def follow(amplitude, duration, end):
    """The rotation at the end and the highest one on the way, by SciPy."""
    angle = float(BLOCK.critical_angle)
    p = float(BLOCK.frequency_parameter)

    def accelerate(time, y, side):
        push = amplitude * np.sin(2 * np.pi * time / duration) / 9.81 * (time < duration)
        tilt = angle - y[0]
        return y[1], -(p**2) * (np.sin(tilt) - side * push * np.cos(tilt))

    def land(time, y, side):
        return y[0] if time > start + 1e-9 else 1.0

    def turn(time, y, side):
        return y[1]

    land.terminal = True
    land.direction = -1
    start = np.arcsin(9.81 / 5 / amplitude) * duration / (2 * np.pi)
    y = [0.0, 0.0]
    side = 1
    peak = 0.0
    while start < end:
        stop = duration if start < duration else end
        path = solve_ivp(
            accelerate,
            (start, stop),
            y,
            "DOP853",
            args=(side,),
            events=[land, turn],
            rtol=1e-11,
            atol=1e-14,
        )
        peak = max(peak, path.y[0].max(), *(rows[0] for rows in path.y_events[1]))
        start = path.t[-1]
        y = path.y[:, -1]
        if path.status == 1:
            side = -side
            y = [0.0, -(C + LOSS * y[1]) * y[1]]
    return side * y[0], peak


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.usefixtures("law")
def test_all_motions_give_the_law_a_velocity_in_rad_per_second():
    expected = follow(4.0, 0.5, 1.5)
    pulse = jr.Sine(4.0, 0.5)
    for respond in (functools.partial(jr.respond, rtol=1e-10), jr.respond_batch):
        driven = respond(BLOCK, C, pulse, 1.5)
        values = driven.final_rotation, driven.peak_rotation
        np.testing.assert_allclose(values, expected, rtol=1e-7)

    train = jr.respond_to_train(BLOCK, C, [0.0, 100.0], [0.2, 0.0])
    scene = jr.Scene(BLOCK, C, 0.2)
    launch = float(jr.launch_velocity(scene))
    critical = float(jr.Linearized().critical_velocity(BLOCK))
    assert float(train.velocity_ratio[0]) == pytest.approx(launch / critical, rel=1e-12)
    after = float(jr.resonance.next_velocity(scene, launch)) - launch
    assert after == pytest.approx((C - LOSS * launch) * launch, rel=1e-12)
    wait = jr.Linearized().half_cycle_duration(BLOCK, launch)
    train = jr.respond_to_train(BLOCK, C, [0.0, 1.0001 * wait], [0.2, 0.0])
    assert float(train.velocity_ratio[1]) == pytest.approx(after / critical, rel=1e-12)


@pytest.mark.usefixtures("law")
def test_sums_refuse_the_law():
    scene = jr.Scene(BLOCK, C, 0.1)
    for ask in (
        lambda: jr.stabilized_velocity(scene),
        lambda: jr.half_cycle_velocity(scene, 3),
        lambda: jr.rotation_ratio(scene),
        lambda: jr.overturning_half_cycle(scene),
        lambda: jr.critical_intensity(BLOCK, C),
        lambda: jr.steady.harmonic_orbit(BLOCK, C, 1.5, 12.0),
        lambda: jr.steady.least_harmonic_amplitude(BLOCK, C, 12.0),
        lambda: jr.worst_train(BLOCK, C, 3),
    ):
        with pytest.raises(ValueError, match="must not depend on velocity for a sum"):
            ask()
