"""Friction demand and normal force, against dense trajectories by SciPy and closed forms."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from references.forces import Trajectory, pieces_of
from tools.selection import first_before_release, first_by_default

import jaxrock as jr

pytestmark = pytest.mark.float64
STILL = jr.Rectangular(0.0, 1e-3)
SAMPLES = 14
# Over what just lifts the block, so that of each kind some stand and some overturn.
STRENGTHS = {"Rectangular": (1.02, 1.8), "HalfSine": (1.02, 3.0), "Cosine": (1.5, 10.0)}


def scene(rng, kind, bouncing, vertical, inertia_ratio):
    """Block, C, motion, and the motion in pieces."""
    slenderness = rng.uniform(1.3, 8)
    c = rng.uniform(0.1, bouncing)
    half_width = 10 ** rng.uniform(-1, 0.3)
    block = jr.Block(half_width, slenderness, inertia_ratio=inertia_ratio)
    strength = 9.81 / slenderness * rng.uniform(*STRENGTHS.get(kind, (1.02, 5)))
    strength *= rng.choice([-1, 1])
    if kind == "Record":
        step = rng.uniform(0.03, 0.12)
        samples = rng.normal(0, 1, SAMPLES)
        samples *= 2 * strength / abs(samples).max()
        up = rng.normal(0, vertical, SAMPLES) * (rng.integers(2) or vertical > 5)
        motion = jr.Record(samples, step, up)
        return block, c, motion, stepping.record(samples, up, step)
    duration = rng.uniform(0.5, 4) / float(block.frequency_parameter)
    return (
        block,
        c,
        getattr(jr, kind)(strength, duration),
        stepping.pulse(kind, strength, duration),
    )


def compare(kind, count, seed, bouncing=0.4, vertical=2.5, inertia_ratio=4 / 3):
    rng = np.random.default_rng(seed)
    overturned = left = 0
    for _ in range(count):
        block, c, motion, ground = scene(rng, kind, bouncing, vertical, inertia_ratio)
        settle = 3 / float(block.frequency_parameter)
        size = float(block.half_width), float(block.slenderness)
        rocker = stepping.Rocker(*size, c, share=1 / inertia_ratio)
        r = jr.respond(block, c, motion, float(motion.end) + settle, rtol=1e-10)
        expected = Trajectory(rocker, pieces_of(ground), settle)
        off = max(
            abs(float(r.normal_force) - expected.normal),
            # Of an angle, since the demand is infinite where nothing presses.
            abs(math.atan(float(r.friction_demand)) - math.atan(expected.demand)),
        )
        assert np.isinf(r.friction_demand) == (r.normal_force <= 0)
        assert off < 1e-6, f"{block}, C {c}, {motion}: {r}\n{vars(expected)}"
        assert (abs(float(r.final_rotation)) >= math.pi / 2) == expected.over
        assert expected.over or abs(float(r.final_rotation) - expected.alpha) < 1e-7
        overturned += expected.over
        lost = float(np.nan_to_num(r.contact_loss_time, nan=np.inf))
        assert lost == pytest.approx(expected.loss, abs=1e-5)
        left += expected.normal <= 0
    return overturned, left


@pytest.mark.parametrize("kind", first_by_default(["Sine", "Record"]))
def test_extremes_of_the_forces(kind):
    overturned, _ = compare(kind, 8, 3)
    assert 0 < overturned < 8


def forces_at_uplift(amplitude, slenderness):
    """Friction demand and normal force as a push begins to turn a block at rest: closed form."""
    angle = math.atan(1 / slenderness)
    push = amplitude / 9.81
    acceleration = push * math.cos(angle) - math.sin(angle)  # over p^2, with p^2 R / g = 3 / 4
    horizontal = 0.75 * math.cos(angle) * acceleration - push
    normal = 1 + 0.75 * math.sin(angle) * acceleration
    return abs(horizontal) / normal, normal


BEYOND_UPLIFT = {
    "Cosine": lambda amplitude: jr.Cosine(amplitude, 0.3),
    "Rectangular": lambda amplitude: jr.Rectangular(amplitude, 0.3, start=0.1),
    "Record": lambda amplitude: jr.Record([1.0, 0.5, 0.0], 0.1, scale=amplitude),
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", first_by_default(list(BEYOND_UPLIFT)))
def test_a_block_that_is_lifted_at_once_has_not_stood_still(kind):
    """It would have had the demand a / g = 0.41 in an instant of length 0."""

    def ours(numbers):
        motion = BEYOND_UPLIFT[kind](numbers[0])
        block = jr.Block(0.2, numbers[1])
        r = jr.respond(block, 0.9, motion, motion.start + 1e-7, max_impacts=0)
        return jnp.stack([r.friction_demand, r.normal_force])

    numbers = np.array([4.0, 5.0])
    demand, normal = forces_at_uplift(*numbers)
    # Before its start, a motion presses with the weight, which is less.
    least = min(normal, 1.0 if kind == "Rectangular" else math.inf)
    np.testing.assert_allclose(ours(numbers), (demand, least), rtol=1e-6)
    steps = 1e-5 * np.eye(2)
    expected = [
        (forces_at_uplift(*numbers + step)[0] - forces_at_uplift(*numbers - step)[0]) / 2e-5
        for step in steps
    ]
    np.testing.assert_allclose(jax.jacfwd(ours)(numbers)[0], expected, rtol=1e-5)


@pytest.mark.thorough
@pytest.mark.parametrize("inertia_ratio", [1.15, 1.8])
def test_extremes_of_the_forces_of_other_bodies(inertia_ratio):
    compare("HalfSine", 5, 6, inertia_ratio=inertia_ratio)


@pytest.mark.thorough
def test_blocks_that_would_leave_the_ground():
    """The motion is that of the equation, and the forces say that it is none."""
    overturned, left = compare("Record", 8, 5, vertical=8.0)
    assert 0 < overturned < 8
    assert left > 4


@pytest.mark.thorough
@pytest.mark.parametrize("kind", first_before_release(["Record", *stepping.SHAPES], 1))
def test_extremes_of_the_forces_of_many(kind):
    overturned, _ = compare(kind, 50, 4, 0.8)
    assert 10 <= overturned <= 40


def closed(slenderness, x, share=0.75):
    """Extremes of a block launched at x critical velocities up to its side: from energy."""
    angle = math.atan(1 / slenderness)
    q = np.linspace(angle, angle - math.pi / 2, 400001)
    square = 4 * ((x * math.sin(angle / 2)) ** 2 - np.sin(angle / 2) ** 2 + np.sin(q / 2) ** 2)
    horizontal = share * (square - np.cos(q)) * np.sin(q)
    normal = 1 - share * (np.sin(q) ** 2 + square * np.cos(q))
    demand = np.where(normal > 0, abs(horizontal) / np.where(normal > 0, normal, 1), np.inf)
    return demand.max(), normal.min()


@pytest.mark.thorough
def test_launched_blocks_that_overturn():
    """What was found depended on the length of the last step, which goes beyond 90 degrees."""
    for slenderness, x, ratio, known in (
        (1.5, 1.2, 4 / 3, 6.19),
        (3.0, 1.01, 4 / 3, math.inf),
        (1.5, 1.2, 2.0, 0.550),
    ):
        block = jr.Block(0.4, slenderness, inertia_ratio=ratio)
        launch = x * jr.Nonlinear().critical_velocity(block)
        expected = closed(slenderness, x, 1 / ratio)
        assert expected[0] == pytest.approx(known, rel=1e-3)
        for rtol, within in ((1e-4, 1e-3), (1e-10, 1e-8)):
            r = jr.respond(block, 0.8, STILL, 9.0, velocity=launch, rtol=rtol)
            assert r.overturned
            found = float(r.friction_demand), float(r.normal_force)
            np.testing.assert_allclose(found, expected, rtol=within, atol=within)


@pytest.mark.thorough
def test_second_derivatives():
    """As differences of the first, which are compared with independent ones above."""

    def ours(amplitude):
        r = jr.respond(
            jr.Block(0.2, 3.0), 0.9, jr.Sine(amplitude, 0.8), 1.0, rtol=1e-10, max_impacts=0
        )
        return jnp.stack([r.friction_demand, r.normal_force])

    slopes = jax.jit(jax.jacfwd(ours))
    second = jax.jit(jax.jacfwd(jax.jacfwd(ours)))
    for at, step in ((5.0, 1e-4), (6.5, 1e-4)):
        expected = (slopes(at + step) - slopes(at - step)) / (2 * step)
        np.testing.assert_allclose(second(at), expected, rtol=1e-5)
