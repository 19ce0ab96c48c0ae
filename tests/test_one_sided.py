"""Blocks against a wall in closed forms, trains, spectra, fits and sensitivities.

Driven motion against a wall is in test_one_sided_motion.py.
"""

import functools
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from scenes import record
from scipy.integrate import solve_ivp
from tools.selection import first_by_default

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


@pytest.mark.thorough
def test_half_cycle_map_against_simulation():
    """The difference falls in proportion to the duration; two durations extrapolate it to 0."""
    scene = jr.Scene(WALL, C, 0.3)
    expected = float(jr.stabilized_rotation(scene, jr.Nonlinear()))
    peaks = [rock_under_pulses(WALL, C, 0.3, duration, 26) for duration in (4e-3, 2e-3, 1e-3)]
    errors = np.array(peaks) / expected - 1
    np.testing.assert_allclose(errors[:-1] / errors[1:], 2, rtol=0.02)
    first = 2 * np.array(peaks[1:]) - peaks[:-1]
    assert (4 * first[1] - first[0]) / 3 == pytest.approx(expected, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("model", first_by_default(MODELS))
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
        for function in (jr.half_cycle_velocity, jr.resonance.next_velocity):
            np.testing.assert_array_equal(function(wall, 3.0), function(free, 3.0))
        for function, extra in (
            (jr.critical_intensity, ()),
            (jr.critical_width, (0.3,)),
            (jr.critical_slenderness, (0.3,)),
        ):
            expected = function(FREE, 0.47, *extra, model=model)
            answer = function(WALL, restitution, *extra, model=model)
            np.testing.assert_array_equal(answer, expected)
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


@pytest.mark.parametrize("model", first_by_default(MODELS))
@pytest.mark.parametrize("answer", first_by_default(ANSWERS))
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
    for kept in (
        mapped,
        jax.tree.unflatten(form, leaves),
        moved,
        jax.jit(lambda s: s)(scene),
    ):
        assert kept.block.one_sided
    assert jax.tree.structure(scene) != jax.tree.structure(jr.Scene(FREE, 0.47, 0.3))
    many = jax.vmap(lambda i: jr.stabilized_period(jr.Scene(WALL, C, i)))(
        jnp.array([0.2, 0.3])
    )
    np.testing.assert_allclose(many[1], jr.stabilized_period(scene), rtol=1e-6)


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


@pytest.mark.thorough
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


@pytest.mark.thorough
@pytest.mark.parametrize("model", MODELS)
def test_worst_trains_push_away_from_the_wall(model):
    worst = jr.worst_train(WALL, C, 3, model=model, starts=4)
    assert worst.status == jr.Status.COMPLETE
    assert (worst.intensities > 0).all()
    expected = float(jr.critical_intensity(WALL, C, 3.0, model))
    assert worst.largest == pytest.approx(expected, rel=1e-6)
    outcome = jr.respond_to_train(WALL, C, worst.times, worst.intensities, model)
    assert outcome.overturned


# Pulses of finite duration, what simplifications cost


def half_sine(duration, intensity=0.3):
    return jr.HalfSine(0.5 * np.pi * intensity / duration, duration)


@pytest.mark.thorough
def test_pulses_of_finite_duration():
    """The stabilized phase is a fixed point: half of a free-standing block's period."""
    pulse = half_sine(0.01)
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
    assert response.history(response.impact_times + 1e-4)[0] > 0
    # Towards the wall no pulse lifts it.
    still = jr.steady.pulsed_phase(WALL, C, half_sine(0.01, -0.3))
    assert still.settles


@pytest.mark.thorough
def test_critical_pulses_become_instantaneous():
    expected = float(jr.critical_intensity(WALL, C, np.inf, "nonlinear"))
    errors = []
    for duration in (4e-3, 2e-3):
        threshold = jr.steady.critical_pulsed_amplitude(WALL, C, jr.HalfSine, duration)
        errors.append(float(threshold.intensity) / expected - 1)
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.02)
    assert abs(errors[1]) < 5e-3


@pytest.mark.thorough
def test_predicted_costs_are_those_of_the_wall():
    scene = jr.Scene(WALL, C, 0.3)
    predicted = jr.accuracy.model_error(scene, jr.HalfSine, 0.02)
    phase = jr.steady.pulsed_phase(WALL, C, half_sine(0.02))
    cost = float(jr.stabilized_period(scene, jr.Nonlinear())) / float(phase.period) - 1
    assert abs(float(predicted.duration.period) - cost) < float(
        predicted.duration_bound.period
    )
    assert float(predicted.duration_bound.period) < 0.2 * cost
    # Linearizing, and rounding, cost what they cost a free-standing block.
    free = jr.accuracy.model_error(jr.Scene(FREE, -C, 0.3))
    alike = jr.accuracy.model_error(scene)
    for cost, expected in zip(jax.tree.leaves(alike), jax.tree.leaves(free), strict=True):
        np.testing.assert_allclose(cost, expected, rtol=1e-9, atol=1e-15)
    assert (
        jr.accuracy.choose(scene, 0.01).setting
        == jr.accuracy.choose(jr.Scene(FREE, -C, 0.3), 0.01).setting
    )


def test_choice_for_driven_motion():
    scene = (WALL, C, record())
    choice = jr.accuracy.choose(scene, 1e-6)
    wall, free = (jr.respond_within(block, -C, record(), 1e-6) for block in (WALL, FREE))
    assert choice.setting.rtol == float(wall.cheapest)
    assert float(choice.error) <= 1e-6
    assert float(wall.response.peak_rotation) != float(free.response.peak_rotation)


@pytest.mark.thorough
def test_measured_trade():
    """The period by the integrator is that of the closed form."""
    trade = jr.accuracy.measure_tradeoff(jr.Scene(WALL, C, 0.3), repeats=1)
    error = trade.error.where(trade.level == "adaptive")
    assert float(error.min()) < 1e-10


# Spectra


@pytest.mark.parametrize("model", first_by_default([*MODELS, "auto"]))
def test_resonance_spectrum(model):
    axes = ([5.0, 10.0], [0.4, 0.8], 0.2)
    free = jr.resonance_spectrum(*axes[:2], [0.4, 0.5], axes[2], model=model)
    wall = jr.resonance_spectrum(*axes[:2], [-0.4, 0.5], axes[2], model=model, one_sided=True)
    assert wall.attrs["one_sided"] == 1
    assert "one_sided" not in free.attrs
    np.testing.assert_array_equal(wall.restitution, [0.4, 0.5])
    np.testing.assert_allclose(
        wall.stabilized_period, 0.5 * free.stabilized_period, rtol=1e-14
    )
    for name in set(free.data_vars) - {"stabilized_period"}:
        np.testing.assert_allclose(wall[name], free[name], rtol=1e-14)
    lazy = jr.resonance_spectrum(
        *axes[:2], [0.4, 0.5], axes[2], model=model, one_sided=True, chunks={"width": 1}
    )
    np.testing.assert_array_equal(lazy.stabilized_period, wall.stabilized_period)


@pytest.mark.thorough
def test_rocking_spectrum():
    """Blocks of the spectrum, made one by one; Housner's restitution is not theirs."""
    motion = record()
    spectrum = jr.rocking_spectrum(motion, [1.5, 3.0], slenderness=[4.0, 8.0], one_sided=True)
    angles = np.arctan(1 / np.array([4.0, 8.0]))
    block = jr.Block.from_parameters(
        2 * np.pi / np.array([[1.5], [3.0]]), angles[None], one_sided=True
    )
    restitution = jr.one_sided_restitution(block)
    response = jr.respond_batch(block, restitution, motion)
    np.testing.assert_allclose(spectrum.margin, response.margin, rtol=1e-6)
    np.testing.assert_allclose(spectrum.peak_rotation, response.peak_rotation, rtol=1e-6)
    given = jr.rocking_spectrum(motion, 1.5, 4.0, [-0.5, 0.6], one_sided=True)
    np.testing.assert_array_equal(given.restitution, [0.5, 0.6])
    assert given.attrs["one_sided"] == spectrum.attrs["one_sided"] == 1
    # No wall stops a stocky block by reversing it: it stays there.
    stocky = jr.rocking_spectrum(jr.Sine(20.0, 0.5), 2.0, slenderness=1.2, one_sided=True)
    assert stocky.impacts.values.item() == 1


@pytest.mark.thorough
def test_overturning_map():
    block = jr.Block(0.2, 5.0, one_sided=True)
    restitution = float(jr.one_sided_restitution(block))
    wall = jr.overturning_map(jr.Sine, [4.0], restitution=-0.9, one_sided=True)
    assert wall.attrs["restitution"] == 0.9
    duration = 2 * np.pi / (4.0 * float(block.frequency_parameter))
    boundaries = jr.critical_amplitude(block, 0.9, jr.Sine, duration)
    uplift = 9.81 / 5.0
    ratios = np.asarray(boundaries.value) / uplift
    np.testing.assert_allclose(wall.amplitude_ratio.values[0], ratios, rtol=1e-8)
    # By a factor the first boundary differs from that of a free-standing block.
    free = jr.overturning_map(jr.Sine, [4.0], restitution=0.9)
    assert float(wall.amplitude_ratio[0, 0]) > 1.1 * float(free.amplitude_ratio[0, 0])
    edges = ratios[-1] * np.array([0.99, 1.01])
    against_wall = functools.partial(jr.overturning_map, jr.Sine, [4.0], one_sided=True)
    spectrum = against_wall(amplitude_ratio=edges, restitution=-0.9)
    np.testing.assert_array_equal(spectrum.overturned, [[0, 1]])
    default = against_wall(amplitude_ratio=[3.0])
    pulse = jr.Sine(3.0 * uplift, duration)
    expected = jr.respond_batch(block, restitution, pulse).peak_rotation
    np.testing.assert_allclose(default.peak_rotation.values.item(), expected, rtol=1e-8)


# Boundaries: a pulse whose second half pushes away from the wall

PULSE = jr.Sine(-1.0, 0.5)
SLENDER = jr.Block(0.1, 5.0, one_sided=True)


def overturns(block, restitution, motion):
    return np.asarray(jr.respond_batch(block, restitution, motion).overturned)


def test_boundaries_along_every_quantity():
    factors = np.geomspace(2.0, 30.0, 300)
    boundaries = jr.overturning_boundaries(SLENDER, C, PULSE, "factor", factors)
    free = jr.overturning_boundaries(jr.Block(0.1, 5.0), -C, PULSE, "factor", factors)
    first = float(boundaries.value[0])
    # The first half pushes into the wall, and the second one meets a block at rest.
    assert first < 0.7 * float(free.value[0])
    np.testing.assert_array_equal(
        overturns(SLENDER, C, PULSE.scaled(first * np.array([1 - 1e-6, 1 + 1e-6]))), [0, 1]
    )
    at_threshold = PULSE.scaled(first)
    for along, value in (
        ("width", 0.2),
        ("height", 1.0),
        ("half_width", 0.1),
        ("slenderness", 5.0),
        ("amplitude", -first),
        ("duration", 0.5),
    ):
        ends = sorted([0.97 * value, 1.03 * value])
        boundary = jr.overturning_boundaries(SLENDER, C, at_threshold, along, ends)
        assert boundary.value.item() == pytest.approx(value, rel=1e-7), along


def test_boundary_along_the_restitution():
    """Up to 1 by its magnitude; the second half of a full sine meets a block that bounces."""
    pulse = jr.Sine(1.0, 0.8).scaled(4.4)
    magnitudes = np.linspace(0.05, 0.95, 10)
    outcomes = overturns(SLENDER, magnitudes, pulse)
    boundaries = jr.overturning_boundaries(SLENDER, C, pulse, "restitution", magnitudes)
    assert bool(boundaries.overturns_first) == outcomes[0]
    assert np.asarray(boundaries.value).size % 2 == (outcomes[0] != outcomes[-1])


def test_uplift_is_away_from_the_wall():
    factor = jr.overturning.uplift_factor
    assert np.isinf(factor(SLENDER, jr.HalfSine(-1.0, 0.5)))
    assert float(factor(SLENDER, jr.HalfSine(1.0, 0.5))) == pytest.approx(9.81 / 5.0)
    ramp = jr.Record([0.0, -3.0, 0.0, 2.0, 0.0], 0.1, [0.0, 0.0, 0.0, -1.0, 0.0])
    assert float(factor(SLENDER, ramp)) == pytest.approx(9.81 / 5.0 / (2.0 + 0.2))


# Sensitivities: the wall is there in every answer

UNCERTAIN = jr.Uncertain({"restitution": 0.05, "width": 0.05}, samples=64)
TOWARDS = jr.HalfSine(-4.0, 0.4)
RANGES = {"restitution": (0.4, 0.5), "width": (0.7, 0.9)}


def halve(value):
    return 0.5 * np.asarray(value)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "ask",
    [
        lambda scene: jr.sensitivities(jr.stabilized_period, scene).value,
        lambda scene: jr.sensitivities(jr.stabilized_period, scene, sides=True).gradient,
        lambda scene: jr.tornado(jr.stabilized_period, scene, RANGES).at_high,
        lambda scene: jr.sensitivity.propagate(jr.stabilized_period, scene, UNCERTAIN).mean,
        lambda scene: jr.value_and_slopes(jr.stabilized_period)(scene)[0],
        lambda scene: jr.value_and_slopes(jr.stabilized_period)(scene)[1].restitution,
    ],
)
def test_period_through_every_tool(ask):
    wall = ask(jr.Scene(WALL, C, 0.3))
    np.testing.assert_allclose(wall, halve(ask(jr.Scene(FREE, -C, 0.3))), rtol=1e-12)


def test_uncertain_blocks_keep_the_wall():
    drawn = UNCERTAIN.draw(WALL, C)
    assert drawn.block.one_sided
    assert (np.asarray(drawn.restitution) > 0).all()
    assert np.median(drawn.restitution) == pytest.approx(0.47, rel=0.02)


@pytest.mark.thorough
def test_driven_answers_of_uncertain_blocks():
    probabilities = jr.sensitivity.outcome_probabilities(
        WALL, C, TOWARDS, UNCERTAIN, ratio=0.01
    )
    np.testing.assert_array_equal(probabilities.probability, 0)
    bars = jr.sensitivity.driven_tornado(WALL, C, TOWARDS, RANGES)
    np.testing.assert_array_equal([bars.at_low, bars.at_high], 0)
    # The second half of a sine moves it: as a block made for the purpose.
    pulse = jr.Sine(-4.0, 0.6)
    bars = jr.sensitivity.driven_tornado(WALL, C, pulse, {"width": (0.7, 0.9)})
    block = jr.Block.from_size(width=np.array([0.7, 0.9]), height=4.0, one_sided=True)
    response = jr.respond_batch(block, C, pulse, pulse.end + 10.0)
    ratios = np.asarray(response.peak_rotation / block.critical_angle)
    np.testing.assert_allclose([bars.at_low[0], bars.at_high[0]], ratios, rtol=1e-6)
    local = jr.derivatives_within(
        WALL, C, pulse, 1e-6, pulse.end + 10.0, of="rotation_ratio", by=("width",)
    )
    step = 1e-4
    block = jr.Block.from_size(
        width=0.8 * (1 + np.array([0.0, -step, step])), height=4.0, one_sided=True
    )
    response = jr.respond_batch(block, C, pulse, pulse.end + 10.0, rtol=1e-12)
    ratio, low, high = np.asarray(response.peak_rotation / block.critical_angle)
    assert float(local.value) == pytest.approx(ratio, rel=1e-7)
    slope = float(local.derivative["width"])
    assert slope == pytest.approx((high - low) / (1.6 * step), rel=1e-4)


# Fits, reports, pictures


@pytest.mark.thorough
@pytest.mark.parametrize("model", first_by_default(MODELS))
def test_free_rocking_is_fitted(model):
    """Times between impacts with the decay of |C|, by trains: no impact law of this file."""
    train = jr.respond_to_train(WALL, -0.8, [0.0], [0.7], model)
    time = np.linspace(0, 6, 60001)
    rotation, velocity = map(np.asarray, train.history(time))
    assert (rotation >= 0).all()
    thrown = np.flatnonzero((velocity[:-1] < 0) & (velocity[1:] > 0))[:12]
    # Straight lines to the ground from both sides of an impact.
    times = time[thrown] - rotation[thrown] / velocity[thrown]
    fit = jr.calibration.fit_free_rocking(times, WALL, model=model)
    assert float(fit.restitution) == pytest.approx(0.8, abs=1e-4)
    assert fit.block.one_sided
    tuned = jr.calibration.fit_free_rocking(times, WALL, model=model, frequency_known=False)
    assert tuned.block.one_sided
    peaks = [rotation[a:b].max() for a, b in itertools.pairwise(thrown)]
    fit = jr.calibration.fit_free_rocking(times, WALL, peak_rotations=peaks, model=model)
    assert float(fit.restitution) == pytest.approx(0.8, abs=1e-3)


@pytest.mark.thorough
def test_assessment_names_the_wall():
    answers, free = (jr.reports.assess(block, 0.47, 0.3) for block in (WALL, FREE))
    scene = answers["scene"]
    assert scene["one_sided_restitution"] == float(jr.one_sided_restitution(WALL))
    assert "housner_restitution" not in scene
    text = str(answers)
    assert "one-sided" in text
    assert "housner" not in answers.details()
    assert "one-sided" not in str(free)
    for model in MODELS:
        wall = answers["models"][model]
        without = free["models"][model]
        assert wall["single_pulse"] == without["single_pulse"]
        period = wall["stabilized"]["period"]
        assert period == pytest.approx(0.5 * without["stabilized"]["period"], rel=1e-12)


@pytest.mark.thorough
def test_pictures_show_one_side():
    resonance = jr.plot.plot_resonance(jr.Scene(WALL, C, 0.3), half_cycles=4)
    assert np.nanmin(resonance.lines[0].get_ydata()) >= -1e-12
    response = jr.respond(WALL, C, jr.Sine(4.0, 0.6), 3.0)
    ground = jr.plot.plot_response(response).child_axes[0]
    levels = [line for line in ground.lines if line.get_linestyle() == "-."]
    assert len(levels) == 1
    assert levels[0].get_ydata().min() > 0
    plt.close("all")
