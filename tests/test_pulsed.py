"""Resonance under pulses that last, against the closed forms as they become short."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tools.selection import first_before_release

import jaxrock as jr

pytestmark = pytest.mark.float64
BLOCK = jr.Block(0.4, 5.0)
C = 0.7
INTENSITY = 0.15


def half_sine(duration):
    return jr.HalfSine(INTENSITY / duration * np.pi / 2, duration)


@pytest.mark.thorough
def test_order_in_the_duration():
    scene = jr.Scene(BLOCK, C, INTENSITY)
    closed = np.array([
        jr.stabilized_velocity(scene), jr.stabilized_period(scene, "nonlinear"),
        jr.stabilized_rotation(scene, "nonlinear"), C,
    ])  # fmt: skip
    errors = []
    for duration in (4e-3, 2e-3, 1e-3):
        phase = jr.steady.pulsed_phase(BLOCK, C, half_sine(duration))
        assert phase.stands
        found = np.array([phase.velocity, phase.period, phase.peak_rotation, phase.rate])
        errors.append(abs(found - closed))
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 1, atol=0.02)


@pytest.mark.thorough
def test_derivative():
    @jax.jit
    def ratio(at):
        phase = jr.steady.pulsed_phase(BLOCK, at[1], jr.HalfSine(at[0], 0.04))
        return phase.rotation_ratio

    at = np.array([float(half_sine(0.04).amplitude), C])
    found = jax.jit(jax.grad(ratio))(at)
    for k, step in enumerate((1e-2, 1e-3)):
        shift = step * np.eye(2)[k]
        assert float(found[k]) == pytest.approx(
            float(ratio(at + shift) - ratio(at - shift)) / (2 * step), rel=1e-4
        )


class Cases(NamedTuple):
    """Blocks side by side, each with pulses of its own."""

    shape: str
    half_width: np.ndarray
    slenderness: np.ndarray
    restitution: np.ndarray
    amplitude: np.ndarray
    duration: np.ndarray

    def of(self, which):
        return Cases(self.shape, *(each[which] for each in self[1:]))

    def times(self, factor):
        return self._replace(amplitude=factor * self.amplitude)


def landings(cases, velocity):
    """The half-cycle by DOP853: landing velocities, when, peaks; NaN where they overturn."""
    rocker = stepping.Rocker(*cases[1:4])
    ground = stepping.pulse(cases.shape, *cases[4:])
    start = (np.zeros_like(velocity), cases.restitution * velocity)
    found = stepping.follow(rocker, ground, 40 / rocker.p, 1e-11, start, landings=1)
    first, times = (
        np.array([each[0] if each.size else np.nan for each in lists])
        for lists in (found.impact_velocities, found.impact_times)
    )
    still = (found.impacts == 0) & (velocity == 0) & (found.peak == 0)
    return np.where(still, 0, np.abs(first)), times, found.peak


def repeated(cases, velocity, within, most=400):
    """How pulses go on: dies out, stands (as well as `within`) or overturns; last landings."""
    velocity = velocity.copy()
    outcome = np.full(velocity.size, "neither", object)
    going = np.arange(velocity.size)
    first = None
    for _ in range(most):
        new = landings(cases.of(going), velocity[going])[0]
        old = velocity[going]
        velocity[going] = new
        first = new.copy() if first is None else first
        outcome[going[np.abs(new - old) <= within * new]] = "stands"
        outcome[going[new <= 1e-3 * first[going]]] = "dies"
        outcome[going[np.isnan(new)]] = "overturns"
        going = np.flatnonzero(outcome == "neither")
        if not going.size:
            break
    return outcome, velocity


def one_case(block, c, pulse):
    numbers = (block.half_width, block.slenderness, c, pulse.amplitude, pulse.duration)
    return Cases(type(pulse).__name__, *(np.array([float(number)]) for number in numbers))


def scipy_landing(block, c, pulse, velocity):
    return [each[0] for each in landings(one_case(block, c, pulse), np.array([velocity]))]


def random_cases(rng, shape, number, lengths):
    """Pulses that lift and that do not, of so many 1 / p."""
    b = 10 ** rng.uniform(-1.3, 0.3, number)
    slenderness = rng.uniform(1.5, 10, number)
    rate = stepping.Rocker(b, slenderness, 1.0).p
    length = 10 ** rng.uniform(*np.log10(lengths), number) / rate
    amplitude = 9.81 / slenderness * 10 ** rng.uniform(-0.5, 1, number)
    c = rng.uniform(0.2, 0.92, number)
    return Cases(shape.__name__, b, slenderness, c, amplitude, length / shape.extremes[-1])


def critical(block):
    return float(jr.Nonlinear().critical_velocity(block))


# Block, C, half-sine; how it goes on from rest, and whether another orbit is kept up.
LONG_OR_WEAK = {
    "dies out, another orbit": ((0.434, 8.61), 0.9115, (1.301, 0.0606), "dies", True),
    "dies out, no other": ((0.1, 4.84), 0.3832, (2.2275, 0.4), "dies", False),
    "not lifted, an orbit": ((0.4, 5.0), 0.9, (1.3, 0.1), "dies", True),
    "stands under long pulses": ((0.4, 5.0), 0.3, (3.0, 0.4), "stands", False),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", LONG_OR_WEAK)
def test_where_bounces_die_out(name):
    """Against DOP853, pulse by pulse: 0 with a flag, or an orbit that comes back to itself."""
    numbers, c, pulse, expected, other = LONG_OR_WEAK[name]
    block = jr.Block(*numbers)
    pulse = jr.HalfSine(*pulse)
    phase = jr.steady.pulsed_phase(block, c, pulse)
    assert repeated(one_case(block, c, pulse), np.zeros(1), 1e-5)[0] == [expected]
    assert bool(phase.stands)
    assert not phase.overturns
    assert bool(phase.settles) == (expected == "dies" and not other)
    assert bool(phase.from_rest) == (not other)
    if phase.settles:
        assert phase.velocity == phase.peak_rotation == phase.rotation_ratio == 0
        assert phase.rate == c
        assert np.isnan(phase.period)
        for velocity in np.geomspace(0.01, 1.1, 8) * critical(block):
            assert not scipy_landing(block, c, pulse, velocity)[0] >= velocity
        return
    velocity = float(phase.velocity)
    landing, time, peak = scipy_landing(block, c, pulse, velocity)
    assert landing == pytest.approx(velocity, rel=1e-8)
    assert 2 * time == pytest.approx(float(phase.period), rel=1e-8)
    assert peak == pytest.approx(float(phase.peak_rotation), rel=1e-8)
    beside = [scipy_landing(block, c, pulse, f * velocity)[0] for f in (0.999, 1.001)]
    assert np.diff(beside)[0] / (0.002 * velocity) == pytest.approx(
        float(phase.rate), rel=1e-3
    )


SHAPES = [jr.Rectangular, jr.HalfSine, jr.Sine, jr.Cosine, jr.Ricker]


def kept_up(cases, within=1e-9, most=400):
    """Whether pulses keep a block up that lands next to the critical velocity; with which one."""
    rocker = stepping.Rocker(*cases[1:4])
    verge = 2 * rocker.p * np.sin(rocker.angle / 2) * (1 - 1e-6)
    outcome, last = repeated(cases, verge, within, most)
    return outcome != "overturns", last


@pytest.mark.thorough
@pytest.mark.parametrize("shape", first_before_release(SHAPES[:-1], 1))
def test_random_verges(shape):
    """On both sides, and from rest; unstable where none is given.

    Not for Ricker pulses, which either catch a block at once or leave it where it was, and not
    for short cosines: what they do cancels up to accelerations of a million g.
    """
    lengths = (0.1, 5) if shape is jr.Cosine else (2e-3, 5)
    cases = random_cases(np.random.default_rng(3), shape, 8, lengths)
    verges = [
        jr.steady.critical_pulsed_amplitude(jr.Block(b, slenderness), c, shape, duration)
        for b, slenderness, c, _, duration in zip(*cases[1:], strict=True)
    ]
    amplitude, rate = (
        np.array([float(getattr(v, n)) for v in verges]) for n in ("amplitude", "rate")
    )
    known = np.flatnonzero(np.isfinite(amplitude))
    assert known.size > 3
    assert (np.abs(rate[np.isnan(amplitude)]) > 1).all()
    some = cases._replace(amplitude=amplitude).of(known)
    stays, orbit = kept_up(some.times(1 - 1e-6))
    assert stays.all()
    assert not kept_up(some.times(1 + 1e-6))[0].any()
    _, from_rest = repeated(some.times(1 - 1e-6), np.zeros(known.size), 1e-9)
    there = np.abs(from_rest / orbit - 1) < 1e-6
    assert [bool(verges[k].from_rest) for k in known] == there.tolist()


@pytest.mark.thorough
def test_verge():
    """A phase just below it, none just above; slopes against differences; closed form."""

    def verge(at):
        block = jr.Block(at[0], at[1])
        return jr.steady.critical_pulsed_amplitude(
            block, at[2], jr.HalfSine, at[3], rtol=1e-12
        )

    at = np.array([0.4, 5.0, 0.7, 0.05])
    found = verge(at)
    amplitude = float(found.amplitude)
    assert bool(found.lifts)
    for factor, stands in ((1 - 1e-5, True), (1 + 1e-5, False)):
        pulse = jr.HalfSine(amplitude * factor, 0.05)
        assert bool(jr.steady.pulsed_phase(BLOCK, C, pulse).stands) == stands
    assert found.from_rest
    # On the verge the slope is known from the margin: the map just below it agrees.
    below = jr.steady.pulsed_phase(
        BLOCK, C, jr.HalfSine(amplitude * (1 - 1e-6), 0.05), rtol=1e-12
    )
    assert float(below.rate) == pytest.approx(float(found.rate), rel=1e-4)

    def amplitude_and_rate(at):
        found = verge(at)
        return jnp.stack([found.amplitude, found.rate])

    slopes = jax.jacfwd(amplitude_and_rate)(at)
    for k, step in enumerate(1e-3 * at):

        def difference(h, k=k):
            low, high = (amplitude_and_rate(at + s * h * np.eye(4)[k]) for s in (-1, 1))
            return (high - low) / (2 * h)

        extrapolated = (4 * difference(step / 2) - difference(step)) / 3
        np.testing.assert_allclose(slopes[0, k], extrapolated[0], rtol=1e-7)
        np.testing.assert_allclose(slopes[1, k], extrapolated[1], rtol=1e-5)
    closed = float(jr.critical_intensity(BLOCK, C, np.inf, jr.Nonlinear()))
    errors = [
        float(verge(np.array([0.4, 5.0, 0.7, duration])).intensity) - closed
        for duration in (4e-3, 2e-3, 1e-3)
    ]
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, 1, atol=0.05)
    # Of long pulses the fixed point is lost before, where it meets another one.
    assert np.isnan(verge(np.array([0.4, 5.0, 0.95, 2.0])).amplitude)
