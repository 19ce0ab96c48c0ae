import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.numerics import carlson_rf, jacobi
from jaxrock.numerics.elliptic import carlson_rd


def spread_arguments(dtype, number=300):
    """Three arguments of very different size; in some, two are smallest and equal."""
    rng = np.random.default_rng(7)
    smallest = np.log10(np.finfo(dtype).eps)
    x, y, z = (np.asarray(10 ** rng.uniform(smallest, 0, number), dtype) for _ in range(3))
    x[: number // 4] = 1
    y[: number // 4] = z[: number // 4]
    return x, y, z


@pytest.mark.parametrize(
    "dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.float64)]
)
@pytest.mark.parametrize(
    ("ours", "theirs"), [(carlson_rf, mp.elliprf), (carlson_rd, mp.elliprd)]
)
def test_carlson_against_mpmath(ours, theirs, dtype):
    arguments = spread_arguments(dtype)
    values = np.asarray(jax.jit(ours)(*map(jnp.asarray, arguments)))
    with mp.workdps(25):
        exact = [
            theirs(*(mp.mpf(float(a)) for a in point))
            for point in zip(*arguments, strict=True)
        ]
    errors = [abs(mp.mpf(float(v)) / e - 1) for v, e in zip(values, exact, strict=True)]
    assert max(errors) < 5 * np.finfo(dtype).eps


@pytest.mark.thorough
@pytest.mark.float64
def test_repeated_derivatives_of_rf():
    @jax.jit
    def derivatives(z):
        functions = [lambda z: carlson_rf(jnp.asarray(1.0), jnp.asarray(0.3), z)]
        for _ in range(3):
            functions.append(jax.grad(functions[-1]))
        return [function(z) for function in functions[1:]]

    for order, found in enumerate(derivatives(jnp.asarray(1e-5)), 1):
        exact = mp.diff(lambda z: mp.elliprf(1, mp.mpf(0.3), z), mp.mpf(1e-5), order)
        assert abs(float(found) / float(exact) - 1) < 1e-11, order


@pytest.mark.float64
def test_jacobi_against_mpmath():
    arguments = np.linspace(-9, 9, 37)
    function = jax.jit(jacobi)
    for complement in (1e-30, 1e-9, 0.1, 0.5, 0.99, 0.0, -1e-40, -0.2, -3.0):
        values = np.asarray(function(jnp.asarray(arguments), jnp.asarray(complement)))
        # 1e-40 beside 1 must not be lost.
        with mp.workdps(45):
            exact = [
                [
                    mp.re(mp.ellipfun(name, mp.mpf(u), m=1 - mp.mpf(complement)))
                    for u in arguments
                ]
                for name in ("sn", "cn", "dn")
            ]
        np.testing.assert_allclose(
            values, np.array(exact, float), rtol=0, atol=2e-14, err_msg=f"{complement}"
        )


@pytest.mark.float64
def test_motion_on_the_very_verge_has_its_derivatives():
    """At exactly the critical velocity the parameter of the elliptic functions is 1."""
    model = jr.Nonlinear()
    block = jr.Block(0.4, 2.0)
    verge = model.critical_velocity(block)

    @jax.jit
    @jax.value_and_grad
    def rotation(velocity):
        return model.motion(block, velocity, 1.3)[0]

    step = 1e-5
    slope = (rotation(verge + step)[0] - rotation(verge - step)[0]) / (2 * step)
    np.testing.assert_allclose(rotation(verge)[1], slope, rtol=1e-7)
