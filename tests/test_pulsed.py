"""Resonance under pulses that last, against the closed forms as they become short."""

import jax
import numpy as np
import pytest
import stepping

import jaxrock as jr

pytestmark = pytest.mark.float64
BLOCK, C, INTENSITY = jr.Block(0.4, 5.0), 0.7, 0.15


def half_sine(duration):
    return jr.HalfSine(INTENSITY / duration * np.pi / 2, duration)


@pytest.mark.thorough
def test_order_in_the_duration():
    scene = jr.Scene(BLOCK, C, INTENSITY)
    closed = [
        float(jr.stabilized_velocity(scene)),
        float(jr.stabilized_period(scene, jr.Nonlinear())),
        float(jr.stabilized_rotation(scene, jr.Nonlinear())),
        C,
    ]
    errors = []
    for duration in (4e-3, 2e-3, 1e-3):
        phase = jr.pulsed_phase(BLOCK, C, half_sine(duration))
        assert phase.stands
        errors.append(
            [
                abs(float(found) - expected)
                for found, expected in zip(
                    (phase.velocity, phase.period, phase.peak_rotation, phase.rate),
                    closed,
                    strict=True,
                )
            ]
        )
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 1, atol=0.02)


def test_fixed_point_and_rate():
    pulse = half_sine(0.04)
    phase = jr.pulsed_phase(BLOCK, C, pulse)
    velocity, errors = 0.0, []
    for _ in range(12):
        velocity = jr.pulsed_next_velocity(BLOCK, C, pulse, velocity)
        errors.append(float(phase.velocity - velocity))
    rates = np.array(errors[1:]) / errors[:-1]
    assert rates[-1] == pytest.approx(float(phase.rate), rel=1e-2)
    again = jr.pulsed_next_velocity(BLOCK, C, pulse, phase.velocity)
    assert float(again) == pytest.approx(float(phase.velocity), rel=1e-9)


@pytest.mark.thorough
def test_derivative():
    @jax.jit
    def ratio(at):
        phase = jr.pulsed_phase(BLOCK, at[1], jr.HalfSine(at[0], 0.04))
        return phase.rotation_ratio

    at = np.array([float(half_sine(0.04).amplitude), C])
    found = jax.jit(jax.grad(ratio))(at)
    for k, step in enumerate((1e-2, 1e-3)):
        shift = step * np.eye(2)[k]
        assert float(found[k]) == pytest.approx(
            float(ratio(at + shift) - ratio(at - shift)) / (2 * step), rel=1e-4
        )


def scipy_landing(block, c, pulse, velocity, wait, linearized=False):
    """The half-cycle by DOP853: landing velocity, when, and the peak; NaN if none within a wait."""
    numbers = float(block.half_width), float(block.slenderness)
    rocker = stepping.Rocker(*numbers, c, linearized)
    ground = stepping.pulse(type(pulse).__name__, float(pulse.amplitude), float(pulse.duration))
    start = (0.0, c * velocity)
    landing = stepping.follow(rocker, ground, wait, 1e-11, start, landings=1)
    peak = landing.peak[0]
    if landing.impacts[0]:
        return abs(landing.impact_velocities[0][0]), landing.impact_times[0][0], peak
    return (np.nan if velocity or peak else 0.0), np.nan, peak


def scipy_from_rest(block, c, pulse, wait, linearized=False):
    """How pulses go on from rest: dies out, stands, overturns or neither; the last landing."""
    velocities = [scipy_landing(block, c, pulse, 0.0, wait, linearized)[0]]
    for _ in range(60):
        last = velocities[-1]
        if np.isnan(last):
            return "overturns", last
        if last <= 1e-3 * velocities[0]:
            return "dies", last
        velocities.append(scipy_landing(block, c, pulse, last, wait, linearized)[0])
        if abs(velocities[-1] - last) <= 1e-5 * last:
            return "stands", velocities[-1]
    return "neither", velocities[-1]


def critical(block):
    return float(jr.Nonlinear().critical_velocity(block))


# Block, C, half-sine; how it goes on from rest, and whether another orbit is kept up.
LONG_OR_WEAK = {
    "dies out, another orbit": ((0.434, 8.61), 0.9115, (1.301, 0.0606), "dies", True),
    "dies out, no other": ((0.1, 4.84), 0.3832, (2.2275, 0.4), "dies", False),
    "not lifted, an orbit": ((0.4, 5.0), 0.9, (1.3, 0.1), "dies", True),
    "stands under long pulses": ((0.4, 5.0), 0.3, (3.0, 0.4), "stands", False),
}


@pytest.mark.parametrize("name", LONG_OR_WEAK)
def test_where_bounces_die_out(name):
    """Against DOP853, pulse by pulse: 0 with a flag, or an orbit that comes back to itself."""
    numbers, c, pulse, expected, other = LONG_OR_WEAK[name]
    block, pulse = jr.Block(*numbers), jr.HalfSine(*pulse)
    phase = jr.pulsed_phase(block, c, pulse)
    assert scipy_from_rest(block, c, pulse, 3.0)[0] == expected
    assert bool(phase.stands)
    assert not phase.overturns
    assert bool(phase.settles) == (expected == "dies" and not other)
    assert bool(phase.from_rest) == (not other)
    if phase.settles:
        assert phase.velocity == phase.peak_rotation == phase.rotation_ratio == 0
        assert phase.rate == c
        assert np.isnan(phase.period)
        for velocity in np.geomspace(0.01, 1.1, 8) * critical(block):
            assert not scipy_landing(block, c, pulse, velocity, 3.0)[0] >= velocity
        return
    velocity = float(phase.velocity)
    landing, time, peak = scipy_landing(block, c, pulse, velocity, 3.0)
    assert landing == pytest.approx(velocity, rel=1e-8)
    assert 2 * time == pytest.approx(float(phase.period), rel=1e-8)
    assert peak == pytest.approx(float(phase.peak_rotation), rel=1e-8)
    beside = [scipy_landing(block, c, pulse, f * velocity, 3.0)[0] for f in (0.999, 1.001)]
    assert np.diff(beside)[0] / (0.002 * velocity) == pytest.approx(float(phase.rate), rel=1e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [jr.Rectangular, jr.HalfSine, jr.Sine, jr.Cosine, jr.Ricker])
def test_random_pulses(shape):
    """Weak and long ones: outcome and orbits by DOP853, other orbits by a scan of its landings."""
    rng = np.random.default_rng(12)
    outcomes = {"dies": 0, "stands": 0, "overturns": 0, "neither": 0}
    for _ in range(20):
        block = jr.Block(10 ** rng.uniform(-1.3, 0.3), rng.uniform(1.5, 10))
        c, rate = rng.uniform(0.2, 0.92), float(block.frequency_parameter)
        length = 10 ** rng.uniform(-3, np.log10(3)) * 2 / rate
        amplitude = 9.81 / float(block.slenderness) * 10 ** rng.uniform(-0.5, 1)
        pulse = shape(amplitude, length / shape.turns[-1])
        phase = jr.pulsed_phase(block, c, pulse)
        wait = 30 / rate
        outcome, last = scipy_from_rest(block, c, pulse, wait)
        outcomes[outcome] += 1
        if phase.overturns:
            found = "overturns"
        elif not phase.stands:
            found = "neither"
        else:
            found = "stands" if phase.from_rest and not phase.settles else "dies"
        # Slow and irregular motions need not be through after as many landings.
        if outcome != "neither":
            assert found == outcome, (block, c, pulse)
        velocity = float(phase.velocity)
        if phase.stands and not phase.settles:
            landing = scipy_landing(block, c, pulse, velocity, wait)[0]
            assert landing == pytest.approx(velocity, rel=1e-7)
            assert outcome != "stands" or velocity == pytest.approx(last, rel=1e-3)
        if found == "dies":
            # Nothing larger is stable: above it, landings are slower or none.
            low = 1.001 * velocity if velocity else 0.02 * min(1, rate * length) * critical(block)

            def gap(velocity, block=block, c=c, pulse=pulse, wait=wait):
                return scipy_landing(block, c, pulse, velocity, wait)[0] - velocity

            velocities = np.geomspace(low, 1.5 * critical(block), 12)
            gaps = [gap(v) for v in velocities]
            for k in range(11):
                if gaps[k] > 0 and gaps[k + 1] < 0:
                    below, above = velocities[k : k + 2]
                    for _ in range(12):
                        middle = 0.5 * (below + above)
                        below, above = (middle, above) if gap(middle) > 0 else (below, middle)
                    slope = 1 + (gap(above) - gap(below)) / (above - below)
                    assert slope < -1, (block, c, pulse, below)
    assert outcomes["dies"] > 0
    assert outcomes["neither"] < 8


def test_no_phase_and_no_motion():
    over = jr.pulsed_phase(BLOCK, C, jr.HalfSine(100.0, 0.1))
    assert not over.stands
    assert np.isnan(over.rotation_ratio)
    rest = jr.pulsed_phase(BLOCK, C, jr.HalfSine(1.0, 0.1))
    assert rest.stands
    assert rest.rotation_ratio == 0
    assert over.overturns
    assert rest.settles
    with pytest.raises(ValueError, match="restitution must be between 0 and 1"):
        jr.pulsed_phase(BLOCK, 1.5, half_sine(0.1))
    with pytest.raises(ValueError, match=r"rtol must be greater than 0 and at most 0\.001"):
        jr.pulsed_phase(BLOCK, C, half_sine(0.1), rtol=0.5)


@pytest.mark.thorough
def test_verge():
    """A phase just below it, none just above; slopes against differences; closed form."""

    def verge(at):
        block = jr.Block(at[0], at[1])
        return jr.critical_pulsed_amplitude(block, at[2], jr.HalfSine, at[3], rtol=1e-12)

    at = np.array([0.4, 5.0, 0.7, 0.05])
    found = verge(at)
    amplitude = float(found.amplitude)
    assert bool(found.lifts)
    for factor, stands in ((1 - 1e-5, True), (1 + 1e-5, False)):
        pulse = jr.HalfSine(amplitude * factor, 0.05)
        assert bool(jr.pulsed_phase(BLOCK, C, pulse).stands) == stands
    assert found.from_rest
    # On the verge the slope is known from the margin: the map just below it agrees.
    below = jr.pulsed_phase(BLOCK, C, jr.HalfSine(amplitude * (1 - 1e-6), 0.05), rtol=1e-12)
    assert float(below.rate) == pytest.approx(float(found.rate), rel=1e-4)
    slopes = jax.jacfwd(lambda at: verge(at).amplitude)(at)
    for k, step in enumerate(1e-3 * at):

        def difference(h, k=k):
            low, high = (verge(at + s * h * np.eye(4)[k]).amplitude for s in (-1, 1))
            return float(high - low) / (2 * h)

        extrapolated = (4 * difference(step / 2) - difference(step)) / 3
        assert float(slopes[k]) == pytest.approx(extrapolated, rel=1e-7)
    closed = float(jr.critical_intensity(BLOCK, C, np.inf, jr.Nonlinear()))
    errors = [
        float(verge(np.array([0.4, 5.0, 0.7, duration])).intensity) - closed
        for duration in (4e-3, 2e-3, 1e-3)
    ]
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 1, atol=0.05)
    # On both sides of it, down to where it is below uplift, and where pulses overturn the
    # block from rest at less.
    beyond = {"overturns": 0, "settles": 0}
    for half_width, slenderness, c, duration in (
        (0.3303, 9.579, 0.3139, 1.1722),
        (0.0864, 8.467, 0.7398, 0.19183),
        (0.3796, 1.734, 0.7953, 0.036953),
        (0.058, 5.993, 0.5629, 0.00105),
    ):
        block = jr.Block(half_width, slenderness)
        found = jr.critical_pulsed_amplitude(block, c, jr.HalfSine, duration)
        weaker, stronger = (
            jr.pulsed_phase(block, c, jr.HalfSine(found.amplitude * factor, duration))
            for factor in (1 - 1e-6, 1 + 1e-6)
        )
        assert float(weaker.velocity) == pytest.approx(critical(block), rel=1e-4)
        assert weaker.from_rest == found.from_rest
        beyond["overturns"] += int(stronger.overturns)
        beyond["settles"] += int(stronger.settles)
    assert beyond == {"overturns": 2, "settles": 2}
    sine = jr.critical_pulsed_amplitude(jr.Block(0.1376, 1.56), 0.7101, jr.Sine, 0.07204)
    assert sine.lifts
    assert not sine.from_rest
    assert jr.pulsed_phase(
        jr.Block(0.1376, 1.56), 0.7101, jr.Sine(sine.amplitude * 0.9, 0.07204)
    ).overturns
    # Of long pulses the fixed point is lost before, where it meets another one.
    assert np.isnan(verge(np.array([0.4, 5.0, 0.95, 2.0])).amplitude)
