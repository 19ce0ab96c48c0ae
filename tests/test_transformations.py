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
    function, size = CASES[name].ours, len(arguments_of(name))

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
