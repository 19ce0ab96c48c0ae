"""Ground motions against quadrature and against what their names mean."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from scipy.integrate import quad
from tools.selection import first_by_default

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


SINGLE = functools.partial(jnp.asarray, dtype=jnp.float32)
SAMPLES = np.array([0.0, 3.0, -3.0, 1.0, 0.0], np.float32)
# Their start, the scale and the gravity of the block are defaults, the factor a Python number.
SINGLE_MOTIONS = {
    "pulse": lambda number: jr.Sine(number(3.0), number(0.5)),
    "harmonic": lambda number: jr.Harmonic(number(3.0), number(6.0), 4),
    "record": lambda number: jr.Record(SAMPLES, number(0.2)).scaled(1.1).shifted(0.1),
    "vertical": lambda number: jr.Record(SAMPLES, number(0.2), SAMPLES),
}


def list_precisions(answer):
    """Names of the types of all real numbers in an answer."""
    leaves = [
        leaf for leaf in jax.tree.leaves(answer) if jnp.issubdtype(leaf.dtype, jnp.inexact)
    ]
    return {str(leaf.dtype) for leaf in leaves}


@pytest.mark.float64
@pytest.mark.parametrize("kind", first_by_default(["record", "pulse", "harmonic", "vertical"]))
def test_answers_have_the_precision_that_was_given(kind):
    """Defaults, which nobody gave, do not count; one number in float64 does."""
    block = jr.Block(SINGLE(0.2), SINGLE(5.0))
    scene = block, SINGLE(0.9), SINGLE_MOTIONS[kind](SINGLE)
    answers = [
        jax.eval_shape(lambda: jr.respond(*scene, SINGLE(0.5))),
        jr.respond_batch(*scene),
        jr.respond_within(*scene, 1e-2),
        jr.driven.free_motion_margin(*scene[:2], SINGLE(0.01), SINGLE(0.0)),
    ]
    if isinstance(scene[2], jr.Record):
        answers.append(jr.respond_batch(*scene[:2], jr.Suite([scene[2]])))
    for answer in answers:
        assert list_precisions(answer) == {"float32"}

    with jax.numpy_dtype_promotion("standard"):
        motion = SINGLE_MOTIONS[kind](functools.partial(jnp.asarray, dtype=jnp.float64))
    for answer in (
        jax.eval_shape(lambda: jr.respond(*scene[:2], motion)),
        jr.respond_batch(*scene[:2], motion),
    ):
        assert list_precisions(answer) == {"float64"}
