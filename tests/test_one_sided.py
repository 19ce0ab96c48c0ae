"""Blocks against a wall: the impact law, closed forms, driven motion, and what rests on them."""

import csv

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from references.trains import follow_train
from tools.selection import first_before_release, first_by_default, some_by_default

import jaxrock as jr

pytestmark = pytest.mark.float64
FACADE = jr.Block.from_size(width=0.6, height=6.0, one_sided=True)
WALL = jr.Block(0.4, 5.0, one_sided=True)
FREE = jr.Block(0.4, 5.0)
BOUNCY = jr.Block(0.2, 4.0, one_sided=True)
SLENDER = jr.Block(0.1, 5.0, one_sided=True)
C = -0.47
MODELS = ("linearized", "nonlinear")
# Of the example suite, every other one with its vertical component.
RECORDS = list(jr.example_suite().names)


# The impact law and the half-cycle map


def conserve_momentum(velocity, pole, next_pole, centre, inertia):
    """Angular velocity about the next pole, with the angular momentum about it from before."""
    arm = np.subtract(centre, pole)
    next_arm = np.subtract(centre, next_pole)
    linear = velocity * np.array([-arm[1], arm[0]])
    momentum = inertia * velocity + next_arm[0] * linear[1] - next_arm[1] * linear[0]
    return momentum / (inertia + next_arm @ next_arm)


@pytest.mark.parametrize("kappa", [4 / 3, 1.7])
@pytest.mark.parametrize("slenderness", [1.5, 10.0])
def test_restitution_conserves_angular_momentum(kappa, slenderness):
    """Of three impacts: the back edge of the base, the wall, the front edge of the base.

    Mass 1. The wall meets the back of the block twice as high as its centre of mass. After it,
    the block turns about the back edge again, with the velocity that the wall has left.
    """
    b = 0.3
    a = slenderness * b
    centre = (0.0, a)
    inertia = (kappa - 1) * (a**2 + b**2)
    front = (b, 0.0)
    back = (-b, 0.0)
    velocity = conserve_momentum(1.0, front, back, centre, inertia)
    velocity = conserve_momentum(velocity, back, (-b, 2 * a), centre, inertia)
    velocity = conserve_momentum(velocity, back, front, centre, inertia)
    block = jr.Block(b, slenderness, 9.81, kappa, one_sided=True)
    assert float(jr.one_sided_restitution(block)) == pytest.approx(velocity, rel=1e-12)


RANGES = {"restitution": (0.4, 0.5), "width": (0.7, 0.9)}
UNCERTAIN = jr.Uncertain({"restitution": 0.05, "width": 0.05}, samples=64)
period = jr.stabilized_period


def take_spectrum(scene, model):
    """A spectrum of one point."""
    axes = 5.0, 0.8, np.reshape(scene.restitution, 1), 0.3
    return jr.resonance_spectrum(*axes, model=model, one_sided=scene.block.one_sided)


# Answers that a block against a wall and a free-standing one have alike, with the same C.
ALIKE = {
    "ratio": lambda scene, model: jr.rotation_ratio(scene, model),
    "margin": lambda scene, model: jr.overturning_margin(scene, model),
    "amplification": lambda scene, model: jr.amplification(scene, model),
    "half-cycle": lambda scene, model: jr.overturning_half_cycle(scene, model),
    "velocities": lambda scene, _: jnp.stack(
        [jr.half_cycle_velocity(scene, 3.0), jr.resonance.next_velocity(scene, 3.0)]
    ),
    "intensity": lambda scene, model: jr.critical_intensity(
        scene.block, scene.restitution, 5.0, model
    ),
    "width": lambda scene, model: jr.critical_width(
        scene.block, scene.restitution, 0.3, model=model
    ),
    "slenderness": lambda scene, model: jr.critical_slenderness(
        scene.block, scene.restitution, 0.3, model=model
    ),
}
# And those of which they have half: of the period, by every tool.
HALF = {
    "period": period,
    "derivative": lambda scene, _: jr.sensitivities(period, scene).value,
    "one-sided": lambda scene, _: jr.value_and_slopes(period)(scene)[1].intensity,
    "tornado": lambda scene, _: jr.tornado(period, scene, RANGES).at_high,
    "moments": lambda scene, _: jr.sensitivity.propagate(period, scene, UNCERTAIN).mean,
    "spectrum": lambda scene, model: take_spectrum(scene, model).stabilized_period,
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", some_by_default(ALIKE | HALF, {"ratio", "period"}))
def test_closed_forms_are_those_of_a_free_block(name, model):
    """But the period, which is half; whatever the sign of C."""
    ask = (ALIKE | HALF)[name]
    expected = np.asarray(ask(jr.Scene(FREE, 0.47, 0.3), model)) * (0.5 if name in HALF else 1)
    wall = ask(jr.Scene(WALL, C, 0.3), model)
    np.testing.assert_allclose(wall, expected, rtol=1e-12)
    if name in ALIKE:
        np.testing.assert_array_equal(ask(jr.Scene(WALL, 0.47, 0.3), model), wall)


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


@pytest.mark.parametrize("model", first_by_default(MODELS))
@pytest.mark.parametrize("answer", first_by_default(["intensity", "ratio", "margin"]))
def test_derivatives_against_differences(answer, model):
    point = np.array([0.4, 5.0, C])

    def compute(at):
        return ALIKE[answer](jr.Scene(jr.Block(*at[:2], one_sided=True), at[2], 0.3), model)

    expected = differentiate(compute, point, 1e-4)
    for derive in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derive(compute)(jnp.asarray(point)), expected, rtol=1e-6)
        # The other sign of C mirrors its derivative alone.
        mirrored = derive(compute)(jnp.asarray(point * [1, 1, -1]))
        np.testing.assert_allclose(mirrored, expected * np.array([1, 1, -1]), rtol=1e-6)
        # At 0, that with respect to the magnitude.
        at_zero = derive(compute)(jnp.asarray(point * [1, 1, 0]))[2]
        step = 1e-6
        three = [float(compute(jnp.asarray([0.4, 5.0, k * step]))) for k in range(3)]
        forward = (-3 * three[0] + 4 * three[1] - three[2]) / (2 * step)
        np.testing.assert_allclose(at_zero, forward, rtol=1e-6)


# Trains of pulses, and pulses of finite duration

TRAINS = {
    "away": ([0.0, 0.9, 1.7], [0.25, 0.2, 0.3]),
    "towards the wall at rest, then away": ([0.1, 0.5, 0.7], [-0.5, 0.2, 0.1]),
    "slowed on the way up": ([0.0, 0.05], [0.3, -0.1]),
    "reversed on the way up": ([0.0, 0.05, 0.5], [0.3, -0.4, 0.1]),
    "sped up on the way down": ([0.0, 0.3, 1.0], [0.3, -0.2, -0.1]),
    "caught on the way down": ([0.0, 0.3], [0.3, 0.15]),
}


@pytest.mark.parametrize(
    "name", some_by_default(TRAINS, {"towards the wall at rest, then away"})
)
def test_trains_against_independent_integration(name):
    times, intensities = TRAINS[name]
    until = np.linspace(0.0, 2.5, 21)
    rocker = stepping.Rocker(0.4, 5.0, 0.6, one_sided=True)
    expected = follow_train(rocker, times, intensities, until)
    train = jr.respond_to_train(WALL, -0.6, times, intensities, "nonlinear")
    assert expected.peak > 1e-3
    np.testing.assert_allclose(train.history(until)[0], expected.rotation, atol=1e-9)
    assert not train.overturned
    assert set(np.asarray(train.side).tolist()) <= {0.0, 1.0}


@pytest.mark.thorough
def test_pulses_of_finite_duration():
    """The stabilized phase is a fixed point: half of a free-standing block's period."""
    pulse = jr.HalfSine(15 * np.pi, 0.01)
    phase = jr.steady.pulsed_phase(WALL, C, pulse)
    free = jr.steady.pulsed_phase(FREE, -C, pulse)
    assert phase.from_rest
    assert float(phase.period) == pytest.approx(0.5 * float(free.period), rel=1e-12)
    # The same motion through the wall: from one return to the next.
    launch = -C * phase.velocity
    response = jr.respond(WALL, C, pulse, float(phase.period) + 1e-3, velocity=launch)
    assert float(response.impact_times[0]) == pytest.approx(float(phase.period), rel=1e-7)
    landing = abs(float(response.impact_velocities[0]))
    assert landing == pytest.approx(float(phase.velocity), rel=1e-7)
    # Towards the wall no pulse lifts it.
    assert jr.steady.pulsed_phase(WALL, C, jr.HalfSine(-15 * np.pi, 0.01)).settles
    expected = float(jr.critical_intensity(WALL, C, np.inf, "nonlinear"))
    errors = [
        float(jr.steady.critical_pulsed_amplitude(WALL, C, jr.HalfSine, d).intensity)
        - expected
        for d in (4e-3, 2e-3)
    ]
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.02)


# Driven motion


def table(shape):
    """Blocks and pulses of a shape, and what an independent integrator says of them."""
    with open(stepping.AGAINST_WALL, encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("shape") == shape]
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("shape", first_by_default(stepping.SHAPES, 3))
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


@pytest.mark.parametrize("shape", first_by_default(["Sine", "Ricker", "Rectangular"]))
def test_one_block_and_its_impacts(shape):
    column = table(shape)
    for k in range(0, 200, 20):
        b, slenderness, c, amplitude, duration, peak, overturned, impacts = (
            float(values[k]) for values in column.values()
        )
        block = jr.Block(b, slenderness, one_sided=True)
        pulse = getattr(jr.ground_motion, shape)(amplitude, duration)
        response = jr.respond(block, c, pulse, pulse.end + 3.0, rtol=1e-11)
        assert bool(response.overturned) == overturned
        assert stepping.count_strong(np.asarray(response.impact_velocities)) == impacts
        if not overturned:
            np.testing.assert_allclose(response.peak_rotation, peak, rtol=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("name", first_before_release(RECORDS, 3))
def test_records_against_independent_integration(name):
    """Of both directions, at a PGV of 0.9 m/s, where about half of them overturn."""
    given = jr.example_suite(vertical=RECORDS.index(name) % 2 == 0)[name]
    factor = 0.9 / float(jr.Suite([given]).measure("pgv")[0])
    # In the other direction the vertical component is what it was.
    up = 0.0 if given.vertical is None else np.asarray(given.vertical)
    restitution = float(jr.one_sided_restitution(FACADE))
    rocker = stepping.Rocker(0.3, 10.0, -restitution, one_sided=True)
    for sign in (1, -1):
        horizontal = sign * np.asarray(given.acceleration)
        motion = jr.Record(horizontal, given.time_step, given.vertical, scale=factor)
        ground = stepping.record(horizontal, up, float(given.time_step), factor)
        truth = stepping.follow(rocker, ground, rtol=1e-12)
        many = jr.respond_batch(FACADE, restitution, motion)
        response = jr.respond(FACADE, restitution, motion, rtol=1e-12)
        assert bool(many.overturned) == bool(response.overturned) == truth.overturned[0], sign
        strong = stepping.count_strong(truth.impact_velocities[0])
        assert stepping.count_strong(np.asarray(response.impact_velocities)) == strong > 1
        if not truth.overturned[0]:
            peaks = [response.peak_rotation, many.peak_rotation]
            np.testing.assert_allclose(peaks, truth.peak[0], rtol=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("function", [jr.respond, jr.respond_batch])
def test_no_state_is_behind_the_wall(function):
    def respond(rotation, velocity):
        return function(BOUNCY, 0.4, jr.Sine(4.0, 0.5), rotation=rotation, velocity=velocity)

    for state in ((0.0, -0.1), (-0.1, 0.0)):
        with pytest.raises(ValueError, match="rotation of a one-sided block must be"):
            respond(*state)
        answer = jax.jit(respond)(*state)
        assert int(answer.status) == jr.Status.INVALID
        assert np.isnan(answer.peak_rotation)


@pytest.mark.thorough
@pytest.mark.parametrize("function", [jr.respond, jr.respond_batch])
@pytest.mark.parametrize("answer", ["peak_rotation", "margin"])
def test_derivatives_of_driven_motion(function, answer):
    """Of a block that is pushed again after an impact, and then rises highest."""
    samples = np.array([0.0, 5.0, 5.0, -5.0, -4.0, 4.0, 4.0, 2.0, 0.0])
    duration = 3.0 if answer == "peak_rotation" else None

    def compute(at):
        block = jr.Block(at[0], at[1], one_sided=True)
        motion = jr.Record(samples, 0.1, scale=at[3])
        return getattr(function(block, at[2], motion, duration, rtol=1e-12), answer)

    at = np.array([0.2, 4.0, -0.45, 0.9])
    forward = jax.jacfwd(compute)(jnp.asarray(at))
    assert (abs(forward) > 1e-4).all()
    np.testing.assert_allclose(forward, differentiate(compute, at), rtol=1e-6)
    np.testing.assert_allclose(jax.jacrev(compute)(jnp.asarray(at)), forward, rtol=1e-9)


def test_ground_that_falls_away_lifts_to_the_side_without_the_wall():
    """Faster than g, while it pushes into the wall: both sides of a free block would be lifted."""
    horizontal = np.array([0.0, -1.0, -1.0, 3.0, 0.0])
    vertical = np.array([0.0, -16.0, -16.0, 0.0, 0.0])
    motion = jr.Record(horizontal, 0.1, vertical)
    ground = stepping.record(horizontal, vertical, 0.1)
    truth = stepping.follow(stepping.Rocker(0.2, 4.0, 0.4, one_sided=True), ground, 0.6)
    many = jr.respond_batch(BOUNCY, 0.4, motion, 1.0)
    assert truth.peak[0] > 1e-3
    np.testing.assert_allclose(many.peak_rotation, truth.peak[0], rtol=1e-8)
    np.testing.assert_allclose(many.final_rotation, truth.rotation[0], rtol=1e-6, atol=1e-9)


# What rests on driven motion


def overturns(block, restitution, motion):
    return np.asarray(jr.respond_batch(block, restitution, motion).overturned)


def test_boundaries_along_every_quantity():
    """Of a pulse whose second half pushes away from the wall, and meets a block at rest."""
    pulse = jr.Sine(-1.0, 0.5)
    factors = np.geomspace(2.0, 30.0, 300)
    boundaries = jr.overturning_boundaries(SLENDER, C, pulse, "factor", factors)
    free = jr.overturning_boundaries(jr.Block(0.1, 5.0), -C, pulse, "factor", factors)
    first = float(boundaries.value[0])
    assert first < 0.7 * float(free.value[0])
    sides = pulse.scaled(first * np.array([1 - 1e-6, 1 + 1e-6]))
    np.testing.assert_array_equal(overturns(SLENDER, C, sides), [0, 1])
    for along, value in {
        "width": 0.2, "height": 1.0, "slenderness": 5.0, "amplitude": -first, "duration": 0.5
    }.items():  # fmt: skip
        ends = sorted([0.97 * value, 1.03 * value])
        boundary = jr.overturning_boundaries(SLENDER, C, pulse.scaled(first), along, ends)
        assert boundary.value.item() == pytest.approx(value, rel=1e-7), along


def test_uplift_is_away_from_the_wall():
    ramp = jr.Record([0.0, -3.0, 0.0, 2.0, 0.0], 0.1, [0.0, 0.0, 0.0, -1.0, 0.0])
    uplift = 9.81 / 4.0
    away, towards = (
        jr.overturning.uplift_factor(BOUNCY, motion) for motion in (ramp, ramp.scaled(-1.0))
    )
    np.testing.assert_allclose([away, towards], [uplift / 2.25, uplift / 3.0], rtol=1e-6)
    scales = ramp.scaled(float(away) * np.array([0.99, 1.01]))
    lifted = jr.respond_batch(BOUNCY, 0.4, scales).peak_rotation > 0
    np.testing.assert_array_equal(lifted, [False, True])
    assert jr.overturning.uplift_factor(BOUNCY, jr.HalfSine(-1.0, 0.3)) == np.inf
