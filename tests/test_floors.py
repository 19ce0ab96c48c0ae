"""Records and suites on a floor of a building, and suites in both directions."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scenes import suite
from tools.selection import first_before_release, first_by_default

import jaxrock as jr

NOISE = np.random.default_rng(3).standard_normal(70)  # does not begin or end at rest
STEP = 0.02
EXTRA = 30  # samples of free vibration
BLOCK = jr.Block.from_size(width=0.3, height=1.2)
HAZARD = jr.risk.Hazard([0.2, 1.0, 4.0], [1e-2, 1e-3, 1e-5])


def solve_exactly(samples, step, period, damping, extra):
    """Absolute acceleration of an oscillator, by the exponential of a matrix in many digits."""
    frequency = 2 * mpmath.pi / mpmath.mpf(period)
    decay = 2 * mpmath.mpf(damping) * frequency
    with mpmath.workdps(60 + 4 * int(abs(mpmath.log10(frequency * step)) + 10)):
        # Displacement, velocity, acceleration of the ground and its rate of change.
        matrix = mpmath.zeros(4)
        matrix[0, 1] = matrix[2, 3] = 1
        matrix[1, 0] = -(frequency**2)
        matrix[1, 1] = -decay
        matrix[1, 2] = -1
        advance = mpmath.expm(matrix * mpmath.mpf(step), method="taylor")
        state = mpmath.zeros(4, 1)
        answer = [mpmath.mpf(0)]
        ground = [mpmath.mpf(float(value)) for value in samples]
        for k in range(len(ground) - 1 + extra):
            inside = k < len(ground) - 1
            state[2] = ground[k] if inside else 0
            state[3] = (ground[k + 1] - ground[k]) / mpmath.mpf(step) if inside else 0
            state = advance * state
            answer.append(-(frequency**2) * state[0] - decay * state[1])
        return np.array([float(value) for value in answer])


@pytest.mark.parametrize("ratio", first_by_default([0.3, 50.0, 1e-3, 3.1, 3.2, 1e4], 2))
def test_a_floor_is_exact(ratio, eps):
    """Far below and far above the time step, up to critical damping; also where traced."""
    time_step = float(jnp.asarray(STEP))
    period = float(jnp.asarray(ratio * STEP))
    dampings = jnp.array([0.0, 0.05, 0.5, 1 - 1e-6])
    ground = jr.Record(NOISE, STEP)
    found = ground.on_floor(period, dampings, free_vibration=EXTRA * STEP)
    traced = jax.jit(lambda period: ground.on_floor(period, dampings).acceleration)(period)
    assert traced.shape == (4, 2 * NOISE.size - 1)
    samples = np.asarray(ground.acceleration, float)
    for k, damping in enumerate(dampings):
        expected = solve_exactly(samples, time_step, period, float(damping), EXTRA)
        size = abs(expected).max()
        # A rounding of the phase of an undamped oscillator grows with its number of periods.
        phase = 2 * np.pi / ratio * NOISE.size if damping == 0 else 0.0
        # Where all is concrete, in float64 and rounded once.
        for answer, rounding in ((found, max(2**-52, eps / 100)), (traced, eps)):
            tolerance = size * rounding * (200 + phase)
            part = getattr(answer, "acceleration", answer)[k, : expected.size]
            np.testing.assert_allclose(part, expected, rtol=0, atol=tolerance)


def test_modes_and_floors():
    """Modes add up by participations, what these lack moves with the ground; floors are axes."""
    ground = jr.Record(NOISE, STEP, vertical=NOISE[::-1], scale=-2.0, start=3.0)
    single = [
        np.asarray(ground.on_floor(period, damping, free_vibration=0.2).acceleration)
        for period, damping in ((0.4, 0.02), (0.1, 0.3))
    ]
    together = ground.on_floor([0.4, 0.1], [0.02, 0.3], [1.3, -0.4], free_vibration=0.2)
    padded = np.pad(NOISE, (0, 10))
    expected = 1.3 * single[0] - 0.4 * single[1] + 0.1 * padded
    np.testing.assert_allclose(together.acceleration, expected, rtol=0, atol=1e-6)
    assert float(together.scale) == -2.0
    assert float(together.start) == 3.0
    np.testing.assert_allclose(together.vertical, np.pad(NOISE[::-1], (0, 10)), atol=1e-6)
    weights = np.array([[1.0, 0.0], [0.0, 2.0], [1.3, -0.4]])
    many = ground.on_floor([0.4, 0.1], [0.02, 0.3], weights, free_vibration=0.2)
    rows = [single[0], 2 * single[1] - padded, expected]
    np.testing.assert_allclose(many.acceleration, rows, rtol=0, atol=1e-5)
    assert jr.respond_batch(BLOCK, 0.8, many).overturned.shape == (3,)


def test_a_finer_step_has_the_same_motion(eps):
    """At the samples of the coarse one, and of the ground between them."""
    ground = jr.Record(NOISE, STEP, vertical=NOISE[::-1])
    coarse = ground.on_floor(0.1, free_vibration=0.2)
    # The record's step is divided by 4.
    fine = ground.on_floor(0.1, free_vibration=0.2, time_step=0.006)
    assert float(fine.time_step) == pytest.approx(STEP / 4)
    for name in ("acceleration", "vertical"):
        every = np.asarray(getattr(fine, name))[::4]
        np.testing.assert_allclose(every, getattr(coarse, name), rtol=0, atol=64 * eps)
    assert fine.samples == 4 * (coarse.samples - 1) + 1


@pytest.mark.float64
@pytest.mark.parametrize("period", first_by_default([0.0628, 0.004, 0.063, 0.5, 100.0]))
@pytest.mark.parametrize("damping", first_before_release([0.05, 0.9], 1))
def test_derivatives_in_both_modes(period, damping):
    weights = np.cos(0.3 * np.arange(80))

    def answer(values):
        period, damping, participation, scale, sample = values
        samples = jnp.asarray(NOISE).at[20].set(sample)
        floor = jr.Record(samples, STEP, scale=scale).on_floor(
            period, damping, participation, free_vibration=0.2
        )
        return floor.scale * (floor.acceleration * weights).sum()

    point = jnp.array([period, damping, 1.3, 1.2, 0.7])
    forward = jax.jacfwd(answer)(point)
    reverse = jax.grad(answer)(point)
    np.testing.assert_allclose(forward, reverse, rtol=1e-11, atol=1e-12)
    # Differences of order 4, over a fraction of a radian of all phases.
    phase = 2 * np.pi * STEP / period * NOISE.size
    steps = 2e-3 * np.asarray(point) / np.array([1 + phase, 1 + phase, 1, 1, 1])
    for k, step in enumerate(steps):
        change = step * np.eye(5)[k]
        near = answer(point + change) - answer(point - change)
        far = answer(point + 2 * change) - answer(point - 2 * change)
        difference = (8 * near - far) / (12 * step)
        tolerance = 1e-8 * max(abs(float(forward[k])), 1.0)
        assert float(forward[k]) == pytest.approx(float(difference), abs=tolerance)


@pytest.mark.thorough
def test_a_suite_on_a_floor_keeps_its_ground(eps):
    plain = suite()
    floor = plain.on_floor(0.4, 0.05, 1.2)
    for measure in ("pga", "pgv"):
        np.testing.assert_array_equal(floor.measure(measure), plain.measure(measure))
    both = floor.both_directions()
    np.testing.assert_array_equal(both.measure("pgv"), np.tile(plain.measure("pgv"), 2))
    np.testing.assert_array_equal(
        both[3].acceleration, plain.both_directions().on_floor(0.4, 0.05, 1.2)[3].acceleration
    )
    # Scaled to a level, ground and floor are those of the scaled ground.
    site = jr.risk.Site(floor, HAZARD, spacing=0.1)
    np.testing.assert_array_equal(site.intensities, plain.measure("pgv"))
    rate = jr.risk.overturning_rate(BLOCK, 0.8, site)
    level = float(rate.boundaries.value[0, 0])
    scaled = plain[:1].scaled(plain[:1].factors(level, "pgv")).on_floor(0.4, 0.05, 1.2)
    sides = [
        bool(jr.respond_batch(BLOCK, 0.8, scaled[0].scaled(1 + change)).overturned)
        for change in (-1e-3, 1e-3)
    ]
    assert sides == [False, True]


@pytest.mark.thorough
@pytest.mark.float64
def test_both_directions_count_as_one_record():
    """A block that rocks to both sides does the same in both: nothing may change."""
    plain = suite()
    both = plain.both_directions()
    sites = [jr.risk.Site(motions, HAZARD, spacing=0.1) for motions in (plain, both)]
    uncertain = jr.Uncertain({"restitution": 0.05}, samples=2)
    for options in ({}, {"uncertain": uncertain}):
        one_way, two_ways = (
            jr.risk.overturning_rate(BLOCK, 0.8, site, **options) for site in sites
        )
        for name in ("rate", "standard_error", "not_detected"):
            np.testing.assert_allclose(
                getattr(two_ways, name), getattr(one_way, name), rtol=1e-3, err_msg=name
            )
    curves = [
        jr.risk.fragility(BLOCK, 0.8, motions, [0.4, 1.0, 2.0]) for motions in (plain, both)
    ]
    assert curves[1].attrs["records"] == 3
    assert curves[1].attrs["directions"] == 2
    for name in ("exceedance_low", "exceedance_high", "lognormal_dispersion"):
        np.testing.assert_allclose(curves[1][name], curves[0][name], rtol=1e-9)
    objects = jr.risk.Inventory(["a"], jr.Block(np.array([0.15]), 4.0), 0.8)
    tables = [jr.risk.assess_inventory(objects, site, 1e-3) for site in sites]
    for name in ("dispersion", "standard_error"):
        np.testing.assert_allclose(tables[1][name], tables[0][name], rtol=1e-3)
    assert (tables[1].attrs["record_count"], tables[1].attrs["directions"]) == (3, 2)


@pytest.mark.thorough
@pytest.mark.float64
def test_the_floor_of_a_sample_is_its_own():
    plain = suite()
    site = jr.risk.Site(plain.on_floor([0.4, 0.1], 0.05, [1.2, -0.2]), HAZARD, spacing=0.1)
    coefficients = {"floor_period": 0.3, "width": 0.02, "floor_damping": 0.3}
    uncertain = jr.Uncertain(coefficients, samples=4)
    rate = jr.risk.overturning_rate(BLOCK, 0.8, site, uncertain)
    draws = uncertain.draw(BLOCK, 0.8, on_floor=True)
    assert np.std(np.log(draws.floor.period)) > 0.1
    expected = []
    for k in range(4):
        periods = np.array([0.4, 0.1]) * draws.floor.period[k]
        floor = plain.on_floor(periods, 0.05 * draws.floor.damping[k], [1.2, -0.2])
        block = jax.tree.map(lambda leaf, k=k: leaf[k], draws.block)
        of_sample = jr.risk.Site(floor, HAZARD, spacing=0.1)
        expected.append(float(jr.risk.overturning_rate(block, 0.8, of_sample).rate))
    np.testing.assert_allclose(rate.sample_rates, expected, rtol=1e-3)
    assert np.std(expected) > 0.02 * np.mean(expected)
