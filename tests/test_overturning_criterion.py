"""Fate by energy, and windows of survival, against the SciPy integration."""

import numpy as np
import pytest
from references import stepping

import jaxrock as jr

pytestmark = pytest.mark.float64


BLOCK = jr.Block(0.3, 4.0)
C = 0.7


def random_states():
    """Also beyond the critical angle and moving back."""
    rng = np.random.default_rng(3)
    rotation = rng.uniform(-1.5, 1.5, 80) * float(BLOCK.critical_angle)
    velocity = rng.uniform(-1.5, 1.5, 80) * float(jr.Nonlinear().critical_velocity(BLOCK))
    return rotation, velocity


def falls(rotation, velocity, linearized):
    """Whether free motion ends on a side, by DOP853: if at all, before the second impact."""
    rocker = stepping.Rocker(0.3, 4.0, C, linearized)
    still = stepping.pulse("Rectangular", 0.0, np.full(rotation.size, 100.0))
    found = stepping.follow(rocker, still, 0.0, 1e-9, (rotation, velocity), landings=2)
    fallen = found.peak == np.pi / 2
    assert (found.impacts[~fallen] == 2).all()
    return fallen


@pytest.mark.parametrize("linearized", [False, True])
def test_margin_says_what_free_motion_does(linearized):
    rotation, velocity = random_states()
    model = jr.Linearized() if linearized else jr.Nonlinear()
    margin = jr.driven.free_motion_margin(BLOCK, C, rotation, velocity, model)
    assert 10 < int((margin < 0).sum()) < 70
    np.testing.assert_array_equal(margin < 0, falls(rotation, velocity, linearized))


def test_margin_is_continuous():
    block = jr.Block(0.3, 4.0)
    velocity = np.linspace(-3, 3, 20001)
    margin = jr.driven.free_motion_margin(block, 0.95, 1.2 * block.critical_angle, velocity)
    assert np.abs(np.diff(margin)).max() < 2e-3


@pytest.mark.parametrize("half_diagonal", [0.2, 0.7, 2.0])
def test_survival_windows(half_diagonal):
    """alpha_c = 0.2, one-sine of 0.5 s, C by Housner."""
    block = jr.Block(half_diagonal * np.sin(0.2), 1 / np.tan(0.2))
    c = float(jr.housner_restitution(block))
    unit = 9.81 * np.tan(0.2)
    values = np.linspace(1, 14, 300)
    found = jr.overturning_boundaries(block, c, jr.Sine(unit, 0.5), "factor", values)
    assert found.windows.shape == (1, 2)
    rocker = stepping.Rocker(float(block.half_width), float(block.slenderness), c)

    edges = np.array([found.value[0], *found.windows[0]])
    factors = np.concatenate([edges * (1 - 1e-5), edges * (1 + 1e-5)])
    theirs = stepping.follow(rocker, stepping.pulse("Sine", factors * unit, 0.5))
    assert theirs.overturned.tolist() == [False, True, False, True, False, True]
