"""Steady rocking on a harmonic floor, against SciPy's steps through the full equation."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from scipy.integrate import solve_ivp
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.steady import (
    harmonic_orbit,
    least_harmonic_amplitude,
    symmetry_breaking_amplitude,
)

MODELS = ["linearized", "nonlinear"]
BLOCK = jr.Block(0.2, 5.0)


def in_units(block, w, beta):
    """Amplitude and frequency from beta, over g alpha_c, and w, over p."""
    unit = np.asarray(block.gravity * block.critical_angle)
    p = np.asarray(block.frequency_parameter)
    return beta * unit, w * p


def orbit_of(block, c, w, beta, model="nonlinear"):
    return harmonic_orbit(block, c, *in_units(block, w, beta), model=model)


def field(block, amplitude, frequency, model, time, state):
    """Rates of rotation and velocity; the floor then counts as turned around in half periods."""
    push = amplitude / float(block.gravity) * np.sin(frequency * time)
    tilt = float(block.critical_angle) - state[0]
    rate = float(block.frequency_parameter) ** 2
    if model == "linearized":
        return state[1], -rate * (tilt - push)
    return state[1], -rate * (np.sin(tilt) - push * np.cos(tilt))


STABLE = [  # block, C, w, beta
    (BLOCK, 0.7, 4.0, 2.0),
    (jr.Block(0.5, 2.0), 0.7, 3.0, 1.2),
    (jr.Block(0.3, 8.0, inertia_ratio=1.2), 0.6, 6.0, 4.0),
    (jr.Block(1.0, 3.0, 1.62, 1.9), 0.5, 2.0, 0.9),
    (jr.Block(0.1, 1.0), 0.6, 2.5, 1.8),
]


@pytest.mark.float64
@pytest.mark.parametrize("model", first_by_default(MODELS))
@pytest.mark.parametrize("case", first_by_default(STABLE))
def test_motion_that_settles_does_so_there(case, model):
    block, c, w, beta = case
    amplitude, frequency = map(float, in_units(block, w, beta))
    orbit = harmonic_orbit(block, c, amplitude, frequency, model=model)
    assert orbit.exists
    assert orbit.stable
    cycles = 80
    ratio = 1 / float(block.inertia_ratio)
    size = float(block.half_width), float(block.slenderness)
    rocker = stepping.Rocker(*size, c, model == "linearized", float(block.gravity), ratio)
    floor = stepping.harmonic(amplitude, frequency, cycles, 0.98 * float(orbit.phase))
    start = 0.0, 1.02 * float(orbit.launch_velocity)
    found = stepping.follow(rocker, floor, 0.0, start=start)
    times, landings = found.impact_times[0], found.impact_velocities[0]
    phase = (frequency * times[-1] + 0.98 * float(orbit.phase)) % np.pi
    assert len(times) in (2 * cycles - 1, 2 * cycles)
    assert float(orbit.phase) == pytest.approx(phase, rel=1e-8)
    assert float(orbit.launch_velocity) == pytest.approx(c * abs(landings[-1]), rel=1e-8)
    # Launched there, its first peak is the one of the orbit.
    floor = stepping.harmonic(amplitude, frequency, 1, float(orbit.phase))
    start = 0.0, float(orbit.launch_velocity)
    peak = stepping.follow(rocker, floor, 0.0, start=start, landings=1).peak[0]
    assert float(orbit.peak_rotation) == pytest.approx(peak, rel=1e-9)


ALL = [  # also unstable ones, near the fold, and with symmetry broken
    *STABLE,
    (BLOCK, 0.925, 4.0, 0.095),
    (BLOCK, 0.9, 2.0, 3.0),
    (jr.Block(0.3, 2.0, inertia_ratio=1.5), 0.95, 8.0, 1.0),
    (BLOCK, 0.9, 0.7, 0.6),
    (BLOCK, 1.0, 5.0, 0.4),
]


@pytest.mark.float64
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("case", first_by_default([*ALL[1::2], *ALL[::2]], 5))
def test_multipliers_by_the_variational_equation(case, model):
    block, c, w, beta = case
    amplitude, frequency = map(float, in_units(block, w, beta))
    orbit = harmonic_orbit(block, c, amplitude, frequency, model=model)
    follow = functools.partial(field, block, amplitude, frequency, model)

    def field_and_variation(time, state):
        rotation = state[0]
        change = 1e-20j  # whose imaginary part is a derivative
        acceleration = follow(time, (rotation + change, 0.0))[1]
        stiffness = acceleration.imag / change.imag
        return [state[1], acceleration.real, *state[4:], *(stiffness * state[2:4])]

    begin = float(orbit.phase) / frequency
    end = begin + np.pi / frequency
    velocity = float(orbit.launch_velocity)
    start = (0.0, velocity, 1.0, 0.0, 0.0, 1.0)
    flight = solve_ivp(
        field_and_variation, (begin, end), start, "DOP853", rtol=1e-13, atol=1e-15
    )
    last = flight.y[:, -1]
    leaving, arriving = (follow(time, (0.0, 0.0))[1] for time in (begin, end))
    before = np.array([[-velocity, 0.0], [-leaving, 1.0]])
    after = np.array([[-1.0, 0.0], [c * arriving, -c * last[1]]]) / last[1]
    matrix = after @ last[2:].reshape(2, 2) @ before
    scale = np.abs(matrix).max()
    assert float(orbit.trace) == pytest.approx(np.trace(matrix), abs=1e-10 * scale)
    assert float(orbit.determinant) == pytest.approx(np.linalg.det(matrix), abs=1e-10 * scale)
    found = np.asarray(orbit.multipliers)
    size = np.abs(found)
    assert size[0] >= size[1]
    error = np.abs(found[:, None] - np.linalg.eigvals(matrix)).min(axis=1)
    near = min(np.abs(found[0] - found[1]), 1)  # close ones are ill-conditioned
    np.testing.assert_allclose(error, 0, atol=2e-8 * scale**2 / near)
    assert bool(orbit.stable) == bool((size < 1 - 1e-12).all())


@pytest.mark.float64
@pytest.mark.parametrize(
    ("w", "c", "least", "breaking"),
    [
        (4.0, 0.925, 0.0923325834, 9.639820),
        (4.0, 0.8, 0.2602008103, 8.717489),
        (2.0, 0.9, 0.1129065770, 2.160498),
        (8.0, 0.9, 0.1281487996, 36.438229),
    ],
)
def test_limits_of_the_linearized_block(w, c, least, breaking):
    unit, frequency = in_units(BLOCK, w, 1.0)
    found = least_harmonic_amplitude(BLOCK, c, frequency) / unit
    assert float(found) == pytest.approx(least, abs=6e-11)
    broken = symmetry_breaking_amplitude(BLOCK, c, frequency) / unit
    assert float(broken) == pytest.approx(breaking, abs=6e-7)
    beta = np.concatenate([float(found) * (1 + np.array([-1e-9, 1e-9])),
                           float(broken) * (1 + np.array([-1e-9, 1e-9]))])  # fmt: skip
    orbit = orbit_of(BLOCK, c, w, beta, "linearized")
    assert orbit.exists.tolist() == [False, True, True, True]
    assert orbit.symmetry_broken.tolist() == [False, False, False, True]
    assert orbit.stable.tolist()[1:] == [True, True, False]
    assert float(orbit.trace[1]) == pytest.approx(1 + c**2, rel=1e-3)
    assert float(orbit.trace[2]) == pytest.approx(-(1 + c**2), rel=1e-7)


def numbers(at, model):
    block = jr.Block(at[0], at[1], at[5], at[6])
    orbit = harmonic_orbit(block, at[2], at[3], at[4], model=model)
    parts = orbit.multipliers.real, orbit.multipliers.imag
    scalars = (orbit.launch_velocity, orbit.phase, orbit.peak_rotation, orbit.rotation_ratio)
    return jnp.concatenate([jnp.stack([*scalars, orbit.trace, orbit.determinant]), *parts])


POINTS = [  # b, lambda, C, amplitude, omega, g, kappa
    (0.2, 5.0, 0.9, 3.0, 16.0, 9.81, 4 / 3),
    (0.5, 2.0, 0.7, 6.0, 9.0, 9.81, 1.2),
    (0.4, 3.0, 0.85, 1.1, 6.0, 9.81, 1.6),  # real multipliers
]


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("point", POINTS)
def test_derivatives(point, model):
    at = np.array(point)
    value = jax.jit(numbers, static_argnums=1)
    forward, reverse = (jax.jit(mode(numbers), static_argnums=1)(at, model)
                        for mode in (jax.jacfwd, jax.jacrev))  # fmt: skip
    np.testing.assert_allclose(forward, reverse, rtol=1e-10, atol=1e-11)
    for k in range(at.size):
        slopes = []
        for width in (2e-3 * at[k], 1e-3 * at[k]):
            shift = width * np.eye(at.size)[k]
            slopes.append((value(at + shift, model) - value(at - shift, model)) / (2 * width))
        expected = np.asarray(4 * slopes[1] - slopes[0]) / 3
        size = np.maximum(np.abs(expected), np.abs(value(at, model)) / at[k])
        np.testing.assert_array_less(np.abs(forward[:, k] - expected), 1e-7 * size + 1e-12)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("model", MODELS)
def test_second_derivatives(model):
    at = np.array(POINTS[0])

    def some(at):
        return numbers(at, model)[jnp.array([0, 2, 4])]

    found = jax.jit(jax.jacfwd(jax.jacrev(some)))(at)
    slope = jax.jit(jax.jacfwd(some))
    for k in (1, 2, 3, 4):
        shift = 1e-4 * at[k] * np.eye(at.size)[k]
        expected = (slope(at + shift) - slope(at - shift)) / (2e-4 * at[k])
        scale = np.abs(expected).max(axis=1, keepdims=True)
        np.testing.assert_allclose((found[:, :, k] - expected) / scale, 0, atol=1e-5)


@pytest.mark.thorough
@pytest.mark.parametrize("model", MODELS)
def test_none_leaves_its_neighbours_alone(model):
    amplitude = jnp.array([0.05, 3.0, 0.0, 1.0])

    def velocities(amplitude, c):
        return harmonic_orbit(BLOCK, c, amplitude, 14.0, model=model).launch_velocity

    orbit = harmonic_orbit(BLOCK, 0.9, amplitude, 14.0, model=model)
    assert orbit.exists.tolist() == [False, True, False, True]
    for name in ("launch_velocity", "phase", "peak_rotation", "rotation_ratio", "trace"):
        assert np.isnan(getattr(orbit, name)).tolist() == [True, False, True, False]

    def total(amplitude, c):
        return jnp.nansum(velocities(amplitude, c))

    slopes, by_c = jax.grad(total, (0, 1))(amplitude, 0.9)
    alone = jax.grad(total, (0, 1))(amplitude[1::2], 0.9)
    eps = float(jnp.finfo(slopes.dtype).eps)
    np.testing.assert_allclose(slopes[1::2], alone[0], rtol=1e3 * eps)
    assert slopes[::2].tolist() == [0, 0]
    assert float(by_c) == pytest.approx(float(alone[1]), rel=1e3 * eps)


@pytest.mark.float64
def test_from_where_on_the_nonlinear_motion_exists():
    """Just above its own fold it is found, and there the larger multiplier is 1."""
    c = 0.9
    w = 3.0
    low = 0.05
    high = 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if orbit_of(BLOCK, c, w, middle).exists else (middle, high)
    linearized = least_harmonic_amplitude(BLOCK, c, in_units(BLOCK, w, 1.0)[1])
    assert high == pytest.approx(float(linearized / in_units(BLOCK, w, 1.0)[0]), rel=0.02)
    gaps = []
    for above in (1e-6, 1e-8):
        orbit = orbit_of(BLOCK, c, w, high * (1 + above))
        assert orbit.stable
        gaps.append(1 + c**2 - float(orbit.trace))
    assert gaps[0] / gaps[1] == pytest.approx(10, rel=1e-2)  # like the square root
