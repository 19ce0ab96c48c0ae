"""A coefficient of restitution that depends on velocity, edited into the impact law."""

import functools

import jax
import numpy as np
import pytest
from references import stepping

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


class Rocker(stepping.Rocker):
    def leave(self, velocity):
        return -(self.c + LOSS * velocity) * velocity


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.usefixtures("law")
def test_all_motions_give_the_law_a_velocity_in_rad_per_second():
    path = stepping.follow(Rocker(0.2, 5.0, C), stepping.pulse("Sine", 4.0, 0.5), 1.0)
    expected = [path.rotation[0], path.peak[0]]
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
