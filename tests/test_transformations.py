"""Every public closed-form function under jit, vmap and grad, broadcasting, in both precisions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import CASES, NAMES


def arguments_of(name, dtype):
    return tuple(
        jnp.asarray(a, dtype)
        for a in CASES[name].sample(np.random.default_rng(11), 6, np.float32).arguments
    )


@pytest.mark.parametrize("name", NAMES)
def test_transformations(name):
    function, arguments = CASES[name].ours, arguments_of(name, np.float32)
    direct = np.asarray(function(*arguments))
    assert direct.shape == (6,)
    assert direct.dtype == np.float32
    np.testing.assert_array_equal(jax.jit(function)(*arguments), direct)
    np.testing.assert_array_equal(jax.vmap(function)(*arguments), direct)
    one = function(*(a[0] for a in arguments))
    assert one.shape == ()
    np.testing.assert_allclose(one, direct[0], rtol=1e-6)
    slopes = jax.grad(lambda *a: function(*a).sum(), range(len(arguments)))(*arguments)
    assert all(slope.shape == (6,) and slope.dtype == np.float32 for slope in slopes)


@pytest.mark.parametrize("name", NAMES)
def test_broadcasting(name):
    """A grid of the first argument against the others, as the same points one by one."""
    function, (first, *others) = CASES[name].ours, arguments_of(name, np.float32)
    grid = function(first[:, None], *(a[None, :] for a in others))
    points = jnp.broadcast_arrays(first[:, None], *(a[None, :] for a in others))
    one_by_one = function(*(a.ravel() for a in points)).reshape(6, 6)
    assert grid.shape in ((6, 6), (1, 6))  # the first argument may not matter
    # Some points are so close to the verge that rounding shows.
    np.testing.assert_allclose(jnp.broadcast_to(grid, (6, 6)), one_by_one, rtol=0.02)


@pytest.mark.float64
@pytest.mark.parametrize("name", NAMES)
def test_both_precisions_agree(name):
    function = CASES[name].ours
    single = np.asarray(function(*arguments_of(name, np.float32)))
    double = np.asarray(function(*arguments_of(name, np.float64)))
    assert double.dtype == np.float64
    np.testing.assert_allclose(single, double, rtol=1e-2)
