"""Driven motion against a wall: both integrators, an independent one, and the impact law."""

import csv

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tools.selection import first_before_release, first_by_default

import jaxrock as jr

FACADE = jr.Block.from_size(width=0.6, height=6.0, one_sided=True)
# Of the example suite, every other one with its vertical component.
RECORDS = list(jr.example_suite().names)
_NAMES = []  # of the programs that were compiled
BOUNCY = jr.Block(0.2, 4.0, one_sided=True)


def _hear(event, seconds, **details):
    if event == "/jax/core/compile/backend_compile_duration":
        _NAMES.append(details.get("fun_name", ""))


jax.monitoring.register_event_duration_secs_listener(_hear)


def table(shape):
    """Blocks and pulses of a shape, and what an independent integrator says of them."""
    with open(stepping.AGAINST_WALL, encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("shape") == shape]
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.float64
@pytest.mark.parametrize("shape", list(stepping.SHAPES))
def test_pulses_against_independent_integration(shape):
    """All 200 of a shape: barely lifted, bouncing at C = 0.4 to 0.5, pushed into the wall."""
    column = table(shape)
    block = jr.Block(column["half_width"], column["slenderness"], one_sided=True)
    pulse = getattr(jr.ground_motion, shape)(column["amplitude"], column["duration"])
    # The sign of a coefficient of restitution does not matter.
    restitution = column["restitution"] * np.resize([1, -1], len(column["restitution"]))
    response = jr.respond_batch(block, restitution, pulse, pulse.end + 3.0)
    overturned = column["overturned"] == 1
    peak = column["peak_rotation"]
    assert response.complete.all()
    assert 0 < overturned.sum() < 100
    assert (peak == 0).any() or shape not in ("Rectangular", "HalfSine", "Ricker")
    np.testing.assert_array_equal(response.overturned, overturned)
    stands = ~overturned
    np.testing.assert_allclose(response.peak_rotation[stands], peak[stands], rtol=1e-8)


@pytest.mark.float64
@pytest.mark.parametrize("shape", first_by_default(["Sine", "Ricker", "Rectangular"]))
def test_one_block_against_many_and_their_impacts(shape):
    column = table(shape)
    for k in range(0, 200, 20):
        half_width, slenderness, restitution, amplitude, duration, *expected = (
            float(column[name][k]) for name in column
        )
        block = jr.Block(half_width, slenderness, one_sided=True)
        pulse = getattr(jr.ground_motion, shape)(amplitude, duration)
        response = jr.respond(block, restitution, pulse, pulse.end + 3.0, rtol=1e-11)
        assert bool(response.overturned) == expected[1]
        assert stepping.count_strong(np.asarray(response.impact_velocities)) == expected[2]
        many = jr.respond_batch(block, restitution, pulse, pulse.end + 3.0)
        assert bool(many.overturned) == expected[1]
        if not expected[1]:
            peaks = [response.peak_rotation, many.peak_rotation]
            np.testing.assert_allclose(peaks, expected[0], rtol=1e-7)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("name", first_before_release(RECORDS, 3))
def test_records_against_independent_integration(name):
    """Of both directions, at a PGV of 0.9 m/s, where about half of them overturn."""
    vertical = RECORDS.index(name) % 2 == 0
    record = jr.example_suite(vertical=vertical)[name]
    factor = 0.9 / float(jr.Suite([record]).measure("pgv")[0])
    scale = np.array([factor, -factor])
    # In the other direction the vertical component is what it was.
    up = np.zeros(record.samples) if record.vertical is None else np.asarray(record.vertical)
    restitution = float(jr.one_sided_restitution(FACADE))
    rocker = stepping.Rocker(0.3, 10.0, -restitution, one_sided=True)
    for sign, horizontal in ((1, record.acceleration), (-1, -record.acceleration)):
        motion = jr.Record(
            horizontal, record.time_step, up if vertical else None, scale=factor
        )
        ground = stepping.record(np.asarray(horizontal), up, float(record.time_step), scale[0])
        truth = stepping.follow(rocker, ground, rtol=1e-12)
        many = jr.respond_batch(FACADE, restitution, motion)
        response = jr.respond(FACADE, restitution, motion, rtol=1e-12)
        assert bool(many.overturned) == bool(response.overturned) == truth.overturned[0], sign
        strong = stepping.count_strong(truth.impact_velocities[0])
        assert stepping.count_strong(np.asarray(response.impact_velocities)) == strong
        assert strong > 1
        if not truth.overturned[0]:
            peaks = [response.peak_rotation, many.peak_rotation]
            np.testing.assert_allclose(peaks, truth.peak[0], rtol=1e-7)


def test_what_pushes_into_the_wall_moves_nothing():
    """A sine that begins towards the wall does what its second half does alone."""
    towards = jr.Sine(-6.0, 0.6)
    alone = jr.HalfSine(6.0, 0.3).shifted(0.3)
    for motion, same in (
        (towards, alone),
        (jr.HalfSine(-6.0, 0.3), jr.Record([0.0, 0.0], 0.01)),
    ):
        response = jr.respond(BOUNCY, -0.4, motion, 3.0)
        expected = jr.respond(BOUNCY, -0.4, same, 3.0)
        many = jr.respond_batch(BOUNCY, -0.4, motion, 3.0)
        np.testing.assert_allclose(response.peak_rotation, expected.peak_rotation, rtol=1e-5)
        np.testing.assert_allclose(many.peak_rotation, expected.peak_rotation, rtol=1e-5)
    assert int(response.impacts) == int(many.impacts) == float(response.peak_rotation) == 0
    # What pushes into the wall, the wall carries; but for the rounding of its end.
    assert float(response.friction_demand) < 1e-6
    away = jr.respond(BOUNCY, 0.4, jr.HalfSine(1.0, 0.3), 3.0)
    np.testing.assert_allclose(away.friction_demand, 1 / 9.81, rtol=1e-5)


def test_velocity_is_reversed_and_the_side_stays():
    response = jr.respond(BOUNCY, -0.5, jr.Record([0.0, 0.0], 0.01), 4.0, rotation=0.15)
    times = np.linspace(0, 4, 401)
    rotation, _ = response.history(times)
    assert np.min(rotation) >= 0
    assert np.max(rotation[times > float(response.impact_times[0])]) > 0.01
    # All impacts come from the same side, each with half the velocity of the one before.
    speeds = np.asarray(response.impact_velocities)[:8]
    np.testing.assert_allclose(speeds[1:] / speeds[:-1], 0.5, rtol=1e-4)
    # Each flight takes as long as that of a free-standing block.
    free = jr.respond(jr.Block(0.2, 4.0), 0.5, jr.Record([0.0, 0.0], 0.01), 4.0, rotation=0.15)
    np.testing.assert_allclose(response.impact_times[:8], free.impact_times[:8], rtol=1e-5)
    np.testing.assert_allclose(response.margin, free.margin, rtol=1e-5)
    margin = jr.driven.free_motion_margin(BOUNCY, -0.5, 0.0, -0.1)
    np.testing.assert_allclose(
        margin, jr.driven.free_motion_margin(jr.Block(0.2, 4.0), 0.5, 0.0, 0.05), rtol=1e-5
    )


@pytest.mark.parametrize(
    ("rotation", "velocity"),
    [(0.0, -0.1), pytest.param(-0.1, 0.0, marks=pytest.mark.thorough)],
)
def test_no_state_is_behind_the_wall(rotation, velocity):
    with pytest.raises(ValueError, match="rotation of a one-sided block must be"):
        jr.respond(
            BOUNCY, 0.4, jr.Record([0.0, 0.0], 0.01), 1.0, rotation=rotation, velocity=velocity
        )
    pulse = jr.Sine(4.0, 0.5)
    with pytest.raises(ValueError, match="rotation of a one-sided block must be"):
        jr.respond_batch(BOUNCY, 0.4, pulse, rotation=rotation, velocity=velocity)

    def respond(function, rotation, velocity):
        return function(BOUNCY, 0.4, pulse, rotation=rotation, velocity=velocity)

    for function in (jr.respond, jr.respond_batch):
        answer = jax.jit(respond, static_argnums=0)(function, rotation, velocity)
        assert int(answer.status) == jr.Status.INVALID
        assert np.isnan(answer.peak_rotation)


def twice_pushed(half_width, slenderness, restitution, scale):
    """A block that is pushed again after an impact, and then rises highest."""
    block = jr.Block(half_width, slenderness, one_sided=True)
    samples = np.array([0.0, 5.0, 5.0, -5.0, -4.0, 4.0, 4.0, 2.0, 0.0])
    return block, restitution, jr.Record(samples, 0.1, scale=scale)


def answers(function):
    """The answers whose derivatives are taken, as functions of an array."""

    def peak(numbers):
        return function(*twice_pushed(*numbers), 3.0).peak_rotation

    def margin(numbers):
        return function(*twice_pushed(*numbers)).margin

    return peak, margin


def differentiate(function, at, step=1e-5):
    """Fourth-order central differences."""

    def change(k, by):
        moved = at.copy()
        moved[k] *= 1 + by * step
        return float(function(moved))

    return [
        (8 * (change(k, 1) - change(k, -1)) - (change(k, 2) - change(k, -2)))
        / (12 * step * at[k])
        for k in range(len(at))
    ]


@pytest.mark.thorough
@pytest.mark.float64
def test_derivatives_of_peaks_and_margins():
    at = np.array([0.2, 4.0, -0.45, 0.9])

    def respond(block, restitution, motion, duration=None):
        return jr.respond(block, restitution, motion, duration, rtol=1e-12)

    def respond_many(block, restitution, motion, duration=None):
        return jr.respond_batch(block, restitution, motion, duration, rtol=1e-12)

    for function in (respond, respond_many):
        for answer in answers(function):
            forward = jax.jacfwd(answer)(jnp.asarray(at))
            assert (abs(forward) > 1e-4).all()
            np.testing.assert_allclose(forward, differentiate(answer, at), rtol=1e-6)
            if function is respond:
                reverse = jax.jacrev(answer)(jnp.asarray(at))
                np.testing.assert_allclose(reverse, forward, rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.float64
def test_derivatives_of_boundaries():
    """Of the first amplitude that overturns, after an impact, in both modes."""

    def amplitude(numbers):
        block = jr.Block(numbers[0], numbers[1], one_sided=True)
        boundaries = jr.critical_amplitude(
            block, numbers[2], jr.Cosine, 0.7, ratios=(1.5, 6.0), max_boundaries=4
        )
        return boundaries.value[0]

    at = np.array([0.2, 4.0, -0.45])
    forward = jax.jacfwd(amplitude)(jnp.asarray(at))
    reverse = jax.jacrev(amplitude)(jnp.asarray(at))
    np.testing.assert_allclose(forward, differentiate(amplitude, at), rtol=1e-6)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    block = jr.Block(0.2, 4.0, one_sided=True)
    outcomes = jr.respond_batch(
        block, 0.45, jr.Cosine(float(amplitude(at)) * np.array([1 - 1e-6, 1 + 1e-6]), 0.7)
    )
    np.testing.assert_array_equal(outcomes.overturned, [False, True])


def test_the_push_that_lifts_is_the_one_away_from_the_wall():
    record = jr.Record([0.0, -3.0, 1.5, 0.0], 0.1)
    uplift = 9.81 / 4.0
    away = jr.overturning.uplift_factor(BOUNCY, record)
    towards = jr.overturning.uplift_factor(BOUNCY, record.scaled(-1.0))
    np.testing.assert_allclose([away, towards], [uplift / 1.5, uplift / 3.0], rtol=1e-6)
    for motion, factor in ((record, away), (record.scaled(-1.0), towards)):
        scales = motion.scaled(float(factor) * np.array([0.99, 1.01]))
        lifted = jr.respond_batch(BOUNCY, 0.4, scales).peak_rotation > 0
        np.testing.assert_array_equal(lifted, [False, True])
    with pytest.raises(ValueError, match="motion must lift"):
        jr.overturning.critical_factor(BOUNCY, 0.4, jr.HalfSine(-1.0, 0.3))


def test_one_program_of_the_batch_more():
    """For records; whatever else is asked of blocks against a wall, or of free-standing ones."""
    record = jr.Record([0.0, 4.0, -5.0, 3.0, 0.0], 0.15)
    free = jr.Block(0.2, 4.0)
    jr.respond_batch(free, 0.4, record)
    jr.respond_batch(BOUNCY, 0.4, record)
    _NAMES.clear()
    jr.respond_batch(jr.Block(np.array([0.2, 0.3]), 5.0, one_sided=True), -0.3, record)
    jr.respond_within(BOUNCY, 0.4, record, 1e-3)
    jr.overturning_boundaries(BOUNCY, 0.4, record, "factor", np.array([0.5, 1.0, 2.0]))
    jr.respond_batch(free, 0.5, record.scaled(-1.0))
    assert not any("follow_rows" in name for name in _NAMES)


def test_ground_that_falls_away_lifts_to_the_side_without_the_wall():
    """Faster than g, while it pushes into the wall: both sides of a free block would be lifted."""
    horizontal = np.array([0.0, -1.0, -1.0, 3.0, 0.0])
    vertical = np.array([0.0, -16.0, -16.0, 0.0, 0.0])
    record = jr.Record(horizontal, 0.1, vertical)
    response = jr.respond(BOUNCY, 0.4, record, 1.0)
    many = jr.respond_batch(BOUNCY, 0.4, record, 1.0)
    rotation, _ = response.history(np.linspace(0, 1, 101))
    assert float(response.peak_rotation) > 1e-3
    assert np.min(rotation) >= 0
    np.testing.assert_allclose(many.peak_rotation, response.peak_rotation, rtol=1e-4)
    np.testing.assert_allclose(many.final_rotation, response.final_rotation, atol=1e-5)
