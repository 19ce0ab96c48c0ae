"""Boundaries of overturning in driven motion: published ones, SciPy, differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tools.selection import first_by_default

import jaxrock as jr

pytestmark = pytest.mark.float64


def test_rectangular_pulses_against_housner():
    """Linearized: A = 1 / (1 - exp(-p t1)) (Housner 1963, Eq. 9)."""
    block = jr.Block(jnp.asarray([0.1, 0.4, 2.0]), jnp.asarray([3.0, 5.0, 8.0]))
    times = jnp.asarray([0.5, 1.0, 2.0])
    duration = times / block.frequency_parameter
    found = jr.critical_amplitude(block, 0.9, jr.Rectangular, duration, model="linearized")
    ratio = found.value[:, 0] / (9.81 * block.critical_angle)
    np.testing.assert_allclose(ratio, 1 / -jnp.expm1(-times), rtol=1e-10)
    assert (found.count == 1).all()
    assert (found.impacts == 0).all()


@pytest.mark.parametrize(
    ("width", "height", "shape", "duration", "expected"),
    [(1.0, 3.0, jr.Sine, 1.0, 0.45154), (0.4, 1.2, jr.HalfSine, 0.5, 0.5545859)],
)
def test_makris_and_roussos(width, height, shape, duration, expected):
    """Recomputed from their equations; they print 0.5545 and 0.4514 g."""
    block = jr.Block.from_size(width=width, height=height)
    c = jr.housner_restitution(block)
    found = jr.critical_amplitude(block, c, shape, duration, model="linearized")
    assert float(found.value[0]) / 9.81 == pytest.approx(expected, abs=1e-6)


@pytest.mark.thorough
def test_against_scipy():
    """Thirty boundaries of blocks at random: the outcome changes there, and the mode is theirs."""
    rng = np.random.default_rng(5)
    checked = 0
    cases = {}
    while checked < 30:
        half_width = 10 ** rng.uniform(-1.3, 0.2)
        slenderness = rng.uniform(2, 9)
        c = rng.uniform(0.6, 0.95)
        duration = rng.uniform(0.2, 1.2)
        shape = (jr.HalfSine, jr.Sine, jr.Cosine)[checked % 3]
        linearized = bool(rng.random() < 0.5) and shape is jr.Sine
        block = jr.Block(half_width, slenderness)
        found = jr.critical_amplitude(
            block, c, shape, duration, model="linearized" if linearized else "nonlinear"
        )
        assert bool(found.complete)
        for k in range(int(found.count)):
            edge = float(found.value[k])
            beyond = bool(found.overturns_beyond[k])
            for factor, expected in ((1 - 1e-6, not beyond), (1 + 1e-6, beyond)):
                numbers = (half_width, slenderness, c, edge * factor, duration)
                outcome = (expected, int(found.impacts[k]))
                cases.setdefault((shape.__name__, linearized), []).append((*numbers, *outcome))
            checked += 1
    for (shape, linearized), some in cases.items():
        half_width, slenderness, c, amplitude, duration, expected, impacts = np.array(some).T
        rocker = stepping.Rocker(half_width, slenderness, c, linearized)
        settle = np.where(expected == 1, 25 / rocker.p, 0.0)
        ground = stepping.pulse(shape, amplitude, duration)
        theirs = stepping.follow(rocker, ground, settle, rtol=1e-11)
        np.testing.assert_array_equal(theirs.overturned, expected)
        np.testing.assert_array_equal(theirs.impacts[expected == 1], impacts[expected == 1])


@pytest.mark.thorough
def test_no_window_of_a_percent_is_missed():
    """Twenty blocks, ratios from 1 to 10, against a search ten times as fine."""
    rng = np.random.default_rng(8)
    block = jr.Block(10 ** rng.uniform(-1.3, -0.3, 20), rng.uniform(2, 9, 20))
    c = rng.uniform(0.6, 0.95, 20)
    duration = rng.uniform(0.3, 1.0, 20)
    coarse = jr.critical_amplitude(block, c, jr.Sine, duration)
    fine = jr.critical_amplitude(block, c, jr.Sine, duration, resolution=1e-3)
    windows = 0
    for k in range(20):
        ours, theirs = (
            np.asarray(found.value[k, : found.count[k]]) for found in (coarse, fine)
        )
        wide = np.ones(theirs.size, bool)
        narrow = np.diff(theirs) < 0.01 * theirs[1:]
        wide[1:] &= ~narrow
        wide[:-1] &= ~narrow
        windows += int((~np.asarray(fine.overturns_beyond[k, : theirs.size])).sum())
        for edge in theirs[wide]:
            assert np.isclose(ours, edge, rtol=1e-10).any(), (k, ours, theirs)
    assert windows >= 8


CASES = {
    "no impact": (jr.HalfSine, 0.1, 5.0, 0.9, 0.5, 0, False),
    "one impact": (jr.Sine, 0.1, 5.0, 0.9, 0.5, 0, False),
    "end of a window": (jr.Sine, 0.1, 5.0, 0.9, 0.5, 1, False),
    "linearized": (jr.Cosine, 0.2, 4.0, 0.8, 0.8, 0, True),
    "falls flat": (jr.Cosine, 0.3852, 1.0, 0.9, 0.52, 2, False),
    "balanced while the ground moves": (jr.Ricker, 0.2336, 2.419, 0.9, 2.5, 0, False),
}


@pytest.mark.parametrize("name", first_by_default(CASES))
def test_derivatives(name):
    """To block, restitution, duration and gravity, against extrapolated differences."""
    shape, *numbers, which, linearized = CASES[name]

    def found(numbers):
        b, slenderness, c, duration, gravity = numbers
        block = jr.Block(b, slenderness, gravity)
        model = "linearized" if linearized else "nonlinear"
        options = {"resolution": 0.05, "model": model}
        return jr.critical_amplitude(block, c, shape, duration, (1.0, 15.0), **options)

    at = jnp.asarray([*numbers, 9.81])
    assert bool(found(at).toppled[which]) == (name == "falls flat")
    forward = jax.jacfwd(lambda at: found(at).value[which])(at)
    if name == "falls flat":
        reverse = jax.grad(lambda at: found(at).value[which])(at)
        np.testing.assert_allclose(reverse, forward, rtol=1e-12)
    # Three step sizes: what is left is of sixth order in them.
    steps = jnp.asarray([s * h for h in (1, 0.5, 0.25) for s in (1, -1)]) * 1e-3
    moved = jnp.broadcast_to(at[:, None, None], (5, 5, 6))
    moved = moved.at[np.arange(5), np.arange(5)].multiply(1 + jnp.broadcast_to(steps, (5, 6)))
    value = found(moved).value[..., which]
    slopes = (value[:, ::2] - value[:, 1::2]) / (2 * steps[None, ::2] * at[:, None])
    exact = (64 * slopes[:, 2] - 20 * slopes[:, 1] + slopes[:, 0]) / 45
    scale = jnp.maximum(abs(exact), 1e-3 * abs(found(at).value[which] / at))
    np.testing.assert_array_less(abs(forward - exact), 1e-7 * scale)


@pytest.mark.thorough
@pytest.mark.release
@pytest.mark.parametrize("name", ["no impact", "on a record"])
def test_second_derivatives(name):
    """All of them, against differences of first ones, which are tested above."""
    record = jr.Record(0.6 * np.array([0, 3, -4, 6, -5, 3, 1, -2, 0.0]), 0.15)

    def edge(at):
        if name == "on a record":
            block = jr.Block(at[0], at[1])
            factors = np.linspace(0.5, 6, 40)
            return jr.overturning_boundaries(block, at[2], record, "factor", factors).value[0]
        block = jr.Block(at[0], at[1], at[4])
        options = {"ratios": (1.0, 9.0), "resolution": 0.05}
        return jr.critical_amplitude(block, at[2], jr.HalfSine, at[3], **options).value[0]

    at = np.array([0.2, 5.0, 0.8] if name == "on a record" else [0.1, 5.0, 0.9, 0.5, 9.81])
    second = jax.jacfwd(jax.jacfwd(edge))(at)
    slopes = jax.jacfwd(edge)

    def difference(step):
        moved = step * np.diag(at)
        return np.stack([(slopes(at + m) - slopes(at - m)) / (2 * m.sum()) for m in moved])

    extrapolated = (4 * difference(1e-4) - difference(2e-4)) / 3
    scale = np.abs(extrapolated) + 1e-2 * abs(edge(at)) / np.outer(at, at)
    np.testing.assert_array_less(np.abs(second - extrapolated), 1e-6 * scale)
    np.testing.assert_allclose(second, second.T, rtol=1e-10, atol=1e-10 * np.max(scale))


def test_other_quantities_lead_to_the_same_boundary():
    """At a critical amplitude duration, size, shape, inertia and restitution are critical, too."""
    block = jr.Block(0.1, 5.0)
    c = 0.9
    duration = 0.5
    amplitude = jr.critical_amplitude(block, c, jr.Sine, duration).value[0]
    pulse = jr.Sine(amplitude, duration)
    for along, value in {
        "duration": duration,
        "half_width": 0.1,
        "slenderness": 5.0,
        "inertia_ratio": 4 / 3,
        "restitution": 0.9,
        "factor": 1.0,
    }.items():
        values = value * np.linspace(0.95, 1.05, 5)
        found = jr.overturning_boundaries(block, c, pulse, along, values)
        assert float(found.value[0]) == pytest.approx(value, rel=1e-9), along


@pytest.mark.thorough
def test_derivatives_under_a_record_are_known_in_all_modes():
    """Of each boundary, also under `jit`: a block on it topples long before the record ends.

    Width and gravity times s make the accelerations that do the same s times as strong.
    """
    suite = jr.example_suite()
    record = suite.scaled(1 / suite.measure("pgv"))[1]
    factors = np.geomspace(0.8, 1.6, 60)

    def edges(half_width, gravity, restitution):
        block = jr.Block(half_width, 4.0, gravity)
        return jr.overturning_boundaries(
            block, restitution, record, "factor", factors, max_boundaries=24
        ).value

    def differentiate(restitution):
        arguments = (0.3, 9.81, restitution)
        value, by_scale = jax.jvp(edges, arguments, (0.3, 9.81, 0.0))
        return value, by_scale, jax.jvp(edges, arguments, (0.0, 0.0, 1.0))[1]

    value, by_scale, by_restitution = differentiate(0.8)
    assert value.size >= 6
    np.testing.assert_allclose(by_scale, value, rtol=1e-9)
    compiled = [column[: value.size] for column in jax.jit(differentiate)(0.8)]
    np.testing.assert_allclose(compiled[0], value, rtol=1e-12)
    np.testing.assert_allclose(compiled[1], by_scale, rtol=1e-9)
    np.testing.assert_allclose(compiled[2], by_restitution, rtol=1e-6)


def test_impacts_are_counted_where_the_block_overturns():
    """Of three boundaries: right above, below and above each, until the block lies."""
    block = jr.Block(0.1, 5.0)
    found = jr.critical_amplitude(block, 0.9, jr.Sine, 0.5, resolution=0.05)
    np.testing.assert_array_equal(found.overturns_beyond, [True, False, True])
    np.testing.assert_array_equal(found.impacts, [1, 1, 0])
    inward = np.where(found.overturns_beyond, 1 + 1e-5, 1 - 1e-5)
    falls = jr.respond_batch(block, 0.9, jr.Sine(inward * np.asarray(found.value), 0.5), 6.0)
    assert falls.overturned.all()
    np.testing.assert_array_equal(falls.impacts, found.impacts)
    np.testing.assert_array_equal(falls.mode, found.impacts)
    stands = jr.respond_batch(block, 0.9, jr.Sine(np.asarray(found.value) / inward, 0.5), 6.0)
    np.testing.assert_array_equal(stands.mode, -1)
