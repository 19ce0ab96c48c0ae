"""Blocks against a wall in closed forms, trains, spectra, fits and sensitivities.

Driven motion against a wall is in test_one_sided_motion.py.
"""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxrock as jr

pytestmark = pytest.mark.float64
FACADE = jr.Block.from_size(width=0.6, height=6.0, one_sided=True)
WALL = jr.Block(0.4, 5.0, one_sided=True)
FREE = jr.Block(0.4, 5.0)
C = -0.47
MODELS = ("linearized", "nonlinear")


# The restitution by the size


def conserve_momentum(velocity, pole, next_pole, centre, inertia):
    """Angular velocity about the next pole, with the angular momentum about it from before."""
    arm = np.subtract(centre, pole)
    next_arm = np.subtract(centre, next_pole)
    linear = velocity * np.array([-arm[1], arm[0]])
    momentum = inertia * velocity + next_arm[0] * linear[1] - next_arm[1] * linear[0]
    return momentum / (inertia + next_arm @ next_arm)


@pytest.mark.parametrize("kappa", [4 / 3, 1.0, 1.2, 1.7])
@pytest.mark.parametrize("slenderness", [1.5, 3.0, 10.0])
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


def test_restitution_of_a_facade():
    """As published for a wall 0.6 m thick and 6 m high: about -0.47."""
    assert round(float(jr.one_sided_restitution(FACADE)), 2) == -0.47


# The half-cycle map


def rock_under_pulses(block, restitution, intensity, duration, count):
    """Integrate rectangular pulses all one way, each from an impact on; the last peak."""
    pulse = jr.Rectangular(intensity / duration, duration)
    launch = 0.0
    peak = 0.0
    for _ in range(count):
        response = jr.respond(block, restitution, pulse, 3.0, velocity=launch, rtol=1e-12)
        peak = float(response.peak_rotation)
        # The wall throws the block back to the side from which it came.
        launch = abs(restitution * float(response.impact_velocities[0]))
        rotation, velocity = response.history(response.impact_times[:1] + 1e-7)
        assert rotation[0] > 0
        assert float(velocity[0]) == pytest.approx(launch, rel=1e-5)
    return peak


def test_half_cycle_map_against_simulation():
    """The difference falls in proportion to the duration; two durations extrapolate it to 0."""
    scene = jr.Scene(WALL, C, 0.3)
    expected = float(jr.stabilized_rotation(scene, jr.Nonlinear()))
    peaks = [rock_under_pulses(WALL, C, 0.3, duration, 26) for duration in (4e-3, 2e-3, 1e-3)]
    errors = np.array(peaks) / expected - 1
    np.testing.assert_allclose(errors[:-1] / errors[1:], 2, rtol=0.02)
    first = 2 * np.array(peaks[1:]) - peaks[:-1]
    assert (4 * first[1] - first[0]) / 3 == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_only_the_period_differs(model):
    """Of the answers of the half-cycle map: it is half of that of a free-standing block."""
    free = jr.Scene(FREE, 0.47, 0.3)
    for restitution in (C, 0.47):
        wall = jr.Scene(WALL, restitution, 0.3)
        for function in (
            jr.rotation_ratio,
            jr.stabilized_rotation,
            jr.amplification,
            jr.overturning_margin,
            jr.overturning_half_cycle,
        ):
            np.testing.assert_array_equal(function(wall, model), function(free, model))
        half = 0.5 * jr.stabilized_period(free, model)
        np.testing.assert_array_equal(jr.stabilized_period(wall, model), half)
        for function in (jr.launch_velocity, jr.stabilized_velocity):
            np.testing.assert_array_equal(function(wall), function(free))
        for function in (jr.half_cycle_velocity, jr.next_velocity):
            np.testing.assert_array_equal(function(wall, 3.0), function(free, 3.0))
        for function, extra in (
            (jr.critical_intensity, ()),
            (jr.critical_width, (0.3,)),
            (jr.critical_slenderness, (0.3,)),
        ):
            expected = function(FREE, 0.47, *extra, model=model)
            found = function(WALL, restitution, *extra, model=model)
            np.testing.assert_array_equal(found, expected)
    critical = jr.critical_intensity(WALL, C, 5.0, model)
    assert float(jr.critical_restitution(WALL, critical, 5.0, model)) == pytest.approx(0.47)


def take_difference(function, point, place):
    """The central difference of a function along one parameter."""
    step = 1e-4 * abs(point[place]) * np.eye(len(point))[place]
    ends = [float(function(jnp.asarray(point + sign * step))) for sign in (1, -1)]
    return (ends[0] - ends[1]) / (2 * step[place])


ANSWERS = {
    "ratio": lambda block, c, model: jr.rotation_ratio(jr.Scene(block, c, 0.3), model),
    "period": lambda block, c, model: jr.stabilized_period(jr.Scene(block, c, 0.3), model),
    "margin": lambda block, c, model: jr.overturning_margin(jr.Scene(block, c, 0.3), model),
    "intensity": lambda block, c, model: jr.critical_intensity(block, c, 4.0, model),
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("answer", list(ANSWERS))
def test_derivatives_against_differences(answer, model):
    point = np.array([0.4, 5.0, C])

    def compute(at):
        return ANSWERS[answer](jr.Block(at[0], at[1], one_sided=True), at[2], model)

    expected = [take_difference(compute, point, k) for k in range(3)]
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


def test_transformations_keep_the_wall():
    scene = jr.Scene(WALL, C, 0.3)
    mapped = jax.tree.map(lambda leaf: leaf + 0.0, scene)
    leaves, form = jax.tree.flatten(scene)
    moved = eqx.tree_at(lambda s: s.intensity, scene, jnp.asarray(0.3))
    for other in (
        mapped,
        jax.tree.unflatten(form, leaves),
        moved,
        jax.jit(lambda s: s)(scene),
    ):
        assert other.block.one_sided
    assert jax.tree.structure(scene) != jax.tree.structure(jr.Scene(FREE, 0.47, 0.3))
    many = jax.vmap(lambda i: jr.stabilized_period(jr.Scene(WALL, C, i)))(
        jnp.array([0.2, 0.3])
    )
    np.testing.assert_array_equal(many[1], jr.stabilized_period(scene))


# Trains of pulses


def rock_by_scipy(block, restitution, times, intensities, until):
    """Follow a block against a wall by SciPy, flight by flight: rotations at some times."""
    angle = np.arctan(1 / float(block.slenderness))
    radius = float(block.half_width) / np.sin(angle)
    inertia = radius * float(block.inertia_ratio)  # over the mass and the radius
    rotations = np.zeros(until.size)

    def fall(_, state):
        return [state[1], -9.81 / inertia * np.sin(angle - state[0])]

    def touch(_, state):
        return state[0]

    touch.terminal = True
    touch.direction = -1
    state = np.zeros(2)
    for begin, end, intensity in zip(times, [*times[1:], until[-1]], intensities, strict=True):
        push = intensity * np.cos(angle - state[0]) / inertia
        # What rests against the wall is not pushed into it.
        state[1] += push if state.any() else max(push, 0)
        time = begin
        while time < end and state.any():
            if state[0] == 0:
                speed = abs(restitution * state[1]) if state[1] < 0 else state[1]
                state = np.array([0, speed if speed > 1e-7 else 0])
            # A step so short that the block is in the air behind it, at least.
            first = min(
                max(0.1 * abs(state[1]) / (9.81 / inertia * np.sin(angle)), 1e-9), end - time
            )
            flight = solve_ivp(
                fall,
                (time, end),
                state,
                "DOP853",
                first_step=first,
                rtol=1e-12,
                atol=1e-15,
                events=touch,
                dense_output=True,
            )
            inside = (until >= time) & (until <= flight.t[-1])
            if inside.any():
                rotations[inside] = flight.sol(until[inside])[0]
            time = flight.t[-1]
            state = flight.y[:, -1] * [flight.status == 0, 1]
    return rotations


TRAINS = {
    "away": ([0.0, 0.9, 1.7], [0.25, 0.2, 0.3]),
    "towards the wall at rest, then away": ([0.1, 0.5, 0.7], [-0.5, 0.2, 0.1]),
    "slowed on the way up": ([0.0, 0.05], [0.3, -0.1]),
    "reversed on the way up": ([0.0, 0.05, 0.5], [0.3, -0.4, 0.1]),
    "sped up on the way down": ([0.0, 0.3, 1.0], [0.3, -0.2, -0.1]),
    "caught on the way down": ([0.0, 0.3], [0.3, 0.15]),
}


@pytest.mark.parametrize("name", list(TRAINS))
def test_trains_against_independent_integration(name):
    times, intensities = TRAINS[name]
    until = np.linspace(0.0, 2.5, 101)
    expected = rock_by_scipy(WALL, -0.6, times, intensities, until)
    train = jr.respond_to_train(WALL, -0.6, times, intensities, "nonlinear")
    rotation, _ = train.history(until)
    assert expected.max() > 1e-3
    np.testing.assert_allclose(rotation, expected, atol=1e-9)
    assert not train.overturned
    assert set(np.asarray(train.side).tolist()) <= {0.0, 1.0}


@pytest.mark.parametrize("model", MODELS)
def test_resonance_as_a_train(model):
    """The paper's input, all one way and timed at the returns, is the half-cycle map."""
    scene = jr.Scene(WALL, C, 0.3)
    launches = np.asarray(jr.half_cycle_velocity(scene, np.arange(1.0, 7.0)))
    durations = np.asarray(jr.resonance.as_model(model).half_cycle_duration(WALL, launches))
    times = np.append(0, np.cumsum(durations[:-1]) + 1e-12)
    train = jr.respond_to_train(WALL, C, times, np.full(6, 0.3), model)
    critical = float(jr.resonance.as_model(model).critical_velocity(WALL))
    np.testing.assert_allclose(train.velocity_ratio, launches / critical, rtol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_worst_trains_push_away_from_the_wall(model):
    worst = jr.worst_train(WALL, C, 3, model=model, starts=4)
    assert worst.status == jr.Status.COMPLETE
    assert (worst.intensities > 0).all()
    expected = float(jr.critical_intensity(WALL, C, 3.0, model))
    assert worst.largest == pytest.approx(expected, rel=1e-6)
    outcome = jr.respond_to_train(WALL, C, worst.times, worst.intensities, model)
    assert outcome.overturned
