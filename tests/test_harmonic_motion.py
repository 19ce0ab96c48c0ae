"""Harmonic ground motion, and blocks under it, against integration of another kind."""

import itertools

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.ground_motion import Harmonic

BLOCK = jr.Block(0.3, 5.0)
UPLIFT = 9.81 / 5


def one(tree, k):
    return jax.tree.map(lambda leaf: leaf[k] if np.ndim(leaf) else leaf, tree)


def test_motion(eps):
    motion = Harmonic(-3.0, 8.0, 4, start=0.2)
    period = 2 * np.pi / 8
    end = 0.2 + 4 * period
    times = np.linspace(0.21, end - 0.01, 57)
    expected = -3 * np.sin(8 * (times - 0.2))
    np.testing.assert_allclose(motion.horizontal(times), expected, atol=200 * eps)
    assert not motion.horizontal([0.0, 0.199, end + 1e-3, 9.0]).any()
    assert not motion.upward(times).any()
    assert float(motion.intensity) == 0
    assert float(motion.end) == pytest.approx(end)
    assert float(motion.next_kink(motion.start)) == np.inf
    knots = np.asarray(motion.knots())
    assert knots[[0, 1, -1]] == pytest.approx([0.2, 0.2 + period / 4, end])
    assert len(knots) == 10
    for a, b in itertools.pairwise(knots):
        rise = np.diff(motion.value(jnp.linspace(a, b, 30))[0])
        assert (rise >= -200 * eps).all() or (rise <= 200 * eps).all()
    other = motion.scaled(-2.0).shifted(1.0)
    assert float(other.horizontal(1.3)) == pytest.approx(6 * np.sin(0.8), rel=1e-5)
    assert other.cycles == 4


# From just above uplift to overturning. The first two blocks come to rest in each half-cycle,
# and are lifted again in all of them. The strength is over that of uplift.
STRENGTH = np.array([1.003, 1.1, *np.tile([1.15, 1.3, 1.6, 2.0, 2.6], 2)])
RESTITUTION = np.array([0.1, 0.2, *np.repeat([0.7, 0.85], 5)])
_RNG = np.random.default_rng(5)
HALF_WIDTH = _RNG.uniform(0.1, 0.5, 12)
SLENDERNESS = _RNG.uniform(3, 8, 12)
FREQUENCY = np.where(STRENGTH > 2.1, _RNG.uniform(3, 5, 12), _RNG.uniform(6, 15, 12))


CYCLES = 10


@pytest.mark.thorough
@pytest.mark.float64
def test_against_independent_integration():
    rocker = stepping.Rocker(HALF_WIDTH, SLENDERNESS, RESTITUTION)
    amplitude = STRENGTH * 9.81 / SLENDERNESS
    ground = stepping.harmonic(amplitude, FREQUENCY, CYCLES)
    truth = stepping.follow(rocker, ground, 0.0, rtol=1e-11)
    motion = Harmonic(amplitude, FREQUENCY, CYCLES)
    scenes = jr.Block(HALF_WIDTH, SLENDERNESS), RESTITUTION, motion
    found = jr.respond_batch(*scenes)
    assert found.complete.all()
    assert truth.overturned.sum() == 3
    np.testing.assert_array_equal(found.overturned, truth.overturned)
    stands = ~truth.overturned
    assert (truth.impacts[stands] >= 2 * CYCLES - 1).all()
    assert (truth.impacts[:2] > 10 * CYCLES).all()
    for mine, theirs in (
        (found.peak_rotation, truth.peak),
        (found.final_rotation, truth.rotation),
        (found.margin, truth.margin),
    ):
        atol = 1e-8 * truth.peak[stands].min()
        np.testing.assert_allclose(mine[stands], theirs[stands], rtol=1e-7, atol=atol)
    for k in np.flatnonzero(stands):
        r = jr.respond(*one(scenes, k), rtol=1e-11)
        assert r.status == jr.Status.COMPLETE
        assert float(r.peak_rotation) == pytest.approx(truth.peak[k], rel=1e-7)
        first = truth.impact_times[k][0]
        assert float(r.impact_times[0]) == pytest.approx(first, rel=1e-8)


@pytest.mark.float64
@pytest.mark.parametrize("one_sided", first_by_default([False, True]))
@pytest.mark.parametrize("size", first_by_default([150, 2000]))
def test_impacts_that_stop_a_block(size, one_sided):
    """With C = 0: lifted at once where the ground pushes back, and certified as it is."""
    rng = np.random.default_rng(5)
    half_width, slenderness, frequency = np.exp(
        rng.uniform(*np.log([[0.02, 1, 0.3], [2, 10, 10]]), (size, 3))
    ).T
    block = jr.Block(half_width, slenderness, one_sided=one_sided)
    frequency *= np.asarray(block.frequency_parameter)
    amplitude = rng.uniform(1.05, 6, size) * 9.81 / slenderness
    truth = stepping.follow(
        stepping.Rocker(half_width, slenderness, 0.0, one_sided=one_sided),
        stepping.harmonic(amplitude, frequency, 8),
        0.0,
        rtol=1e-11,
    )
    stands = ~truth.overturned
    motion = Harmonic(amplitude, frequency, 8)
    c = np.array([[0.0], [-0.0], [1e-310]])
    # Flights from rest to rest amplify errors as well.
    for rtol, tolerance in ((1e-9, 1e-3), (1e-13, 1e-5)):
        found = jr.respond_batch(block, c, motion, rtol=rtol)
        np.testing.assert_array_equal(found.overturned, [truth.overturned] * 3)
        for mine, theirs in ((found.peak_rotation, truth.peak), (found.margin, truth.margin)):
            expected = [theirs[stands]] * 3
            np.testing.assert_allclose(mine[:, stands], expected, rtol=tolerance, atol=1e-6)
    estimate = jr.respond_within(block, c, motion, 1e-6)
    assert estimate.within_tolerance.all()
    response = jax.tree.map(np.asarray, estimate.response)
    np.testing.assert_array_equal(response.overturned, [truth.overturned] * 3)
    error = np.abs(response.peak_rotation / truth.peak - 1)[:, stands]
    assert (error <= np.asarray(estimate.error)[:, stands] + 1e-10).all()


@pytest.mark.thorough
@pytest.mark.float64
def test_lifted_in_every_half_cycle_or_never():
    """Where the block comes to rest in between; the ground is symmetric, but for its first side."""
    weak = jr.respond_batch(BLOCK, 0.2, Harmonic(0.9999 * UPLIFT, 9.0, 200))
    assert weak.complete
    assert float(weak.peak_rotation) == 0
    motion = Harmonic(-1.01 * UPLIFT, 9.0, 200, start=0.3)
    found = jr.respond(BLOCK, 0.2, motion, rtol=1e-11)
    assert bool(found.at_rest)
    events = found.events
    lifts = np.asarray(events.time)[1:][
        (np.diff(events.time) > 0.1) & (events.rotation[1:] == 0)
    ]
    assert len(lifts) >= 399
    batch = jr.respond_batch(BLOCK, 0.2, motion)
    assert 400 <= int(batch.impacts) <= int(found.impacts)
    assert float(batch.peak_rotation) == pytest.approx(float(found.peak_rotation), rel=1e-8)
    first = jr.respond_batch(BLOCK, 0.2, Harmonic(1.01 * UPLIFT, 9.0, 1))
    assert float(batch.peak_rotation) == pytest.approx(float(first.peak_rotation), rel=1e-8)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("place", [0, 1], ids=["amplitude", "frequency"])
def test_derivatives_against_differences(place):
    point = 1.3 * UPLIFT, 9.0

    def adaptive(*numbers):
        return jr.respond(BLOCK, 0.7, Harmonic(*numbers, 30, 0.1), rtol=1e-12).peak_rotation

    def batch(*numbers):
        motion = Harmonic(*numbers, 30, 0.1)
        return jr.respond_batch(BLOCK, 0.7, motion, rtol=1e-12).peak_rotation

    step = np.eye(2)[place] * 1e-5
    difference = float(adaptive(*(point + step)) - adaptive(*(point - step))) / 2e-5
    direction = tuple(np.eye(2)[place])
    for slope in (
        jax.jvp(adaptive, point, direction)[1],
        jax.grad(adaptive, place)(*point),
        jax.jvp(batch, point, direction)[1],
    ):
        assert float(slope) == pytest.approx(difference, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("cycles", [3, 8])
def test_boundaries(cycles):
    """Along the frequency: all times are in ratio to the square root of the size."""
    frequencies = np.linspace(4.5, 9, 61)

    def boundary(half_width):
        motion = Harmonic(3.0, 9.9, cycles)  # the frequency of which does not matter
        block = jr.Block(half_width, 5.0)
        return jr.overturning_boundaries(block, 0.9, motion, "frequency", frequencies).value

    found = boundary(0.3)
    assert len(found) == 7
    np.testing.assert_allclose(jax.jacfwd(boundary)(0.3), found / -0.6, rtol=1e-6)
