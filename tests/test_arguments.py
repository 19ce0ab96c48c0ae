"""What is not allowed: an error where it can be said, NaN where it cannot."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tools.selection import first_by_default

import jaxrock as jr

BLOCK = jr.Block(0.4, 5.0)
PULSE = jr.HalfSine(4.0, 0.4)


def total_and_answers(shared, numbers, model):
    """Spoiled is one of the numbers; all elements share a factor of another."""
    b, slenderness, gravity, restitution, intensity = numbers
    block = jr.Block(b * shared["b"], slenderness * shared["slenderness"], gravity)
    scene = jr.Scene(block, restitution, intensity)
    functions = (
        jr.rotation_ratio,
        jr.stabilized_period,
        jr.stabilized_rotation,
        jr.amplification,
        jr.overturning_margin,
        jr.overturning_half_cycle,
    )
    answers = [function(scene, model) for function in functions]
    return sum(jnp.nansum(jnp.where(jnp.isinf(a), 0, a)) for a in answers), answers


with_slopes = jax.jit(jax.value_and_grad(total_and_answers, has_aux=True))


@pytest.mark.parametrize(
    "model", first_by_default([jr.Nonlinear(), jr.Linearized()]), ids=repr
)
@pytest.mark.parametrize("position", range(5))
def test_traced_values_become_nan_and_leave_their_neighbours_alone(model, position):
    numbers = np.full((5, 3), [[0.4], [5.0], [9.81], [0.6], [0.1]])
    shared = {"b": 1.0, "slenderness": 1.0}
    (_, good), whole = with_slopes(shared, numbers, model)
    for wrong in (-1.0, np.nan, np.inf):
        spoiled = numbers.copy()
        spoiled[position, 1] = wrong
        (_, bad), slopes = with_slopes(shared, spoiled, model)
        for expected, found in zip(good, bad, strict=True):
            assert jnp.isnan(found[1])
            assert (expected[::2] == found[::2]).all()
        other = "b" if position == 1 else "slenderness"
        np.testing.assert_allclose(slopes[other], whole[other] * 2 / 3, rtol=1e-5)


def test_derivative_of_an_element_that_is_not_allowed_is_zero():
    def ratio(c):
        return jr.rotation_ratio(jr.Scene(BLOCK, c, 0.1))

    ratios, slopes = jax.vmap(jax.value_and_grad(ratio))(jnp.asarray([0.6, -0.5, 0.99]))
    assert jnp.isnan(ratios).tolist() == [False, True, True]
    assert slopes[0] > 0 == slopes[1] == slopes[2]


def test_integers_take_the_precision_of_the_rest():
    single = np.float32(0.4)
    scene = jr.Scene(jr.Block(single, np.arange(3, 6)), np.float32(0.5), np.float32(0.1))
    assert jr.rotation_ratio(scene).dtype == np.float32


@pytest.mark.parametrize(
    "answer",
    [
        lambda model: jr.critical_intensity(BLOCK, 0.7, model=model),
        lambda model: jr.respond_batch(BLOCK, 0.7, PULSE, model=model).peak_rotation,
        lambda model: jr.resonance_spectrum(5.0, 0.8, 0.7, 0.1, model=model)["rotation_ratio"],
    ],
)
@pytest.mark.thorough
def test_a_model_is_given_itself_or_by_its_name(answer):
    linearized = answer(jr.Linearized())
    nonlinear = answer(jr.Nonlinear())
    assert answer("linearized") == linearized != nonlinear == answer("nonlinear")


def test_arguments_are_guarded_once():
    """Four of these numbers and the inertia ratio have to be finite; a velocity is asked, too."""
    numbers = [0.4, 5.0, 9.81, 0.7, 0.15]

    def ratio(b, slenderness, g, c, i):
        return jr.rotation_ratio(jr.Scene(jr.Block(b, slenderness, g), c, i))

    program = str(jax.make_jaxpr(ratio)(*numbers))
    assert len(re.findall(r"= lt \S+ inf", program)) == 6
