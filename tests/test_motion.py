"""Ground motions against quadrature and against what their names mean."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from scipy.integrate import quad

import jaxrock as jr

SHAPES = [jr.Rectangular, jr.HalfSine, jr.Sine, jr.Cosine, jr.Ricker]


@pytest.mark.parametrize("shape", SHAPES)
def test_pulse(shape, eps):
    pulse = shape(3.0, 0.5, start=0.2)
    theirs = stepping.SHAPES[shape.__name__]
    times = np.linspace(0.21, float(pulse.end) - 0.01, 57)
    expected = [3 * theirs((t - 0.2) / 0.5) for t in times]
    np.testing.assert_allclose(pulse.horizontal(times), expected, atol=100 * eps)
    assert not pulse.horizontal([0.0, 0.199, float(pulse.end) + 1e-3, 9.0]).any()
    assert not pulse.upward(times).any()
    area = quad(lambda t: 3 * theirs(t / 0.5), 0, float(pulse.end) - 0.2, limit=200)[0]
    assert float(pulse.intensity) == pytest.approx(area, abs=1e-6 if eps > 1e-9 else 1e-12)
    # between the knots the acceleration is monotone
    knots = np.asarray(pulse.knots())
    assert knots[0] == pytest.approx(0.2)
    assert knots[-1] == pytest.approx(float(pulse.end))
    for a, b in itertools.pairwise(knots):
        rise = np.diff(pulse.value(jnp.linspace(a, b, 30))[0])
        assert (rise >= -100 * eps).all() or (rise <= 100 * eps).all()


def test_scaling_and_shifting():
    pulse = jr.Sine(2.0, 0.5).scaled(3.0).shifted(0.25)
    assert float(pulse.horizontal(0.25 + 0.125)) == pytest.approx(6.0, rel=1e-6)
    record = (
        jr.Record([0.0, 1.0, -1.0], 0.1, vertical=[1.0, 0.0, 0.0]).scaled(2.0).shifted(1.0)
    )
    assert float(record.horizontal(1.05)) == pytest.approx(1.0, rel=1e-5)
    assert float(record.upward(1.05)) == pytest.approx(1.0, rel=1e-5)
    assert float(record.intensity) == pytest.approx(2 * 0.1 * 0.5, rel=1e-6)
    slope = jax.grad(lambda d: jr.HalfSine(2.0, d).intensity)(0.5)
    assert float(slope) == pytest.approx(4 / np.pi, rel=1e-6)


def test_several_records_at_once():
    record = jr.Record(jnp.asarray([[0.0, 1.0, 2.0], [3.0, 3.0, 0.0]]), 0.1)
    np.testing.assert_allclose(record.horizontal(0.15), [1.5, 1.5], rtol=1e-5)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: jr.Sine(jnp.nan, 1.0), "amplitude must be finite, got nan"),
        (lambda: jr.Sine(1.0, 0.0), "duration must be finite and greater than 0"),
        (lambda: jr.Sine(1.0, 1.0).shifted(-1.0), "start must be finite and at least 0"),
        (lambda: jr.Record([1.0], 0.1), "at least two samples"),
        (lambda: jr.Record([], 0.1), "at least two samples"),
        (
            lambda: jr.Record(np.zeros((0, 10)), 0.1),
            r"acceleration must not be empty, .* \(0, 10\)",
        ),
        (lambda: jr.Record(np.zeros((3, 0, 2)), 0.1), "acceleration must not be empty"),
        (
            lambda: jr.Record([1.0, 2.0], np.zeros(0)),
            r"time_step must not be empty, .* \(0,\)",
        ),
        (lambda: jr.Record([1.0, 2.0], 0.1, np.zeros((0, 2))), "vertical must not be empty"),
        (lambda: jr.Record([1.0, 2.0], 0.1, scale=np.zeros(0)), "scale must not be empty"),
        (lambda: jr.Record([1.0, 2.0], 0.1, start=np.zeros(0)), "start must not be empty"),
        (lambda: jr.Record([1.0, jnp.inf], 0.1), "acceleration must be finite"),
        (lambda: jr.Record([1.0, 2.0], 0.0), "time_step must be finite and greater than 0"),
        (lambda: jr.Record([1.0, 2.0], 0.1, [1.0]), "as many samples as acceleration, 2"),
    ],
)
def test_bad_input(make, words):
    with pytest.raises(ValueError, match=words):
        make()
