import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from references import closed_forms
from tools.selection import first_by_default

import jaxrock as jr

MODELS = [jr.Linearized(), jr.Nonlinear()]


@pytest.mark.float64
@pytest.mark.parametrize("model", MODELS, ids=repr)
@pytest.mark.parametrize("half_cycles", [1, 2, 5, 30, np.inf])
def test_a_hair_below_stands_and_a_hair_above_overturns(model, half_cycles):
    rng = np.random.default_rng(3)
    number = 1000
    block = jr.Block(10 ** rng.uniform(-2, 1, number), 10 ** rng.uniform(-0.5, 2, number))
    restitution = rng.uniform(0, 0.95, number)
    critical = jr.critical_intensity(block, restitution, half_cycles, model)
    below = jr.Scene(block, restitution, critical * (1 - 1e-9))
    above = jr.Scene(block, restitution, critical * (1 + 1e-9))
    assert (
        jr.overturning_half_cycle(below, model) > half_cycles
    ).all() or half_cycles == np.inf
    assert (jr.overturning_half_cycle(above, model) <= half_cycles).all()
    if half_cycles == np.inf:
        assert (jr.overturning_margin(below, model) > 0).all()
        assert (jr.overturning_margin(above, model) < 0).all()


def scene_of_slenderness(slenderness, b):
    return b, slenderness


def scene_of_width(width, b):
    """At the height of the block."""
    return width / 2, 4 * b / width


INVERSES = {
    "slenderness": (scene_of_slenderness, jr.critical_slenderness),
    "width": (scene_of_width, functools.partial(jr.critical_width, fixed="height")),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", INVERSES)
@pytest.mark.parametrize("model", MODELS, ids=repr)
@mp.workdps(700)  # as many as 1 - cos(alpha_c) loses
def test_inverses_at_all_intensities_there_are(model, name):
    """Value and slope, from the smallest to the largest floating-point numbers."""
    dtype = jnp.result_type(float)
    kind = np.finfo(dtype)
    decades = np.log10(float(kind.max)) - 1
    intensity = jnp.asarray(10 ** np.linspace(-decades, decades, 31), dtype)
    scene_of, function = INVERSES[name]

    def invert(intensity):
        return function(jr.Block(0.4, 2.0), 0.7, intensity, model=model)

    found, slope = jax.vmap(jax.value_and_grad(invert))(intensity)
    theirs = getattr(closed_forms, type(model).__name__)
    b, g, c = [mp.mpf(float(x)) for x in np.asarray([0.4, 9.81, 0.7], dtype)]

    def logarithm_of_intensity(logarithm):
        scene = scene_of(mp.exp(logarithm), b)
        return mp.log(closed_forms.critical_intensity(theirs, *scene, g, c, mp.inf))

    beyond = 0
    for given, value, steepness in zip(intensity, found, slope, strict=True):
        given = mp.mpf(float(given))
        if value == np.inf:  # lambda = g b / (0.75 (I / (1 - C))^2)
            assert b * g / 0.75 * ((1 - c) / given) ** 2 > 0.9 * kind.max
            assert steepness == 0
            beyond += 1
            continue
        place = mp.log(mp.mpf(float(value)))
        assert abs(logarithm_of_intensity(place) - mp.log(given)) < 16 * kind.eps, given
        expected = mp.exp(place) / given / mp.diff(logarithm_of_intensity, place)
        if 100 * kind.tiny < abs(expected) < kind.max:
            assert abs(mp.mpf(float(steepness)) / expected - 1) < 100 * kind.eps, given
    assert 5 < beyond < 13 if name == "slenderness" else beyond == 0


@pytest.mark.parametrize("half_cycles", first_by_default([7.0, 2.0, 1e6, np.inf]))
def test_any_restitution_comes_back(half_cycles):
    """Down to where it is lost in the rounding of the intensity, and up to 1."""
    eps = float(jnp.finfo(jnp.result_type(float)).eps)
    restitution = jnp.asarray(
        np.append(10 ** np.linspace(-20, 0, 201), [0.0, 1 - eps, 1 - 9 * eps])
    )
    restitution = restitution[(restitution < 1) | (half_cycles < np.inf)]
    block = jr.Block(0.4, 5.0)
    intensity = jr.critical_intensity(block, restitution, half_cycles)
    found = jr.critical_restitution(block, intensity, half_cycles)
    np.testing.assert_allclose(found, restitution, rtol=16 * eps, atol=16 * eps)
    assert (found >= 0).all()
    assert (found <= 1).all()
    beyond = jr.critical_intensity(block, jnp.asarray([0.0, 1.0]), half_cycles) * jnp.asarray(
        [1 + 32 * eps, 1 - 32 * eps]
    )
    assert jnp.isnan(jr.critical_restitution(block, beyond, half_cycles)).all()


@pytest.mark.float64
@pytest.mark.parametrize("half_cycles", first_by_default([3.0, 2.0, 10.0, 50.0]))
def test_the_restitution_of_1_has_the_derivative_of_an_inverse(half_cycles):
    """At the end of what is allowed, where rounding may put the answer above 1."""
    block = jr.Block(0.4, 5.0)
    intensity = jr.critical_intensity(block, 1.0, half_cycles)
    of_intensity = jax.grad(lambda c: jr.critical_intensity(block, c, half_cycles))(1.0)
    derivative = jax.grad(lambda i: jr.critical_restitution(block, i, half_cycles))(intensity)
    assert derivative == pytest.approx(1 / float(of_intensity), rel=1e-9)


@pytest.mark.float64
def test_the_table_of_critical_values():
    """Blocks of the critical sizes, or restitution, just overturn under the given pulses."""
    block = jr.Block.from_size(width=0.8, height=4.0)
    table = jr.resonance.critical_values(block, 0.7, 0.5, (5.0, np.inf)).table()
    for row in zip(*table.values(), strict=True):
        half_cycles, model, _, width, size, slenderness, restitution, height = row
        for critical in (
            (jr.Block.from_size(width=width, height=4.0), 0.7),
            (jr.Block.from_size(width=size, height=5 * size), 0.7),
            (jr.Block(0.4, slenderness), 0.7),
            (jr.Block.from_size(width=0.8, height=height), 0.7),
            (block, restitution),
        ):
            found = jr.critical_intensity(*critical, half_cycles, model)
            assert float(found) == pytest.approx(0.5, rel=1e-9)
