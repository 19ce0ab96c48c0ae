"""Derivatives under a motion: against differences, their stated errors and ranges."""

import jax
import numpy as np
import pytest
from scenes import record, suite

import jaxrock as jr

BY = "restitution", "half_width", "slenderness", "factor"
BLOCK = jr.Block(0.2, 5.0)
PULSE = jr.Sine(3.0, 0.5)


def differentiate(function, x, step):
    """Central differences, extrapolated from two steps, relative to x; and how far they differ."""

    def divide(h):
        return (function(x + h) - function(x - h)) / (2 * h)

    coarse, fine, finest = (divide(step * x / 2**k) for k in range(3))
    best = (4 * finest - fine) / 3
    return best, np.abs(best - (4 * fine - coarse) / 3)


def change(at, name, value):
    """Change one parameter of scenes (restitution, half-width, slenderness, factor)."""
    columns = [np.broadcast_to(part, np.shape(value)) for part in at]
    columns[BY.index(name)] = value
    return columns


def draw_scenes(kind, size, seed=1):
    """Draw blocks, and the motion that is scaled for each of them."""
    rng = np.random.default_rng(seed)
    slenderness = rng.uniform(3, 10, size)
    uplift = 9.81 / slenderness
    at = rng.uniform(0.6, 0.95, size), rng.uniform(0.1, 1, size), slenderness, np.ones(size)
    strength = uplift * rng.uniform(1.2, 3, size)
    if kind == "record":
        shape = record()
        largest = np.abs(np.asarray(shape.acceleration)).max()
        return at, lambda factor: shape.scaled(strength / largest * factor), 6.0
    duration = rng.uniform(0.3, 0.8, size)
    return at, lambda factor: jr.Sine(strength * factor, duration), 3.0


def compute_peaks(at, make, duration):
    """Compute the peak rotations to full accuracy; NaN where a block overturns."""
    restitution, half_width, slenderness, factor = at
    response = jr.respond_batch(
        jr.Block(half_width, slenderness), restitution, make(factor), duration, rtol=1e-13
    )
    return np.where(response.overturned, np.nan, response.peak_rotation)


@pytest.mark.float64
@pytest.mark.parametrize("kind", ["pulse", pytest.param("record", marks=pytest.mark.thorough)])
def test_errors_and_ranges_are_honest(kind):
    """Of the derivative of 48 blocks to a loose tolerance, and within its range."""
    at, make, duration = draw_scenes(kind, 48)
    restitution, half_width, slenderness, _ = at
    found = jr.derivatives_within(
        jr.Block(half_width, slenderness), restitution, make(1.0), 1e-3, duration
    )
    peaks = compute_peaks(at, make, duration)
    np.testing.assert_allclose(found.value, peaks, rtol=1e-3)
    moving = peaks > 0
    assert moving.sum() > 30
    tested = 0
    for name, x in zip(BY, at, strict=True):
        parts = (found.derivative, found.error, found.below, found.above)
        slope, error, below, above = (np.asarray(part[name]) for part in parts)
        certified = np.asarray(found.within_tolerance[name]) & moving

        def compute(values, name=name):
            return compute_peaks(change(at, name, values), make, duration)

        differences, uncertainty = differentiate(compute, x, 1e-4)
        # The differences are those of one smooth function only if the range is wide enough.
        wide = certified & (np.minimum(x - below, above - x) > 2e-4 * x)
        tested += wide.sum()
        excess = np.abs(slope - differences) - uncertainty
        assert (excess <= error)[wide].all(), name
        for end in (below, above):
            length = np.nan_to_num(0.9 * (end - x))
            half, whole = (compute(x + part * length) - peaks for part in (0.5, 1.0))
            bend = whole - slope * length
            # A parabola through the value, with the slope, and half of the way.
            departure = np.abs(bend - 4 * (half - 0.5 * slope * length))
            allowed = 0.4 * (np.abs(slope * length) + np.abs(bend)) + error * np.abs(length)
            assert (departure <= allowed + 1e-3 * peaks)[certified].all(), name
    assert tested > 100


@pytest.mark.float64
@pytest.mark.thorough
def test_against_another_integrator():
    """Of a pulse, a record and a record of a floor, one-sided or not, by diffrax."""
    one_sided = jr.Block(0.2, 5.0, one_sided=True)
    floor = record().on_floor(0.4, 0.05).scaled(0.4)
    cases = (BLOCK, PULSE), (one_sided, PULSE.scaled(-1.0)), (BLOCK, record()), (BLOCK, floor)
    for block, motion in cases:
        found = jr.derivatives_within(block, 0.85, motion, 1e-6, 4.0, by=BY)

        def compute(name, value, block=block, motion=motion):
            c, half_width, slenderness, factor = change((0.85, 0.2, 5.0, 1.0), name, value)
            changed = jr.Block(half_width, slenderness, one_sided=block.one_sided)
            scaled = motion.scaled(factor)
            response = jr.respond(changed, c, scaled, 4.0, rtol=1e-11, atol=1e-15)
            return float(response.peak_rotation)

        for name in BY:
            x = float(found.at[name])
            near = min(x - float(found.below[name]), float(found.above[name]) - x)
            step = min(1e-3, 0.2 * near / x)
            expected, uncertainty = differentiate(lambda v, n=name: compute(n, v), x, step)
            allowed = float(found.error[name]) + uncertainty + 1e-5 * abs(expected)
            assert abs(float(found.derivative[name]) - expected) <= allowed, (motion, name)


def bisect(is_beyond, low, high):
    """Find two neighbouring values between which a condition changes."""
    at_low = is_beyond(low)
    assert at_low != is_beyond(high)
    while (middle := 0.5 * (low + high)) not in (low, high):
        if is_beyond(middle) == at_low:
            low = middle
        else:
            high = middle
    return low


def assert_not_across(place, name, motion=PULSE, **scene):
    """Derivatives near a coincidence have ranges that end at it, also of the coincidence."""
    for x in place * np.array([1 - 1e-3, 1 - 1e-7, 1.0, 1 + 1e-7, 1 + 1e-3]):
        at = {"restitution": 0.9, "factor": 1.0, **scene, name: x}
        found = jr.derivatives_within(
            BLOCK, at["restitution"], motion.scaled(at["factor"]), 1e-6, 4.0
        )
        unit = x if name == "factor" else 1.0
        below, above = (float(part[name]) * unit for part in (found.below, found.above))
        is_across = below < place * (1 - 1e-9) and above > place * (1 + 1e-9)
        assert not is_across, (x, below, above)


@pytest.mark.float64
@pytest.mark.thorough
def test_a_coincidence_is_not_crossed():
    """An overturning boundary, along the factor and along the restitution."""

    def respond(restitution=0.9, factor=1.0):
        motion = PULSE.scaled(factor)
        return jr.respond(BLOCK, restitution, motion, 4.0, rtol=1e-11, atol=1e-15)

    critical, *_ = jr.critical_amplitude(BLOCK, 0.9, jr.Sine, 0.5).value
    assert_not_across(float(critical) / 3.0, "factor")
    boundary = float(critical) * 1.001 / 3.0
    falls = bisect(lambda c: bool(respond(c, boundary).overturned), 0.5, 1.0)
    assert_not_across(falls, "restitution", factor=boundary)


@pytest.mark.float64
@pytest.mark.thorough
def test_a_grazing_impact_is_not_crossed():
    """A second pulse catches the block just before it lands, or just after."""
    time = np.arange(0.0, 1.0, 0.01)
    first = np.where(time < 0.3, 3.0 * np.sin(np.pi * time / 0.3), 0.0)
    push = np.where(
        (time > 0.35) & (time < 0.85), 3.0 * np.sin(2 * np.pi * (time - 0.35)), 0.0
    )
    motion = jr.Record(first + push, 0.01)

    def lands(factor):
        response = jr.respond(BLOCK, 0.9, motion.scaled(factor), 2.0, rtol=1e-11, atol=1e-15)
        return float(response.impact_times[0]) < float(response.peak_time)

    grazing = bisect(lands, 1.0, 1.05)
    assert lands(grazing - 1e-6)
    assert_not_across(grazing, "factor", motion)


@pytest.mark.float64
@pytest.mark.thorough
def test_two_equal_peaks_are_not_certified():
    """At a restitution at which another bounce becomes the highest, found by another integrator."""
    block = jr.Block.from_size(width=0.5, height=2.0)
    record = jr.example_record().scaled(1.5)

    def is_earlier(restitution):
        response = jr.respond(block, restitution, record, rtol=1e-11, solver="Dopri8")
        return float(response.peak_time) < 11.0

    equal = bisect(is_earlier, 0.666, 0.6665)
    at = np.array([equal - 1e-5, equal, equal + 1e-5])
    found = jr.derivatives_within(block, at, record, 1e-6, by=["restitution"])
    low, high = (np.asarray(part["restitution"]) for part in (found.below, found.above))
    slope = np.asarray(found.derivative["restitution"])
    np.testing.assert_array_equal(found.within_tolerance["restitution"], [True, False, True])
    assert slope[2] > 10 * slope[0] > 0
    assert low[0] < at[0] < high[0] < equal
    assert equal < low[2] < at[2] < high[2]
    assert not low[1] < equal < high[1]


def test_a_derivative_at_the_edge_is_one_sided():
    """Elastic impacts end the range; a block that is not lifted does not move."""
    found = jr.derivatives_within(BLOCK, 1.0, PULSE, 1e-2, 4.0)
    assert float(found.above["restitution"]) == 1
    assert not bool(found.within_tolerance["restitution"])
    assert "one-sided, for a smaller C" in found.explain("restitution")
    still = jr.derivatives_within(BLOCK, 0.9, PULSE.scaled(0.5), 1e-2, 4.0)
    for name in BY:
        assert float(still.derivative[name]) == float(still.error[name]) == 0
    assert float(still.value) == 0
    assert 0.5 * float(still.above["factor"]) < 9.81 / 5 / 3


def test_batches_suites_answers_and_printing():
    """Shapes broadcast; the rotation ratio and the margin follow from the others."""
    blocks = jr.Block(np.array([[0.2], [0.3], [0.4]]), 5.0)
    pulses = jr.Sine(np.array([3.0, 3.3]), 0.5)
    found = jr.derivatives_within(blocks, 0.9, pulses, 1e-2, 4.0)
    assert found.derivative["restitution"].shape == found.above["factor"].shape == (3, 2)
    single = jr.derivatives_within(jr.Block(0.3, 5.0), 0.9, jr.Sine(3.3, 0.5), 1e-2, 4.0)
    slope = float(single.derivative["slenderness"])
    assert float(found.derivative["slenderness"][1, 1]) == pytest.approx(slope, rel=1e-3)
    for part in (float(single.value), slope):
        assert f"{part:.2g}"[:4] in str(single)
    assert f"+- {float(single.error['slenderness']):.1g}, for lambda from" in str(single)
    ratio = jr.derivatives_within(
        jr.Block(0.3, 5.0), 0.9, jr.Sine(3.3, 0.5), 1e-2, 4.0, of="rotation_ratio"
    )
    angle = float(np.arctan(1 / 5))
    # The angle itself depends on the slenderness.
    expected = slope / angle + float(single.value) / angle**2 / 26
    assert float(ratio.derivative["slenderness"]) == pytest.approx(expected, rel=1e-3)
    margin = jr.derivatives_within(
        jr.Block(0.3, 5.0), 0.9, jr.Sine(3.3, 0.5), 1e-2, 4.0, of="margin"
    )
    response = jr.respond_batch(jr.Block(0.3, 5.0), 0.9, jr.Sine(3.3, 0.5), 4.0)
    assert float(margin.value) == pytest.approx(float(response.margin), rel=1e-3)


@pytest.mark.thorough
def test_a_suite():
    found = jr.derivatives_within(BLOCK, 0.8, suite(), 1e-2)
    assert found.derivative["factor"].shape == (3,)
    alone = jr.derivatives_within(BLOCK, 0.8, record(200, 1), 1e-2)
    slope = float(alone.derivative["factor"])
    assert float(found.derivative["factor"][1]) == pytest.approx(slope, rel=1e-2)


@pytest.mark.float64
def test_closed_forms():
    """The rotation ratio in full; its range ends at the critical restitution and intensity."""
    found = jr.derivatives_within(BLOCK, 0.7, 0.15, 1e-9, of=jr.rotation_ratio)
    scene = jr.Scene(BLOCK, 0.7, 0.15)
    slopes = jax.grad(jr.rotation_ratio)(scene)
    assert float(found.derivative["restitution"]) == pytest.approx(float(slopes.restitution))
    expected = float(slopes.block.slenderness)
    assert float(found.derivative["slenderness"]) == pytest.approx(expected)
    # alpha_max / alpha_c = 1 - sqrt(1 - x^2), where x = I / I_c.
    critical = float(jr.critical_intensity(BLOCK, 0.7))
    x = 0.15 / critical
    slope = x / critical / (1 - x * x) ** 0.5
    error = abs(float(found.derivative["intensity"]) - slope)
    assert error <= float(found.error["intensity"]) + 1e-15 * slope
    assert float(found.above["intensity"]) == pytest.approx(critical, rel=1e-12)
    end = float(jr.critical_restitution(BLOCK, 0.15))
    assert float(found.above["restitution"]) == pytest.approx(end, rel=1e-12)
    assert all(map(bool, found.within_tolerance.values()))
