"""Slopes where the duration, both ends of the input, samples, turns and impacts coincide.

One-sided differences of an independent integration say what the slopes on either side are.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from references.forces import Trajectory, pieces_of

import jaxrock as jr
from jaxrock.numerics import pick_larger, pick_largest, pick_smaller

pytestmark = pytest.mark.float64
NUMBERS = ["half_width", "slenderness", "restitution", "duration", "rotation", "start"]
# The last one: of a pulse, or a step of a record.
DURATION = 3
ROTATION = 4
START = 5
LENGTH = 6
SAMPLES = [4.0, 5.0, -2.0, -6.0, 3.0, 5.0, -3.0, 4.0]
LAST = len(SAMPLES) - 1
FINAL = slice(0, 4)
IMPACT = 4
FORCES = slice(5, 7)


def scene(duration, length=0.15, start=0.1, rotation=0.0, strength=SAMPLES):
    """All numbers of a block under a record of some samples, or under a pulse."""
    strength = np.atleast_1d(strength)
    return np.array([0.3, 4.0, 0.7, duration, rotation, start, length, *strength])


def answers(kind, x):
    shape = jr.Record if kind == "Record" else getattr(jr, kind)
    strength = x[LENGTH + 1 :] if kind == "Record" else x[LENGTH + 1]
    motion = shape(strength, x[LENGTH], start=x[START])
    block = jr.Block(x[0], x[1])
    r = jr.respond(
        block, x[2], motion, x[DURATION], rotation=x[ROTATION], rtol=1e-12, max_impacts=32
    )
    final = (r.final_rotation, r.final_velocity, r.peak_rotation, r.margin)
    return jnp.stack([*final, r.impact_times[0], r.friction_demand, r.normal_force])


@functools.cache
def compiled(kind):
    """One program for all scenes of a kind: slopes in forward and in reverse mode, answers."""

    @jax.jit
    def both(x):
        values, push = jax.linearize(functools.partial(answers, kind), x)
        forward = jax.vmap(push, out_axes=-1)(jnp.eye(x.size))
        pull = jax.linear_transpose(push, x)
        return forward, jax.vmap(pull)(jnp.eye(values.size))[0], values

    return both


def slopes(kind, x):
    """Slopes and answers."""
    found = zip(*map(compiled(kind), x), strict=True)
    found, reverse, values = (np.array(part) for part in found)
    np.testing.assert_allclose(found, reverse, rtol=1e-12, atol=1e-12 * np.nanmax(abs(found)))
    # A block at rest does not begin like one that is a little tilted.
    found[:, :, ROTATION] *= (x[:, ROTATION] != 0)[:, None]
    return found, values


def theirs(kind, x):
    """The same answers, integrated in another way: scenes, answers."""
    rocker, ground, settle = parts(kind, x)
    r = stepping.follow(rocker, ground, settle, start=(x[:, ROTATION], 0.0))
    first = [times[0] if times.size else np.nan for times in r.impact_times]
    return np.stack([r.rotation, r.velocity, r.peak, r.margin, first], axis=1)


def parts(kind, x):
    """Of scenes: blocks, ground, and how long they are followed after its end."""
    half_width, slenderness, c, duration, _, start, length, *strength = x.T
    if kind == "Record":
        samples = np.stack(strength, axis=1)

        def value(motion, piece, time):
            left = samples[motion, piece]
            right = samples[motion, piece + 1]
            return left + time / length[motion] * (right - left), np.zeros_like(time)

        ground = stepping.Ground(length[:, None] * np.arange(samples.shape[1]), value)
    else:
        ground = stepping.pulse(kind, strength[0], length)
    rocker = stepping.Rocker(half_width, slenderness, c)
    return rocker, *stepping.within(ground, start, duration)


def one_sided(kind, x, side, part=1.5e-5):
    """Slopes to one side of each number, without what is there: scenes, answers, numbers."""
    steps = side * part * np.maximum(abs(x), 0.1)
    moves = steps[:, :, None, None] * np.eye(x.shape[1])[:, None] * np.arange(1, 4)[:, None]
    points = x[:, None, None] + moves
    there = theirs(kind, points.reshape(-1, x.shape[1])).reshape(*points.shape[:3], -1)
    found = np.einsum("k,snka->san", [-2.5, 4, -1.5], there) / steps[:, None]
    found[:, :, ROTATION] *= (x[:, ROTATION] != 0)[:, None]
    return found


def close(found, expected):
    return np.isclose(found[FINAL], expected[FINAL], rtol=3e-6, atol=3e-6)


TILTED = {"rotation": 0.05}
PLAIN = {
    "Record": {
        "duration on a sample": scene(0.1 + 4 * 0.15),
        "duration on a sample, rounded": scene(np.nextafter(0.1 + 5 * 0.15, 0)),
        "start at 0": scene(0.9, start=0.0),
        "start at 0 of a block that moves": scene(0.9, start=0.0, **TILTED),
        "duration at the end": scene(0.1 + LAST * 0.15),
        "duration at the end, rounded": scene(np.nextafter(0.1 + LAST * 0.15, 9)),
        "duration at the start": scene(0.1, **TILTED),
        "duration at the start, rounded": scene(np.nextafter(0.1, 0), **TILTED),
        "none of these": scene(0.95, start=0.12),
        "uplift at a sample": scene(0.9, strength=[0.0, 9.81 / 4, *SAMPLES[2:]]),
    },
    "Cosine": {
        "duration at the end": scene(0.5, 0.4, strength=5.0),
        "duration at the end, rounded": scene(np.nextafter(0.5, 0), 0.4, strength=5.0),
        "duration at the start": scene(0.1, 0.4, **TILTED, strength=5.0),
        "start at 0 of a block that moves": scene(0.9, 0.4, start=0.0, **TILTED, strength=5.0),
        "none of these, many impacts": scene(1.1, 0.4, start=0.12, strength=5.0),
    },
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", PLAIN)
def test_ends_starts_and_samples(kind):
    """Given is the slope for a later start and end of the input, and a shorter duration."""
    x = np.stack(list(PLAIN[kind].values()))
    expected = one_sided(kind, x, np.where(np.arange(x.shape[1]) == DURATION, -1, 1))
    found, _ = slopes(kind, x)
    for name, *pair in zip(PLAIN[kind], found, expected, strict=True):
        assert close(*pair).all(), (name, pair)


@pytest.mark.thorough
def test_times_within_rounding_of_a_sample():
    """A step that the block's own time ends there, and a duration a little later."""

    @functools.partial(jax.jit, static_argnums=3)
    def differentiate(block, step, duration, rtol):
        def end(step):
            record = jr.Record([0.0, 0.3, *SAMPLES, *[0.0] * 40], step)
            driven = jr.respond(
                block, 0.8, record, duration, rotation=0.1, rtol=rtol, max_impacts=0
            )
            return driven.final_velocity

        return jax.jvp(end, (step,), (jnp.ones_like(step),))[1]

    block = jr.Block.from_parameters(2.5, 0.2)
    first = 0.05 / block.frequency_parameter
    apart = 2.0**-52 * np.array([-2, 0, 1, 2, 4, 64])
    steps = [differentiate(block, first * (1 + k), 0.31, 1e-8) for k in apart]
    np.testing.assert_allclose(steps, steps[0], rtol=1e-7)
    durations = [differentiate(block, first, 5 * first * (1 + k), 1e-8) for k in apart]
    np.testing.assert_allclose(durations, durations[0], rtol=1e-7)


def with_impact(kind, x, toward, number):
    """The scene whose first impact is at the time `toward` the numbers, by one of them."""
    for _ in range(8):
        longer = x + (2 - x[DURATION]) * np.eye(x.size)[DURATION]
        found, values = slopes(kind, longer[None])
        slope = found[0, IMPACT] - toward
        gap = values[0, IMPACT] - toward @ x
        x = x - gap / slope[number] * np.eye(x.size)[number]
    assert abs(gap) < 1e-14
    return x, slope


def coincidences(kind):
    """Scenes with an impact at a corner, and how the time between the two changes."""
    if kind == "Record":
        length = 0.15
        end = LAST
        level = [1.5] * len(SAMPLES)
        x = scene(1.2)
        on_a_sample = 3 * np.eye(x.size)[LENGTH] + np.eye(x.size)[START]
        yield "a sample", *with_impact(kind, x, on_a_sample, LENGTH + 2)
        yield "the duration", *with_impact(kind, x, np.eye(x.size)[DURATION], DURATION)
        short = 0.03
    else:
        length = 0.4
        end = 1
        level = 5.0
        short = 0.2
    x = scene(0.9, length, **TILTED, strength=level)
    yield "the start", *with_impact(kind, x, np.eye(x.size)[START], START)
    x = scene(0.9, short, **TILTED, strength=level)
    at_the_end = np.eye(x.size)[START] + end * np.eye(x.size)[LENGTH]
    yield "the end", *with_impact(kind, x, at_the_end, START)


@pytest.mark.optimized
@pytest.mark.parametrize("kind", PLAIN)
def test_impacts_at_corners(kind):
    """The slopes are those of either order of the two, for all numbers the same one."""
    names, x, gaps = (list(part) for part in zip(*coincidences(kind), strict=True))
    x = np.stack(x)
    gaps = np.stack(gaps)
    # What the order does not depend on changes it no more than rounding does: a little apart.
    apart = 1e-9 * np.sign(gaps) * (np.arange(x.shape[1]) == START)
    sides = [(x + s * apart, np.where(s * gaps < 0, -1, 1)) for s in (1, -1)]
    both = np.split(one_sided(kind, *map(np.concatenate, zip(*sides, strict=True))), 2)
    for k, name in enumerate(names):
        orders = [order[k] for order in both]
        assert close(*orders).all() == (name == "a sample")
        # By rounding, the impact comes before it, after it or at the same time.
        near = np.stack([x[k]] * 5)
        near[:, START] *= 1 + 2.0**-52 * np.arange(-2, 3)
        for slope in slopes(kind, near)[0]:
            assert any(close(slope, order).all() for order in orders), (name, slope, orders)


@pytest.mark.thorough
def test_forces():
    """In a motion that ends with its input, and of equal ones at rest the first."""
    still = np.array([1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    x = np.stack([scene(0.1 + LAST * 0.15), scene(0.9, 0.125, 0.0, strength=still)])
    found, values = slopes("Record", x)
    expected = np.append(np.zeros(LENGTH + 1), (np.arange(still.size) == 0) / 9.81)
    np.testing.assert_allclose(found[1, FORCES], [expected, 0 * expected], rtol=1e-14)

    def theirs(x):
        rocker, ground, settle = parts("Record", x[None])
        rocker = rocker.of(0, 1)
        path = Trajectory(rocker, pieces_of(ground), float(settle[0]))
        return np.array([path.demand, path.normal])

    np.testing.assert_allclose(values[0, FORCES], theirs(x[0]), rtol=1e-8)
    for number in (0, LENGTH, LENGTH + 3, LENGTH + 5):
        step = 1e-4 * x[0, number] * (np.arange(x.shape[1]) == number)
        slope = (theirs(x[0] + step) - theirs(x[0] - step)) / (2 * step[number])
        np.testing.assert_allclose(found[0, FORCES, number], slope, rtol=1e-5, atol=1e-6)


def test_of_two_equal_numbers_the_first_is_picked():
    """With all of its derivative, in both modes; the largest along an axis likewise."""
    for pick in (pick_larger, pick_smaller):
        for differentiate in (jax.grad, jax.jacfwd):
            assert differentiate(lambda x, pick=pick: pick(x, 2 * x - 1))(1.0) == 1
    derivatives = jax.grad(pick_largest)(jnp.array([1.0, 3.0, 3.0]))
    np.testing.assert_array_equal(derivatives, [0, 1, 0])
