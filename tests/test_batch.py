"""Many blocks at once, against the adaptive integrator and the independent one."""

import csv

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tables.driven_cases import cases
from tools.selection import first_before_release, first_by_default

import jaxrock as jr
from jaxrock.ground_motion import Pulse


@pytest.mark.float64
@pytest.mark.parametrize(("push", "lift"), [(0.36, -0.36), (0.2, -0.8)])
def test_the_ground_lifts_a_block_by_falling_away(push, lift):
    """After a pause that is passed over, with less than the horizontal push it needs alone."""
    horizontal = np.zeros(64)
    vertical = np.zeros(64)
    horizontal[24:32] = push * 9.81
    vertical[24:32] = lift * 9.81
    horizontal[48] = 0.49 * 9.81  # the strongest push, which lifts nothing
    vertical[48] = 0.3 * 9.81
    record = jr.Record(horizontal, 0.02, vertical)
    block = jr.Block(0.3, 2.0)
    found = jr.respond_batch(block, 0.8, record)
    single = jr.respond(block, 0.8, record)
    assert found.peak_rotation == pytest.approx(float(single.peak_rotation), rel=1e-6)
    assert found.peak_rotation > 0


class Hump(Pulse):
    """A shape that users write, by what the docstring of `Pulse` asks for: a half-sine."""

    extremes = (0.0, 0.5, 1.0)
    area = 2 / np.pi
    angle = np.pi
    shape = staticmethod(lambda phase: jnp.sin(np.pi * phase))


def test_a_pulse_of_another_shape():
    block = jr.Block(0.1, 5.0)
    pulse = Hump(3.0, 0.5)
    with pytest.raises(ValueError, match=r"Hump has .* pulse\.sampled\(time_step\)"):
        jr.respond_batch(block, 0.9, pulse)
    peak = float(jr.respond_batch(block, 0.9, jr.HalfSine(3.0, 0.5)).peak_rotation)
    record = pulse.sampled(0.005)
    assert record.end == pulse.end == 0.5
    assert jr.respond_batch(block, 0.9, record).peak_rotation == pytest.approx(peak, rel=1e-3)


@pytest.mark.float64
@pytest.mark.parametrize("component", ["east", "north"])
@pytest.mark.parametrize("vertical", first_by_default([1, 0]))
def test_record_against_independent_integration(component, vertical):
    """All stable cases of the table, of which there are 120."""
    rows = [r for r in cases(1) if (r["component"], r["vertical"]) == (component, vertical)]
    column = {k: np.array([row[k] for row in rows]) for k in rows[0] if k != "component"}
    record = jr.example_record(component, vertical=bool(vertical)).scaled(column["scale"])
    found = jr.respond_batch(
        jr.Block(column["half_width"], column["slenderness"]),
        column["restitution"],
        record,
        60.0,
    )
    assert len(rows) >= 10
    assert found.complete.all()
    np.testing.assert_array_equal(found.overturned, column["overturned"] == 1)
    stands = column["overturned"] == 0
    np.testing.assert_allclose(
        found.peak_rotation[stands], column["peak_rotation"][stands], rtol=1e-8
    )


def pulse_cases(shape):
    """The table of short pulses: blocks, restitution, pulses, peaks, outcomes."""
    with open(stepping.PULSES, encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("shape") == shape]
    column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    block = jr.Block(column["half_width"], column["slenderness"])
    pulse = getattr(jr.ground_motion, shape)(column["amplitude"], column["duration"])
    outcome = column["peak_rotation"], column["overturned"] == 1
    return block, column["restitution"], pulse, *outcome


# Half-width, slenderness, C, a pulse, and the peak rotation by 4,000 steps of DOP853 a pulse:
# the second lobe lifts the block while the bounces of the first die out.
BETWEEN_BOUNCES = [
    (2.4805303226586033, 7.474838151631694, 0.3239355248805619,
     jr.Cosine(1.6932106449220452, 0.045083240950279574), 1.0051038323838e-6),
    (0.2425765947912873, 2.741520433720507, 0.6572164993471779,
     jr.Cosine(4.238013871976618, 0.024220420527126692), 8.324104e-6),
]  # fmt: skip


@pytest.mark.float64
@pytest.mark.parametrize("rtol", first_by_default([1e-9, 1e-13, 1e-5]))
@pytest.mark.parametrize(("half_width", "slenderness", "c", "pulse", "peak"), BETWEEN_BOUNCES)
def test_no_impact_is_passed_over(half_width, slenderness, c, pulse, peak, rtol):
    """However small a part of a step a bounce fills, and whatever the input does meanwhile."""
    found = jr.respond_batch(jr.Block(half_width, slenderness), c, pulse, 8.0, rtol=rtol)
    assert float(found.peak_rotation) == pytest.approx(peak, rel=max(10 * rtol, 1e-7))


@pytest.mark.float64
@pytest.mark.parametrize("kind", first_by_default(["record", "pulse"]))
def test_slopes_where_a_step_ends_at_a_corner(kind):
    """The end of a pulse and the time step of a record move what the block has done by then."""
    samples = 3.0 * np.sin(np.linspace(0, 2 * np.pi, 60))
    make, at = {
        "pulse": (lambda duration: jr.Sine(3.0, duration), 0.4),
        "record": (lambda step: jr.Record(samples, step), 0.01),
    }[kind]

    def answers(x):
        r = jr.respond_batch(jr.Block(0.2, 5.0), 0.85, make(x), 1.5, rtol=1e-12)
        return jnp.stack([r.peak_rotation, r.final_rotation, r.margin])

    slopes = jax.jit(jax.jacfwd(answers))(at)
    h = 1e-5 * at
    differences = (answers(at + h) - answers(at - h)) / (2 * h)
    assert (np.abs(differences) > 1e-3).all()
    np.testing.assert_allclose(slopes, differences, rtol=1e-6)


def barely_lifted(shape):
    """The table of blocks that hardly move: blocks, restitution, pulses, peaks, excess."""
    with open(stepping.BARELY_LIFTED, encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("shape") == shape]
    names = "half_width slenderness restitution amplitude duration peak_rotation"
    columns = (np.array([float(row[name]) for row in rows]) for name in names.split(" "))
    b, slenderness, c, amplitude, duration, peak = columns
    excess = amplitude * slenderness / 9.81 - 1
    return (
        jr.Block(b, slenderness),
        c,
        getattr(jr.ground_motion, shape)(amplitude, duration),
        peak,
        excess,
    )


@pytest.mark.float64
@pytest.mark.parametrize("rtol", first_by_default([1e-9, 1e-12, 1e-5]))
@pytest.mark.parametrize("shape", list(stepping.SHAPES))
def test_blocks_that_are_barely_lifted(shape, rtol):
    """From a ten-thousandth above uplift on: the rotation begins like the third power of time."""
    block, c, pulse, peak, excess = barely_lifted(shape)
    found = jr.respond_batch(block, c, pulse, pulse.end + 1.0, rtol=rtol)
    assert found.complete.all()
    rounding = 3e-14 / excess  # what rounding of the amplitude leaves of its excess
    error = np.abs(found.peak_rotation / peak - 1)
    stands = ~np.asarray(found.overturned)
    assert (error <= 10 * rtol + rounding)[stands].all()
    if rtol == 1e-9:  # nor is the error stated ever less than the true one
        found = jr.respond_within(block, c, pulse, rtol, pulse.end + 1.0)
        error = np.abs(found.response.peak_rotation / peak - 1)
        sure = np.asarray(found.within_tolerance) & stands
        assert sure.sum() > 25
        assert (error <= found.error + rounding)[sure].all()


def test_an_impact_behind_the_input_counts_once():
    """A block that overturns on the other side, however long it is followed: `mode` is the same."""
    block = jr.Block(0.1, 5.0)
    pulse = jr.Sine(6.22, 0.6)
    fallen = jr.respond(block, 0.99, pulse, 6.0)
    assert fallen.final_rotation == -np.pi / 2
    assert fallen.impact_times[-1] > pulse.end
    durations = np.linspace(pulse.end, 4.0, 40)
    found = jr.respond_batch(block, 0.99, pulse, durations)
    np.testing.assert_array_equal(np.unique(found.impacts), fallen.impacts - np.array([1, 0]))
    np.testing.assert_array_equal(found.mode, fallen.impacts)


@pytest.mark.float64
@pytest.mark.parametrize("shape", first_by_default(["Sine", "Cosine", "Ricker"]))
def test_short_pulses_against_independent_integration(shape):
    """1 to 500 ms, 1,000 each; where the pulse is reversed the last bounce may be the highest."""
    block, restitution, pulse, peak, overturned = pulse_cases(shape)
    found = jr.respond_batch(block, restitution, pulse, 10.0)
    assert found.complete.all()
    np.testing.assert_array_equal(found.overturned, overturned)
    stands = ~overturned
    np.testing.assert_allclose(found.peak_rotation[stands], peak[stands], rtol=1e-8)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(
    "shape", first_before_release(["Sine", "Rectangular", "HalfSine", "Cosine", "Ricker"], 1)
)
def test_error_is_what_is_asked_for(shape):
    """Through impacts, from three digits to twelve."""
    rng = np.random.default_rng(3)
    half_width = rng.uniform(0.1, 0.5, 50)
    slenderness = rng.uniform(3, 8, 50)
    restitution = rng.uniform(0.5, 0.95, 50)
    strongest = 1.6 if shape == "Rectangular" else 4
    amplitude = 9.81 / slenderness * rng.uniform(1.2, strongest, 50)
    duration = rng.uniform(0.2, 1, 50)
    rocker = stepping.Rocker(half_width, slenderness, restitution)
    ground = stepping.pulse(shape, amplitude, duration)
    truth = stepping.follow(rocker, ground, 3.0, rtol=1e-13)
    stands = ~truth.overturned
    assert stands.sum() > 5
    block = jr.Block(half_width, slenderness)
    pulse = getattr(jr.ground_motion, shape)(amplitude, duration)
    for rtol in (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12):
        found = jr.respond_batch(block, restitution, pulse, pulse.end + 3.0, rtol=rtol)
        np.testing.assert_array_equal(found.overturned, truth.overturned)
        error = np.abs(found.peak_rotation / truth.peak - 1)[stands]
        assert np.quantile(error, 0.97) < rtol
        assert error.max() < 20 * rtol


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("falls_away", [False, True])
def test_rough_input_against_independent_integration(falls_away):
    """Strong and steep pushes; and ground that falls faster than g, which lifts both sides.

    That is no motion of a block, and the normal force says so, but the integrators agree on it.
    """
    rng = np.random.default_rng(7)
    number, samples = 40, 12
    b = 10 ** rng.uniform(-1, 0.2, number)
    slenderness = rng.uniform(1.5, 7, number)
    c = rng.uniform(0.4, 0.9, number)
    step = np.resize([0.05, 0.3, 0.005], number)
    shaking = np.zeros((2, number, samples))
    shaking[0] = rng.uniform(-20, 20, (number, samples))
    if falls_away:
        step = np.full(number, 0.08)
        shaking[0] = rng.normal(0, 2 * 9.81 / slenderness[:, None], (number, samples))
        shaking[1] = rng.normal(0, 12.0, (number, samples))
        # In half of them both sides are lifted on the way to the second sample.
        shaking[0, ::2, 0] *= 0.4
        shaking[1, ::2, :2] = [0.0, -30.0]

    def value(motion, piece, time):
        left = shaking[:, motion, piece]
        return tuple(left + time / step[motion] * (shaking[:, motion, piece + 1] - left))

    ground = stepping.Ground(step[:, None] * np.arange(samples), value)
    truth = stepping.follow(stepping.Rocker(b, slenderness, c), ground, 0.0, rtol=1e-11)
    record = jr.Record(shaking[0], step, shaking[1])
    found = jr.respond_batch(jr.Block(b, slenderness), c, record, record.end)
    np.testing.assert_array_equal(found.overturned, truth.overturned)
    stands = ~truth.overturned
    assert stands.sum() > number / 3
    np.testing.assert_allclose(found.peak_rotation[stands], truth.peak[stands], rtol=1e-8)
    for k in np.flatnonzero(stands & (truth.peak > 0) & falls_away):
        one = record_of(shaking[0, k], step[k], shaking[1, k])
        block = jr.Block(b[k], slenderness[k])
        r = jr.respond(block, c[k], one, one.time_step * (samples - 1), rtol=1e-11)
        assert float(r.peak_rotation) == pytest.approx(truth.peak[k], rel=1e-8)
        assert (r.friction_demand == np.inf) == (r.normal_force <= 0)
        assert r.normal_force < 0 or k % 2


@pytest.mark.float64
def test_estimate_of_within_covers_what_an_independent_integration_finds():
    block, restitution, pulse, peak, overturned = pulse_cases("Sine")
    found = jr.respond_within(block, restitution, pulse, 1e-6, 10.0)
    assert found.within_tolerance.mean() > 0.99
    np.testing.assert_array_equal(
        found.response.overturned[found.within_tolerance], overturned[found.within_tolerance]
    )
    stands = ~overturned & found.within_tolerance
    error = np.abs(found.response.peak_rotation / peak - 1)[stands]
    assert (error <= np.maximum(found.error[stands], 1e-9)).all()  # to which the table is good
    assert (found.error[stands] <= 1e-6).all()


SHAKEN = np.asarray(jr.example_record("north", vertical=True).acceleration)[1200:1300]
RISING = np.asarray(jr.example_record("north", vertical=True).vertical)[1200:1300]
UPLIFT = 9.81 / 5


def record_of(samples, step, vertical=(), **options):
    """All of one length, so that one program does for all: nothing follows, and after the end."""
    horizontal, vertical = (np.pad(each, (0, 100 - len(each))) for each in (samples, vertical))
    return jr.Record(horizontal, step, vertical, **options)


# In its steps of 0.02 s the block lands and is lifted again.
ROUGH = [
    0.326, -2.498, -1.013, -0.123, 0.614, -3.687, 0.469, 0.661, -2.531, 2.566, 3.945, 0.805
]  # fmt: skip
CORNERS = {
    "vertical, negative, later, other gravity": (
        jr.Block(0.2, 5.0, 8.0), 0.6, record_of(SHAKEN, 0.01, RISING, scale=-1.3, start=0.4), 1.4,
    ),
    "duration inside": (jr.Block(0.2, 5.0), 0.6, record_of(SHAKEN, 0.01), 0.653),
    "squat": (jr.Block(0.5, 1.0), 0.9, record_of(SHAKEN, 0.01, scale=4.0), 0.99),
    "linearly up to uplift and down": (
        jr.Block(0.4, 5.0), 0.7, record_of([1.1 * UPLIFT, 0.0], 0.02), 0.02,
    ),
    "up and down in a step": (
        jr.Block(0.4, 5.0), 0.6,
        record_of([1.05 * UPLIFT, 0.2 * UPLIFT, UPLIFT, 0.0], 0.2), 0.6,
    ),
    "an impact within a step": (
        jr.Block(0.1035, 8.5649), 0.3558, record_of(ROUGH, 0.02), 0.22,
    ),
}  # fmt: skip


@pytest.mark.float64
@pytest.mark.parametrize("corner", CORNERS)
def test_corners_against_adaptive(corner):
    scene = CORNERS[corner]
    r = jr.respond(*scene)
    found = jr.respond_batch(*scene)
    assert found.complete
    scale = float(r.peak_rotation)
    assert float(found.peak_rotation) == pytest.approx(scale, rel=1e-5)
    for name in ("final_rotation", "final_velocity"):
        assert float(getattr(found, name)) == pytest.approx(
            float(getattr(r, name)), rel=1e-5, abs=1e-5 * scale
        )
    assert float(found.margin) == pytest.approx(float(r.margin), rel=1e-5)
    # Those in which it comes to rest, many and small, are not counted.
    assert found.impacts == r.impacts or 2 < found.impacts < r.impacts > 20


@pytest.mark.thorough
@pytest.mark.float64
def test_input_that_just_lifts():
    """Exactly so, where a block would chatter for ever, and by very little."""
    period = np.random.default_rng(0).uniform(0.05, 3, 500)
    block = jr.Block(0.3, 5.0)
    for shape in (jr.Sine, jr.Ricker):
        exactly = jr.respond_batch(block, 0.9, shape(UPLIFT, period), 10.0)
        assert exactly.complete.all()
        assert (exactly.peak_rotation == 0).all()
        beyond = jr.respond_batch(block, 0.9, shape(UPLIFT * (1 + 1e-9), period), 10.0)
        assert beyond.complete.all()
        assert (beyond.peak_rotation < 1e-6).all()


@pytest.mark.thorough
def test_traced_bad_values():
    @jax.jit
    def shaken(samples, start, c):
        record = jr.Record(samples, 0.01, start=start)
        return jr.respond_batch(jr.Block(0.3, 5.0), c, record, 2.0)

    samples = jnp.asarray(np.stack([SHAKEN] * 4), np.float32).at[1, 50].set(jnp.nan)
    c = np.array([0.9, 0.9, jnp.nan, 1.5], np.float32)
    broken = shaken(samples, np.float32(0.1), c)
    assert broken.status.tolist() == [jr.Status.COMPLETE] + 3 * [jr.Status.INVALID]
    assert broken.complete.tolist() == [True, False, False, False]
    assert np.isnan(broken.peak_rotation).tolist() == [False, True, True, True]
    assert not shaken(samples, np.float32(-0.1), c).complete.any()
