"""Driven motion against closed forms, published thresholds and independent integrations."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tables.driven_cases import cases, motion_of
from tools.selection import first_by_default

import jaxrock as jr

pytestmark = pytest.mark.float64
STILL = jr.Rectangular(0.0, 1e-3)


@functools.cache
def many(linearized):
    """One program for many blocks under a hardly visible pulse: half width to duration."""

    def run(b, s, c, v, amplitude, duration):
        r = jr.respond(
            jr.Block(b, s), c, jr.Rectangular(amplitude, 1e-3), duration, velocity=v, rtol=1e-11,
            model="linearized" if linearized else "nonlinear", max_impacts=32,
        )  # fmt: skip
        return r.impact_times, r.impact_velocities, r.impacts, r.status, r.peak_rotation

    return jax.jit(jax.vmap(run))


@pytest.mark.thorough
@pytest.mark.parametrize("linearized", [False, True])
def test_free_rocking(linearized):
    """The first 20 half-cycles of random blocks, none missed."""
    rng = np.random.default_rng(2)
    n = 100
    half_cycles = 20
    block = jr.Block(10 ** rng.uniform(-2, 1, n), rng.uniform(1.5, 20, n))
    c = rng.uniform(0.4, 0.98, n)
    model = jr.Linearized() if linearized else jr.Nonlinear()
    launch = model.critical_velocity(block) * rng.uniform(0.01, 0.999, n)
    speeds = np.asarray(launch)[:, None] * c[:, None] ** np.arange(half_cycles)
    column = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, n)[:, None], block)
    times = np.cumsum(model.half_cycle_duration(column, speeds), axis=1)
    ends = times[:, -1] + 0.3 * c * (times[:, -1] - times[:, -2])
    found, velocities, impacts, status, _ = many(linearized)(
        block.half_width, block.slenderness, c, launch, np.zeros(n), ends
    )
    assert (status == 0).all()
    assert (impacts == half_cycles).all()
    np.testing.assert_allclose(found[:, :half_cycles], times, rtol=1e-9)
    signed = speeds * np.where(np.arange(half_cycles) % 2, 1, -1)
    np.testing.assert_allclose(velocities[:, :half_cycles], signed, rtol=1e-9)


@pytest.mark.thorough
def test_traced_bad_values_are_flagged():
    numbers = np.full((6, 100), [[0.3], [4.0], [0.9], [0.1], [0.0], [1.0]])
    bad = {1: (2, 1.5), 3: (4, np.nan), 4: (0, -1.0), 6: (3, np.inf), 8: (5, 0.0)}
    for scene, (which, value) in bad.items():
        numbers[which, scene] = value
    *_, status, peaks = many(False)(*numbers)
    expected = np.isin(np.arange(100), list(bad))
    np.testing.assert_array_equal(status, np.where(expected, jr.Status.INVALID, 0))
    np.testing.assert_array_equal(np.isnan(peaks), expected)


@pytest.mark.parametrize("first", first_by_default([0, 4, 8]))
def test_record_against_independent_integration(first):
    """On the shipped record, wherever rounding of the input changes next to nothing."""
    rows = cases(1)
    assert len(rows) >= 40
    for row in rows[first::12]:
        block = jr.Block(row["half_width"], row["slenderness"])
        record = motion_of(row)
        if record.vertical is None:  # so that one program does for all
            horizontal = record.acceleration
            record = jr.Record(horizontal, record.time_step, 0 * horizontal, record.scale)
        r = jr.respond(block, row["restitution"], record, 60.0, rtol=1e-11)
        assert r.status == 0
        assert bool(r.overturned) == row["overturned"], row
        if not row["overturned"]:
            assert float(r.peak_rotation) == pytest.approx(row["peak_rotation"], rel=1e-8), row


@pytest.mark.thorough
def test_second_derivatives_under_a_record():
    samples = np.array([0.0, 4.0, 5.0, -2.0, -6.0, 3.0, 5.0, -3.0, 4.0, 0.0])

    def ours(parameters):
        b, slenderness, c, scale, step = parameters
        record = jr.Record(samples, step, scale=scale)
        end = record.end + 0.2
        r = jr.respond(jr.Block(b, slenderness), c, record, end, rtol=1e-12, max_impacts=16)
        return jnp.stack([r.final_rotation, r.margin])

    def theirs(parameters):
        r = follow_record(samples, parameters, 0.2)
        assert (r.impacts == 2).all()
        return np.stack([r.rotation, r.margin])

    at = jnp.asarray([0.3, 4.0, 0.7, 1.0, 0.15])
    second = jax.jit(jax.hessian(ours))(at)
    np.testing.assert_allclose(second, curvatures(theirs, at, 1e-3), rtol=1e-6, atol=1e-6)


def moved(of, at, moves):
    """Answers where the numbers are moved: answers, moves."""
    return of(np.asarray(at) * (1 + moves.reshape(-1, len(at)))).reshape(-1, *moves.shape[:-1])


def follow_record(samples, parameters, settle):
    """Blocks under a record, integrated in another way, at several scales and time steps."""
    b, slenderness, c, scale, step = np.asarray(parameters).T

    def value(motion, piece, time):
        left = samples[piece]
        right = samples[piece + 1]
        there = scale[motion] * (left + time / step[motion] * (right - left))
        return there, np.zeros_like(there)

    ground = stepping.Ground(step[:, None] * np.arange(len(samples)), value)
    return stepping.follow(stepping.Rocker(b, slenderness, c), ground, settle)


def slopes(of, at, part):
    """Central differences to all numbers, extrapolated: answers, numbers."""
    h = part * np.array([[1.0], [0.5]])
    steps = h[:, :, None] * np.eye(len(at))
    up, down = np.moveaxis(moved(of, at, np.stack([steps, -steps])), 1, 0)
    coarse, fine = np.moveaxis((up - down) / (2 * h * np.asarray(at)), 1, 0)
    return (4 * fine - coarse) / 3


def curvatures(of, at, part):
    """Second differences to all pairs of numbers, extrapolated: answers, numbers, numbers."""
    h = part * np.array([1.0, 0.5]).reshape(2, 1, 1)
    one = h[..., None] * np.eye(len(at))[:, None]
    other = h[..., None] * np.eye(len(at))
    corners = [s * t * moved(of, at, s * one + t * other) for s in (1, -1) for t in (1, -1)]
    coarse, fine = np.moveaxis(sum(corners) / (4 * h**2 * np.outer(at, at)), 1, 0)
    return (4 * fine - coarse) / 3


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(
    ("kind", "restitution", "samples"),
    # With C = 0.6 more than a hundred impacts, until it rests.
    [("batch", 0.8, 100), ("batch", 0.6, 200), ("adaptive", 0.6, 200)],
)
def test_derivatives_under_a_record(kind, restitution, samples):
    """Kinks of the input: both integrators, and one that restarts at every sample."""
    shaking = np.asarray(jr.example_record("north").acceleration)[1200 : 1200 + samples]

    def ours(parameters):
        b, slenderness, c, scale, step = parameters
        scene = jr.Block(b, slenderness), c, jr.Record(shaking, step, scale=scale)
        if kind == "batch":
            r = jr.respond_batch(*scene)
        else:
            r = jr.respond(*scene, rtol=1e-11, atol=1e-13)
        found = jnp.stack([r.peak_rotation, r.final_rotation, r.margin])
        return found, found

    def theirs(parameters):
        r = follow_record(shaking, parameters, 0.0)
        assert (r.impacts >= 3).all()
        return np.stack([r.peak, r.rotation, r.margin])

    at = jnp.asarray([0.2, 5.0, restitution, 1.0, 0.01])
    found, values = jax.jit(jax.jacfwd(ours, has_aux=True))(at)
    np.testing.assert_allclose(values, theirs(at[None])[:, 0], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found, slopes(theirs, at, 1e-5), rtol=1e-5, atol=1e-7)


def test_never_lifted_and_rest():
    block = jr.Block(0.3, 5.0)
    r = jr.respond(block, 0.9, jr.Sine(0.99 * 9.81 / 5, 1.0), 3.0)
    assert (r.peak_rotation, r.impacts, r.status) == (0, 0, 0)
    assert float(r.margin) == pytest.approx(1, rel=1e-14)
    assert r.at_rest
    assert "at rest when" in str(r)
    assert float(r.friction_demand) == pytest.approx(0.99 / 5, rel=1e-3)
    lifted = jr.respond(block, 0.9, jr.Sine(1.01 * 9.81 / 5, 1.0), 3.0)
    assert lifted.peak_rotation > 0


@pytest.mark.parametrize("model", first_by_default(["nonlinear", "linearized"]))
@pytest.mark.parametrize("sign", first_by_default([1, -1]))
def test_in_balance(model, sign):
    """Nothing moves a block that is let go at the critical angle, and the status says so."""
    block = jr.Block(0.2, 5.0)
    angle = sign * block.critical_angle
    r = jr.respond(block, 0.9, STILL, 5.0, rotation=angle, model=model)
    assert r.status == jr.Status.BALANCED
    assert (r.final_rotation, r.final_velocity, r.peak_rotation) == (angle, 0, abs(angle))
    assert (r.impacts, r.overturned, r.margin) == (0, False, 0)
    assert (r.friction_demand, r.normal_force) == (0, 1)
    np.testing.assert_array_equal(r.history(np.array([0.0, 2.0, 5.0]))[0], angle)


def test_being_beyond_the_critical_angle_is_not_overturning():
    """Inside a window of survival, from the SciPy integration."""
    block = jr.Block(0.5 * np.sin(0.2), 1 / np.tan(0.2))
    c = float(jr.housner_restitution(block))
    r = jr.respond(block, c, jr.Sine(4.02 * 9.81 * np.tan(0.2), 0.5), 10.0)
    assert r.peak_rotation > block.critical_angle
    assert not r.overturned
    over = jr.respond(block, c, jr.Sine(3.0 * 9.81 * np.tan(0.2), 0.5), 10.0)
    rotation, velocity = over.history(over.overturning_time)
    assert abs(float(rotation)) == pytest.approx(float(block.critical_angle), rel=1e-6)
    assert float(rotation * velocity) > 0


def test_history():
    block = jr.Block(0.3, 4.0)
    model = jr.Nonlinear()
    launch = 0.6 * model.critical_velocity(block)
    r = jr.respond(block, 0.8, STILL, 3.0, velocity=launch)
    first = float(model.half_cycle_duration(block, launch))
    times = np.linspace(0.01, 0.99, 20) * first
    rotation, velocity = r.history(times)
    expected = model.motion(block, launch, times)
    np.testing.assert_allclose(rotation, expected[0], rtol=1e-6)
    np.testing.assert_allclose(velocity, expected[1], rtol=1e-6, atol=1e-7)
    later = model.motion(block, 0.8 * launch, times * 0.3)
    np.testing.assert_allclose(r.history(first + times * 0.3)[0], -later[0], rtol=1e-6)
    outside = np.resize([-1.0, 3.1, np.nan, np.inf], times.shape)
    assert np.isnan(r.history(outside)[0]).all()
    assert r.history(np.zeros((2, 0)))[0].shape == (2, 0)


@pytest.mark.thorough
def test_all_impacts_are_listed():
    block = jr.Block(0.2, 5.0)
    whole = jr.respond(block, 0.9, jr.example_record(), 60.0)
    assert whole.impacts > 1000
    traced = jax.jit(
        lambda c: jr.respond(block, c, jr.example_record(), 60.0, max_impacts=200)
    )(0.9)
    assert traced.status == jr.Status.LIST_FULL
    assert traced.impacts == whole.impacts
    assert float(traced.peak_rotation) == pytest.approx(float(whole.peak_rotation), rel=1e-9)


def test_the_shortest_pulses():
    """Over before a block that has just been lifted was let go; the rotation is as its square."""
    block = jr.Block(0.3, 4.0)
    # A NaN that stands for none is none of theirs.
    with jax.debug_nans(True), jax.checking_leaks():
        peaks = [
            jr.respond(block, 0.7, jr.Sine(4.0, d), 1.0).peak_rotation for d in (1e-5, 1e-7)
        ]
    assert float(peaks[1] / peaks[0]) == pytest.approx(1e-4, rel=1e-6)


@pytest.mark.thorough
def test_float32():
    with jax.enable_x64(False):
        r = jr.respond(jr.Block(0.3, 5.0), 0.9, jr.Sine(3.4, 1.4), 4.0)
        assert r.peak_rotation.dtype == np.float32
        peak = float(r.peak_rotation)
        # Lifted where the clock goes on in steps longer than the grace of a block just lifted.
        long = jr.respond(jr.Block(0.4, 5.0), 0.9, jr.example_record(), 60.0)
        assert long.status == 0
        assert 900 < long.impacts < 1000
        with pytest.raises(ValueError, match="which is what float32 can deliver, got 1e-10"):
            jr.respond(jr.Block(0.3, 5.0), 0.9, jr.Sine(3.4, 1.4), 4.0, rtol=1e-10)
    expected = jr.respond(jr.Block(0.3, 5.0), 0.9, jr.Sine(3.4, 1.4), 4.0).peak_rotation
    assert peak == pytest.approx(float(expected), rel=1e-3)
