"""Reverse mode through a whole motion: the gradient with respect to a record, in one sweep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tools.selection import first_by_default

import jaxrock as jr

SWEPT = ("peak_rotation", "final_rotation", "final_velocity", "margin")
STEP = 0.02


def samples_of(*shape, seed=0):
    """Noise under an envelope, strong enough to rock and to overturn blocks."""
    noise = np.random.default_rng(seed).normal(size=(*shape, 300)) * 4
    return jnp.asarray(noise * np.sin(np.linspace(0, np.pi, 300)))


def respond_batch(samples, vertical, restitution, scale, one_sided=False, **options):
    blocks = jr.Block(jnp.linspace(0.15, 0.9, 5), 5.0, one_sided=one_sided)
    record = jr.Record(samples, STEP, vertical, scale=scale, start=0.1)
    response = jr.respond_batch(blocks, restitution, record, 8.0, **options)
    return jnp.stack([getattr(response, name) for name in SWEPT])


CASES = {
    "free-standing": {},
    "one-sided": {"one_sided": True},
    "linearized, moving at the beginning": {
        "model": "linearized",
        "rotation": 0.02,
        "velocity": -0.1,
    },
}


@pytest.mark.float64
@pytest.mark.parametrize("options", first_by_default(CASES.values()), ids=CASES)
def test_a_batch_has_the_derivatives_of_forward_mode(options):
    at = samples_of(5), 0.4 * samples_of(seed=1), jnp.linspace(0.6, 0.95, 5), jnp.ones(5)
    rng = np.random.default_rng(2)
    _, pull = jax.vjp(jax.jit(lambda *at: respond_batch(*at, **options)), *at)
    cotangents = jnp.asarray(rng.normal(size=(4, 5)))
    gradient = pull(cotangents)
    assert jnp.ptp(jnp.sum(gradient[0] != 0, axis=1)) > 0  # they overturn at different times
    push = jax.jit(
        lambda along: jax.jvp(lambda *at: respond_batch(*at, **options), at, along)[1]
    )
    for _ in range(3):
        along = tuple(jnp.asarray(rng.normal(size=part.shape)) for part in at)
        terms = [jnp.sum(part * move) for part, move in zip(gradient, along, strict=True)]
        expected = jnp.sum(cotangents * push(along))
        assert sum(terms) == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.thorough
@pytest.mark.float64
def test_a_pulse_and_a_block_that_is_not_valid():
    @jax.jit
    @jax.vmap
    def differentiate(amplitude, restitution):
        def peak(at, modes):
            block = jr.Block(0.3, 5.0)
            response = jr.respond_batch(block, at[1], jr.Sine(at[0], at[2]), 6.0)
            return response.peak_rotation

        at = jnp.array([amplitude, restitution, 0.6])
        return jax.grad(peak)(at, 0), jax.jacfwd(peak)(at, 0)

    reverse, forward = differentiate(jnp.array([1.0, 2.6, 3.0]), jnp.array([0.9, 0.9, 1.5]))
    np.testing.assert_allclose(reverse, forward, rtol=1e-10, atol=1e-14)
    assert (reverse[1] != 0).all()  # the first one stands, the last one is not valid
    assert not reverse[::2].any()


@pytest.mark.float64
def test_through_a_thousand_impacts_and_several_windows():
    """On a stable orbit: where impacts amplify rounding, two programs differ by more."""
    time = STEP * np.arange(13_000)
    samples = jnp.asarray(8.0 * np.sin(4 * np.pi * time))
    block = jr.Block(0.3, 3.0)

    def velocity(samples):
        response = jr.respond_batch(block, 0.7, jr.Record(samples, STEP))
        return response.final_velocity, response.impacts

    gradient, impacts = jax.jit(jax.grad(velocity, has_aux=True))(samples)
    assert impacts > 1000
    push = jax.jit(
        jax.vmap(lambda along: jax.jvp(velocity, (samples,), (along,), has_aux=True)[1])
    )
    # The orbit forgets what was long ago.
    some = samples.size - np.geomspace(1, 2000, 40).astype(int)
    expected = push(jax.nn.one_hot(some, samples.size))
    np.testing.assert_allclose(gradient[some], expected, atol=1e-9 * abs(gradient).max())


@pytest.mark.float64
def test_one_block_and_differences_of_the_other_integrator():
    samples = samples_of(seed=3)
    along = jnp.asarray(np.random.default_rng(4).normal(size=samples.shape))
    block = jr.Block(0.5, 5.0)

    def respond(samples):
        response = jr.respond(block, 0.9, jr.Record(samples, STEP), rtol=1e-11)
        return response.peak_rotation, response.margin, response.peak_time

    pull = jax.jit(lambda samples: jax.jacrev(lambda at: respond(at)[:2])(samples))
    gradients = pull(samples)
    values, expected = jax.jit(lambda: jax.jvp(respond, (samples,), (along,)))()
    assert values[0] > 0.02
    step = 1e-7
    above, below = (respond(samples + side * step * along) for side in (1, -1))
    for k, gradient in enumerate(gradients):
        assert jnp.vdot(gradient, along) == pytest.approx(float(expected[k]), rel=1e-7)
        difference = (above[k] - below[k]) / (2 * step)
        assert jnp.vdot(gradient, along) == pytest.approx(float(difference), rel=1e-4)
    with pytest.raises(ValueError, match=r"that is not peak_rotation, .* forward mode only"):
        jax.grad(lambda at: respond(at)[2])(samples)


def test_in_both_precisions():
    samples = samples_of(seed=3).astype(jnp.result_type(float))

    def peak(samples):
        return jr.respond_batch(
            jr.Block(0.5, 5.0), 0.9, jr.Record(samples, STEP)
        ).peak_rotation

    gradient = jax.jit(jax.grad(peak))(samples)
    assert gradient.dtype == samples.dtype
    change = jax.jvp(peak, (samples,), (samples,))[1]
    assert float(jnp.vdot(gradient, samples)) == pytest.approx(float(change), rel=1e-3)


@pytest.mark.thorough
@pytest.mark.float64
def test_second_derivatives():
    samples = samples_of(seed=3)

    def peak(factor, samples):
        record = jr.Record(factor * samples, STEP)
        return jr.respond_batch(jr.Block(0.5, 5.0), 0.9, record).peak_rotation

    of_gradient = jax.jit(jax.jacfwd(jax.grad(peak)))(1.0, samples)
    of_slope = jax.jit(jax.jacfwd(jax.jacfwd(peak)))(1.0, samples)
    assert float(of_gradient) == pytest.approx(float(of_slope), rel=1e-9)
