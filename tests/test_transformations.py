"""Closed forms under jit, vmap and grad, and broadcasting.

Of every function shapes and precision, for which nothing has to be compiled; the numbers of
one of each kind: a property, broadcast here or inside, by elliptic integrals, by Newton's
method, over time, of a count.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tables.closed_form_cases import CASES, NAMES
from tools.selection import first_by_default

import jaxrock as jr

ONE_OF_EACH_KIND = (
    "Block.frequency_parameter",
    "half_cycle_velocity(5)",
    "Linearized.peak_amplification",
    "Nonlinear.peak_rotation",
    "Oscillator.motion displacement",
    "Nonlinear.half_cycle_duration",
    "Linearized critical_slenderness(5)",
)


@functools.cache
def arguments_of(name):
    samples = CASES[name].sample(np.random.default_rng(11), 6, np.float32)
    return tuple(jnp.asarray(a, np.float32) for a in samples.arguments)


@pytest.mark.parametrize("name", NAMES)
def test_shapes_and_precision(name):
    """Of a grid of the first argument against the others, and of one point."""
    function = CASES[name].ours
    size = len(arguments_of(name))

    def given(shape):
        return jax.ShapeDtypeStruct(shape, np.float32)

    grid = jax.eval_shape(function, given((6, 1)), *[given((1, 6))] * (size - 1))
    assert grid.shape in ((6, 6), (1, 6))  # the first argument may not matter
    one = jax.eval_shape(function, *[given(())] * size)
    assert one.shape == ()
    assert grid.dtype == one.dtype == np.float32


@pytest.mark.parametrize("name", first_by_default(ONE_OF_EACH_KIND, 5))
def test_transformations(name):
    """A grid of the first argument against the others, point by point; one program for all."""
    dtype = jnp.result_type(float)
    function = CASES[name].ours
    arguments = [jnp.asarray(a, dtype) for a in arguments_of(name)]
    direct = np.asarray(function(*arguments))
    assert direct.shape == (6,)
    assert direct.dtype == dtype

    def total(first, *others):
        grid = function(first[:, None], *(a[None, :] for a in others))
        return grid.sum(), jnp.broadcast_to(grid, (6, 6))

    @jax.jit
    def transformed(first, *others):
        points = jnp.broadcast_arrays(first[:, None], *(a[None, :] for a in others))
        one_by_one = jax.vmap(function)(*(a.ravel() for a in points)).reshape(6, 6)
        slopes, grid = jax.grad(total, range(len(arguments)), has_aux=True)(first, *others)
        return grid, one_by_one, slopes

    grid, one_by_one, slopes = transformed(*arguments)
    # Some points are so close to the verge that rounding shows in float32.
    rtol = 1e-11 if dtype == np.float64 else 0.02
    np.testing.assert_allclose(grid, one_by_one, rtol=rtol)
    np.testing.assert_allclose(np.diagonal(grid), direct, rtol=rtol)
    assert all(slope.shape == (6,) and slope.dtype == dtype for slope in slopes)


BLOCK = jr.Block(0.4, 5.0)


def over_intensities(function):
    return lambda i: function(jr.Scene(BLOCK, 0.7, i)), [0.1, 5.0, 0.15]


def one_by_one(function):
    return lambda values: jnp.stack([function(value) for value in values])


def phase_of(c):
    return jr.pulsed_phase(jr.Block(0.2, 5.0), c, jr.HalfSine(6.0, 0.02))


def harmonic(amplitude):
    return jr.harmonic_orbit(BLOCK, 0.9, amplitude, 4.0, model="linearized").peak_rotation


# Values of one quantity, one of which has no answer.
PARTLY = {
    "rotation_ratio": over_intensities(jr.rotation_ratio),
    "nonlinear rotation_ratio": over_intensities(
        lambda s: jr.rotation_ratio(s, jr.Nonlinear())
    ),
    "stabilized_rotation": over_intensities(jr.stabilized_rotation),
    "stabilized_period": over_intensities(jr.stabilized_period),
    "nonlinear stabilized_period": over_intensities(
        lambda s: jr.stabilized_period(s, jr.Nonlinear())
    ),
    "amplification": over_intensities(jr.amplification),
    "overturning_half_cycle": over_intensities(jr.overturning_half_cycle),
    "critical_restitution": (
        lambda i: jr.resonance.critical_restitution(BLOCK, i),
        [0.3, 50.0, 0.4],
    ),
    "hazard": (jr.Hazard([0.1, 1.0], [1e-2, 1e-4]), [0.3, 5.0, 0.7]),
    "pulsed_phase": (one_by_one(lambda c: phase_of(c).rotation_ratio), [0.5, 0.7, 0.9]),
    "pulsed_phase period": (one_by_one(lambda c: phase_of(c).period), [0.5, 0.7, 0.9]),
    "critical_pulsed_amplitude": (
        one_by_one(
            lambda d: (
                jr.critical_pulsed_amplitude(
                    jr.Block(0.49841, 8.1018), 0.6598, jr.HalfSine, d
                ).amplitude
            )
        ),
        [0.05, 1.9552, 0.06],
    ),
    "harmonic_orbit": (harmonic, [0.5, 500.0, 0.6]),
}


@pytest.mark.float64
@pytest.mark.parametrize("name", first_by_default(list(PARTLY), 9))
def test_what_does_not_exist_has_no_derivative(name):
    """Masked on the value, sums over the others have theirs, in both modes."""
    function, values = PARTLY[name]
    values = jnp.asarray(values)
    exist = np.isfinite(function(values))
    assert 0 < exist.sum() < 3, function(values)

    def masked(values):
        answers = function(values)
        return jnp.where(jnp.isfinite(answers), answers, 0).sum()

    backward = jax.grad(masked)(values)
    forward = jax.jacfwd(masked)(values)
    np.testing.assert_allclose(backward, forward, rtol=1e-10)
    assert np.isfinite(backward).all()
    assert (np.asarray(backward)[~exist] == 0).all()
