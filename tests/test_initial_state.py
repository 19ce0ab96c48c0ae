"""Blocks of a batch that are tilted or pushed at time 0: the same motion as `respond` computes."""

import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tools.selection import first_before_release, first_by_default

import jaxrock as jr

BLOCK = jr.Block(0.2, 5.0)
ANGLE = float(BLOCK.critical_angle)


def draw_blocks(rng, number):
    """Slender blocks, with a restitution, an initial rotation and velocity each."""
    half_width = rng.uniform(0.1, 0.5, number)
    slenderness = rng.uniform(3, 8, number)
    restitution = rng.uniform(0.5, 0.95, number)
    angle = np.arctan(1 / slenderness)
    rate = np.sqrt(0.75 * 9.81 / (half_width * np.hypot(1, slenderness)))
    rotation = rng.uniform(-1.3, 1.3, number) * angle
    velocity = rng.uniform(-0.8, 0.8, number) * rate * angle
    rotation[::5] = 0.0
    velocity[1::5] = 0.0
    return half_width, slenderness, restitution, rotation, velocity


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("linearized", [False, True])
@pytest.mark.parametrize(
    "kind", first_before_release(["Sine", "Cosine", "Ricker", "record"], 1)
)
def test_against_an_independent_integration(kind, linearized):
    rng = np.random.default_rng(2)
    half_width, slenderness, restitution, rotation, velocity = draw_blocks(rng, 60)
    if kind == "record":
        samples = np.asarray(jr.example_record("north").acceleration)[1100:1200]
        scale = rng.uniform(0.2, 1, 60)
        motion = jr.Record(samples, 0.01, scale=scale)
        ground = stepping.record(samples, 0 * samples, 0.01, scale)
    else:
        amplitude = 9.81 / slenderness * rng.uniform(0.1, 2, 60) * rng.choice([-1, 1], 60)
        motion = getattr(jr, kind)(amplitude, rng.uniform(0.2, 1, 60))
        ground = stepping.pulse(kind, motion.amplitude, motion.duration)
    rocker = stepping.Rocker(half_width, slenderness, restitution, linearized)
    truth = stepping.follow(rocker, ground, 1.0, start=(rotation, velocity))
    block = jr.Block(half_width, slenderness)
    model = "linearized" if linearized else "nonlinear"
    options = {"rotation": rotation, "velocity": velocity, "model": model}
    found = jr.respond_batch(block, restitution, motion, motion.end + 1.0, **options)
    assert found.complete.all()
    np.testing.assert_array_equal(found.overturned, truth.overturned)
    stands = ~truth.overturned
    assert 15 < stands.sum() < 55
    np.testing.assert_allclose(found.peak_rotation[stands], truth.peak[stands], rtol=1e-8)
    np.testing.assert_allclose(found.margin[stands], truth.margin[stands], atol=1e-7)


signs_and_sizes = st.floats(-1.4, 1.4).filter(lambda x: x == 0 or abs(x) > 1e-3)


@pytest.mark.thorough
@pytest.mark.float64
@hypothesis.given(
    rotation=signs_and_sizes,
    velocity=signs_and_sizes,
    strength=st.floats(-3, 3),
    start=st.sampled_from([0.0, 0.2]),
    motion=st.sampled_from([jr.Sine, jr.Ricker, jr.Harmonic]),
)
def test_mirror_symmetry(rotation, velocity, strength, start, motion):
    """If rotation, velocity and motion change their signs, the response does, to the last bit."""
    both = np.array([1.0, -1.0])
    amplitude = both * strength * 9.81 / 5
    scene = (
        motion(amplitude, 9.0, 3, start)
        if motion is jr.Harmonic
        else motion(amplitude, 0.5, start)
    )
    state = {"rotation": both * rotation * ANGLE, "velocity": both * velocity}
    found = jr.respond_batch(BLOCK, 0.9, scene, 2.5, **state)
    assert found.complete.all()
    for name in ("peak_rotation", "overturned", "margin", "impacts", "mode"):
        one, other = np.asarray(getattr(found, name))
        assert one == other
    for name in ("final_rotation", "final_velocity"):
        one, other = np.asarray(getattr(found, name))
        assert one == -other


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("solver", first_by_default([jr.respond, jr.respond_batch]))
@pytest.mark.parametrize("kind", first_by_default([jr.Cosine, jr.Sine]))
def test_derivatives_against_differences(solver, kind):
    """Of several answers, with respect to initial rotation, velocity, and the start."""

    def answers(numbers):
        rotation, velocity, start = numbers
        pulse = kind(1.2, 0.5, start=start)
        r = solver(BLOCK, 0.9, pulse, 1.6, rotation=rotation, velocity=velocity)
        return jnp.stack([r.peak_rotation, r.final_rotation, r.final_velocity, r.margin])

    derive = jax.jit(jax.jacfwd(answers))
    for start in (0.1, 0.0):
        at = np.array([-0.4 * ANGLE, -0.1, start])
        for k in range(3):
            step = 1e-5 * np.eye(3)[k]
            if k == 2 and start == 0:
                # Only later starts are allowed.
                slope = (
                    4 * answers(at + step) - 3 * answers(at) - answers(at + 2 * step)
                ) / 2e-5
            else:
                slope = (answers(at + step) - answers(at - step)) / 2e-5
            np.testing.assert_allclose(derive(at)[:, k], slope, rtol=2e-5, atol=2e-5)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("solver", [jr.respond_batch, jr.respond])
@pytest.mark.parametrize("name", ["velocity", "rotation"])
def test_a_block_at_rest_forgets_a_small_push(solver, name):
    """Before the input lifts it: the derivative is 0, as differences are."""

    def peak(value, pulse):
        return solver(BLOCK, 0.9, pulse, 1.0, **{name: value}).peak_rotation

    for pulse in (jr.Sine(4.0, 0.5), jr.Cosine(4.0, 0.5, start=0.2)):
        np.testing.assert_allclose(peak(1e-8, pulse), peak(0.0, pulse), rtol=1e-9)
        assert jax.jacfwd(lambda value, pulse=pulse: peak(value, pulse))(0.0) == 0
    # One that the input lifts at once goes on from where it is, to the side that is lifted.
    for sign in (1, -1):
        pulse = jr.Cosine(sign * 4.0, 0.5)
        slope = jax.jacfwd(lambda value, pulse=pulse: peak(value, pulse))(0.0)
        difference = (peak(sign * 1e-7, pulse) - peak(0.0, pulse)) / (sign * 1e-7)
        np.testing.assert_allclose(slope, difference, rtol=1e-3)


# Rotation and velocity at time 0 of a block that lands under a push of three times uplift: to
# the side from which it came, to the side to which it goes, and before a push that lifts it.
STOPPED = {"back": (0.05, -1.0, 0.0), "on": (-0.05, 1.0, 0.0), "rests": (0.05, -1.0, 0.2)}


@pytest.mark.float64
@pytest.mark.parametrize("name", list(STOPPED))
def test_impacts_that_stop_a_block(name):
    """With C = 0 it goes to the side that the ground lifts, at once: as in the limit of small C."""
    rotation, velocity, start = STOPPED[name]
    c = np.array([0.0, -0.0, 1e-310, 1e-200, 1e-100, 1e-20, 1e-13])
    pulse = jr.Cosine(6.0, 0.5, start=start)
    ground, settle = stepping.within(stepping.pulse("Cosine", 6.0, 0.5), [start], [0.5])
    truth = stepping.follow(
        stepping.Rocker(0.2, 5.0, 0.0), ground, settle, start=(rotation, velocity)
    )
    one = jr.respond(BLOCK, 0.0, pulse, 0.5, rotation=rotation, velocity=velocity, rtol=1e-11)
    np.testing.assert_allclose(one.final_rotation, truth.rotation[0], rtol=1e-8)
    for rtol in (1e-5, 1e-9, 1e-13):
        found = jr.respond_batch(
            BLOCK, c, pulse, 0.5, rotation=rotation, velocity=velocity, rtol=rtol
        )
        tolerance = max(10 * rtol, 1e-9)
        np.testing.assert_allclose(found.peak_rotation, truth.peak[0], rtol=tolerance)
        np.testing.assert_allclose(found.final_rotation, truth.rotation[0], rtol=tolerance)
        np.testing.assert_allclose(found.margin, truth.margin[0], rtol=10 * tolerance)


@pytest.mark.float64
@pytest.mark.parametrize("solver", first_by_default([jr.respond_batch, jr.respond]))
@pytest.mark.parametrize("name", first_by_default(STOPPED))
def test_derivatives_where_impacts_stop_a_block(solver, name):
    """With respect to C at 0, where it is one-sided: the limit of small C, as differences."""
    rotation, velocity, start = STOPPED[name]
    pulse = jr.Cosine(6.0, 0.5, start=start)

    def final(c):
        return solver(
            BLOCK, c, pulse, 0.5, rotation=rotation, velocity=velocity, rtol=1e-12
        ).final_rotation

    step = 1e-5
    difference = (4 * final(step) - 3 * final(0.0) - final(2 * step)) / (2 * step)
    assert abs(difference) > 0.005
    derive = jax.jit(jax.jacfwd(final))
    for c in (0.0, 1e-310, 1e-200, 1e-20, 1e-13, 1e-9):
        np.testing.assert_allclose(derive(c), difference, rtol=1e-6, atol=1e-9)
    if solver is jr.respond:
        np.testing.assert_allclose(jax.grad(final)(0.0), difference, rtol=1e-6, atol=1e-9)


@pytest.mark.float64
def test_states_at_the_edges():
    """At rest, hardly off the ground, and lying on either side."""
    pulse = jr.Sine(4.0, 0.5, start=0.1)
    rotation = np.array([0.0, -0.0, 1e-300, -1e-20, 0.0, 0.0, np.pi / 2, -np.pi / 2])
    velocity = np.array([0.0, -0.0, 0.0, -1e-20, 1e-12, -1e-300, 0.0, 1.0])
    found = jr.respond_batch(BLOCK, 0.9, pulse, 2.0, rotation=rotation, velocity=velocity)
    from_rest = jr.respond_batch(BLOCK, 0.9, pulse, 2.0)
    assert found.complete.all()
    np.testing.assert_array_equal(found.peak_rotation[:2], from_rest.peak_rotation)
    np.testing.assert_allclose(found.peak_rotation[:6], from_rest.peak_rotation, rtol=1e-9)
    fallen = found.overturned[6:]
    assert fallen.all()
    np.testing.assert_array_equal(found.final_rotation[6:], rotation[6:])
    np.testing.assert_array_equal(found.final_velocity[6:], velocity[6:])
    assert found.mode[6:].tolist() == [0, 0]
    assert found.impacts[6:].tolist() == [0, 0]
