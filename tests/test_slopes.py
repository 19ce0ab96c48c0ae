"""Values and slopes point by point, in chunks or not, against `jax.grad` of single points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.sensitivity import array_slopes as slopes

MODELS = [jr.Linearized(), jr.Nonlinear()]


def scenes(*shape):
    rng = np.random.default_rng(3)
    block = jr.Block(rng.uniform(0.2, 0.6, shape), rng.uniform(3, 10, shape))
    return jr.Scene(block, rng.uniform(0.3, 0.8, shape), 0.15)


@pytest.mark.parametrize("model", first_by_default(MODELS))
@pytest.mark.parametrize("chunk", first_by_default([4, 7, 21, 100]))
def test_chunks_against_single_points(monkeypatch, eps, model, chunk):
    monkeypatch.setattr(slopes, "_CHUNK", chunk)
    scene = scenes(3, 7)
    value, slope = jr.value_and_slopes(jr.rotation_ratio)(scene, model)
    assert {leaf.shape for leaf in jax.tree.leaves((value, slope))} == {(3, 7)}
    for at in np.ndindex(3, 7):
        point = jax.tree.map(lambda leaf, at=at: leaf[at] if leaf.ndim else leaf, scene)
        one, gradient = jax.value_and_grad(jr.rotation_ratio)(point, model)
        np.testing.assert_allclose(value[at], one, rtol=1000 * eps)
        for ours, theirs in zip(
            jax.tree.leaves(slope), jax.tree.leaves(gradient), strict=True
        ):
            np.testing.assert_allclose(ours[at], theirs, rtol=1000 * eps)


def test_slopes_beyond_the_threshold_are_no_numbers():
    scene = jr.Scene(jr.Block(0.4, 5.0), 0.7, jnp.asarray([0.15, 0.45]))
    value, slope = jr.value_and_slopes(jr.rotation_ratio)(scene)
    for leaf in (value, *jax.tree.leaves(slope)):
        assert jnp.isnan(leaf).tolist() == [False, True]


@pytest.mark.thorough
@pytest.mark.float64
def test_slopes_of_slopes(monkeypatch):
    monkeypatch.setattr(slopes, "_CHUNK", 4)
    c = jnp.linspace(0.5, 0.8, 10)

    def ratio(c):
        return jr.rotation_ratio(jr.Scene(jr.Block(0.4, 5.0), c, 0.15))

    def slope(c):
        return jr.value_and_slopes(ratio)(c)[1]

    second = jax.vmap(jax.grad(jax.grad(ratio)))(c)
    np.testing.assert_allclose(jax.grad(lambda c: slope(c).sum())(c), second, rtol=1e-12)
    np.testing.assert_allclose(
        jax.jvp(slope, (c,), (jnp.ones_like(c),))[1], second, rtol=1e-12
    )
