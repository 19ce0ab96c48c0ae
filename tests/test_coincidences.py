"""Slopes where the duration, both ends of the input, samples and impacts coincide.

One-sided differences of values, which are right, say what the slopes on either side are.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxrock as jr

pytestmark = pytest.mark.float64
NAMES = ["half_width", "slenderness", "restitution", "duration", "time_step", "start", "rotation"]
SAMPLES = [4.0, 5.0, -2.0, -6.0, 3.0, 5.0, -3.0, 4.0]
LAST = len(SAMPLES) - 1
DURATION, TIME_STEP, START, ROTATION = 3, 4, 5, 6
FINAL, IMPACT = slice(0, 4), 5


def answers(x):
    record = jr.Record(x[len(NAMES) :], x[TIME_STEP], start=x[START])
    r = jr.respond(
        jr.Block(x[0], x[1]), x[2], record, x[DURATION], rotation=x[ROTATION], rtol=1e-12, listed=32
    )
    final = (r.final_rotation, r.final_velocity, r.peak_rotation, r.margin)
    return jnp.stack([*final, r.friction_demand, r.impact_times[0]])


def padded(function, rows):
    """Of as many scenes as there are, compiled for a number of them."""
    compiled = jax.jit(jax.vmap(function))
    return lambda x: np.asarray(compiled(np.resize(x, (rows, x.shape[1]))))[: len(x)]


values = padded(answers, 31)
jacobians = padded(jax.jacfwd(answers), 6)


def slopes(x):
    # A block at rest does not begin like one that is a little tilted.
    return jacobians(x) * ~((np.arange(x.shape[1]) == ROTATION) & (x == 0))[:, None]


def value(x, answer):
    return float(values(x[None])[0, answer])


def scene(duration, time_step=0.15, start=0.1, rotation=0.0, samples=SAMPLES):
    return np.array([0.3, 4.0, 0.7, duration, time_step, start, rotation, *samples])


def with_impact(vary, gap):
    """The scene whose first impact is where `gap` vanishes, to rounding."""

    def at(number):
        return gap(vary(number), value(vary(number), IMPACT))

    return vary(brentq(at, 3.9, 4.3, xtol=1e-16, rtol=1e-15))


def one_sided(x, side, part=2e-5):
    """Differences to one side, of second order, for all numbers: answers, numbers."""
    steps = side * part * np.maximum(abs(x), 0.1)
    points = [x, *(x + k * np.diag(steps)[i] for k in (1, 2) for i in range(x.size))]
    here, *there = values(np.stack(points))
    near, far = np.split(np.array(there), 2)
    found = ((-3 * here + 4 * near - far) / (2 * steps[:, None])).T
    return found * ~((np.arange(x.size) == ROTATION) & (x == 0))


def close(found, expected, answers=slice(0, 5)):
    return np.isclose(found[answers], expected[answers], rtol=3e-6, atol=3e-6)


CONTINUOUS = {
    "duration on a sample": scene(0.1 + 4 * 0.15),
    "duration on a sample, rounded": scene(np.nextafter(0.1 + 5 * 0.15, 0)),
    "start at 0": scene(0.9, start=0.0),
    "start at 0 of a block that moves": scene(0.9, start=0.0, rotation=0.05),
    "duration at the end": scene(0.1 + LAST * 0.15),
    "duration at the end, rounded": scene(np.nextafter(0.1 + LAST * 0.15, 9)),
}


def test_ends_starts_and_samples():
    found = slopes(np.stack(list(CONTINUOUS.values())))
    for (name, x), slope in zip(CONTINUOUS.items(), found, strict=True):
        later, sooner = one_sided(x, 1), one_sided(x, -1) if x[START] else None
        # At the end of the input: as where that comes later, and the duration sooner.
        expected = later.copy()
        if "end" in name:
            expected[:, DURATION] = sooner[:, DURATION]
            assert not close(later[:, DURATION], sooner[:, DURATION]).all()
        elif sooner is not None:
            assert close(later, sooner).all()
        assert close(slope, expected).all(), name
    # The end of an input that goes on is nothing but the final velocity.
    assert found[0][0, DURATION] == pytest.approx(value(scene(0.7), 1), rel=1e-9)


def test_an_impact_on_a_sample():
    x = with_impact(
        lambda second: scene(1.2, samples=[SAMPLES[0], second, *SAMPLES[2:]]),
        lambda x, impact: impact - (x[START] + 3 * x[TIME_STEP]),
    )
    around = np.stack([x * (1 + k * 2.0**-52 * (np.arange(x.size) == 8)) for k in (-4, 0, 4)])
    for slope in slopes(around):
        assert close(slope, one_sided(x, 1), FINAL).all()


@pytest.mark.parametrize("target", ["duration", "end"])
def test_an_impact_at_an_end(target):
    """The slopes are those of either order of the two, for all numbers the same one."""
    first = value(scene(2.0), IMPACT)
    if target == "duration":
        x, toward, number = scene(first), np.eye(15)[DURATION], DURATION
    else:
        fall = {"rotation": 0.05, "samples": [1.5] * len(SAMPLES)}
        first = value(scene(0.9, 0.2, **fall), IMPACT)
        x, number = scene(0.9, 0.2, first - LAST * 0.03, **fall), START
        x[TIME_STEP], toward = 0.03, np.eye(15)[START] + LAST * np.eye(15)[TIME_STEP]
        for _ in range(40):  # the impact moves with the start of the input
            x[START] += value(x + 0.1 * np.eye(15)[DURATION], IMPACT) - (
                x[START] + LAST * x[TIME_STEP]
            )
    around = np.stack([x] * 5)
    around[:, number] += np.array([-2, -1, 0, 1, 2]) * 2.0**-53
    longer = x + (0.1 if target == "duration" else 0.0) * np.eye(15)[DURATION]
    gap = slopes(longer[None])[0, IMPACT] - toward
    for x, slope in zip(around, slopes(around), strict=True):
        later, sooner = one_sided(x, 1), one_sided(x, -1)
        orders = [np.where(sign * gap > 0, later, sooner) for sign in (1, -1)]
        assert not close(*orders, FINAL).all()
        # Of a velocity that jumps, the other order has no differences.
        assert any(close(slope, order, FINAL).all() for order in orders)


def test_a_pulse_followed_to_its_end():
    """Half of it was lost in a tie."""
    block, pulse = jr.Block(0.3, 4.0), jr.HalfSine(5.0, 0.4, 0.1)

    def final(duration):
        r = jr.respond(block, 0.7, pulse, duration)
        return r.final_rotation, r.final_velocity

    slope, velocity = jax.grad(final, has_aux=True)(0.5)
    assert float(slope) == pytest.approx(float(velocity), rel=1e-8)
    assert float(slope) == pytest.approx(0.254222, rel=1e-5)
