"""What is not allowed: an error where it can be said, NaN where it cannot."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.driven import require_complete
from jaxrock.resonance import as_model
from jaxrock.validation import as_real, check_increasing

BLOCK = jr.Block(0.4, 5.0)
SCENE = jr.Scene(BLOCK, 0.5, 0.1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: jr.Block(-0.4, 5.0),
            "half_width must be finite and greater than 0, got -0.4",
        ),
        (lambda: jr.Block(0.4, 0), "slenderness must be finite and greater than 0, got 0"),
        (
            lambda: jr.Block(0.4, 5.0, np.nan),
            "gravity must be finite and greater than 0, got nan",
        ),
        (
            lambda: jr.Block(0.4, 5.0, inertia_ratio=0.9),
            "inertia_ratio must be finite and at least 1",
        ),
        (lambda: as_real("width", "wide"), "width must be a real number .* got 'wide'"),
        (lambda: as_real("width", 0.4 + 1j), "width must be a real number"),
        (
            lambda: jr.Block.from_size(width=0.4, height=-1.0),
            "height must be finite and greater",
        ),
        (
            lambda: jr.Block(np.array([0.4, -0.4, 0.0]), 5.0),
            r"half_width .* got -0.4\d* \(first of 2 such elements out of 3\)",
        ),
        (lambda: jr.Scene(BLOCK, 1.2, 0.1), "restitution must be between 0 and 1, got 1.2"),
        (lambda: jr.Scene(BLOCK, -0.1, 0.1), "restitution must be between 0 and 1, got -0.1"),
        (lambda: jr.Scene(BLOCK, 0.5, -1), "intensity must be finite and at least 0, got -1"),
        (
            lambda: jr.Scene(BLOCK, 0.5, np.inf),
            "intensity must be finite and at least 0, got inf",
        ),
        (lambda: jr.Linearized().peak_rotation(BLOCK, -1.0), "velocity must be finite"),
        (lambda: jr.Nonlinear().motion(BLOCK, -1.0, 0.1), "velocity must be finite"),
        (
            lambda: jr.resonance.Oscillator(1.0, 0.1).peak_displacement(-1.0),
            "velocity must be finite",
        ),
        (
            lambda: jr.Linearized().peak_amplification(BLOCK, 0.1, -1.0),
            "growth must be at least",
        ),
        (
            lambda: jr.Block.from_size(width=0.8, height=np.array([4.0, 0.0])),
            "height must be finite",
        ),
        (lambda: as_real("width", 10**400), "width must be a real number"),
        (
            lambda: jr.rotation_ratio(eqx.tree_at(lambda s: s.restitution, SCENE, 1.7)),
            "restitution must be between 0 and 1, got 1.7",
        ),
        (
            lambda: jr.critical_intensity(BLOCK, 2.0),
            "restitution must be between 0 and 1, got 2",
        ),
        (lambda: jr.critical_intensity(BLOCK, 0.5, 0), "half_cycles must be a whole number"),
        (lambda: jr.critical_intensity(BLOCK, 0.5, 1.5), "half_cycles must be a whole number"),
        (
            lambda: jr.resonance.Oscillator(1.0, 1.0),
            "damping_ratio must be at least 0 and less than 1",
        ),
        (lambda: jr.resonance.equivalent_damping(-1.0), "restitution must be between 0 and 1"),
    ],
)
def test_concrete_values_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def total_and_answers(shared, numbers, model):
    """Spoiled is one of the numbers; all elements share a factor of another."""
    b, slenderness, gravity, restitution, intensity = numbers
    scene = jr.Scene(
        jr.Block(b * shared["b"], slenderness * shared["slenderness"], gravity),
        restitution,
        intensity,
    )
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

    restitution = jnp.asarray([0.6, -0.5, 0.99])
    assert jnp.isnan(jax.vmap(ratio)(restitution)).tolist() == [False, True, True]
    slopes = jax.vmap(jax.grad(ratio))(restitution)
    assert slopes[0] > 0
    assert slopes[1] == slopes[2] == 0


def test_integers_take_the_precision_of_the_rest():
    single = np.float32(0.4)
    scene = jr.Scene(jr.Block(single, np.arange(3, 6)), np.float32(0.5), np.float32(0.1))
    assert jr.rotation_ratio(scene).dtype == np.float32
    assert jr.Block(1, 5).half_height == 5


SCENE = jr.Scene(BLOCK, 0.7, 0.1)
PULSE = jr.HalfSine(4.0, 0.4)


@pytest.mark.parametrize(
    "answer",
    [
        lambda model: jr.rotation_ratio(SCENE, model),
        lambda model: jr.critical_intensity(BLOCK, 0.7, model=model),
        lambda model: jr.critical_slenderness(BLOCK, 0.7, 0.1, model=model),
        lambda model: jr.driven.free_motion_margin(BLOCK, 0.7, 0.01, 0.1, model),
        pytest.param(
            lambda model: (
                jr.respond_to_train(BLOCK, 0.7, [0.0, 0.3], [0.1, -0.1], model).peak_rotation
            ),
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            lambda model: jr.respond_batch(BLOCK, 0.7, PULSE, model=model).peak_rotation,
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            lambda model: (
                jr.resonance_spectrum(5.0, 0.8, 0.7, 0.1, model=model).rotation_ratio.values
            ),
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_a_model_is_given_itself_or_by_its_name(answer):
    linearized = answer(jr.Linearized())
    nonlinear = answer(jr.Nonlinear())
    np.testing.assert_array_equal(answer("linearized"), linearized)
    np.testing.assert_array_equal(answer("nonlinear"), nonlinear)
    assert (linearized != nonlinear).all()


def test_what_is_no_model_is_said_in_one_sentence():
    with pytest.raises(
        ValueError, match=r"model must be Linearized\(\), Nonlinear\(\), \"linear"
    ):
        as_model("cubic")
    with pytest.raises(ValueError, match="got the class Linearized"):
        as_model(jr.Linearized)


@pytest.mark.thorough
def test_peak_amplification_leaves_blocks_that_overturn_out():
    def total(half_width, growth):
        return jnp.nansum(
            jr.Nonlinear().peak_amplification(jr.Block(half_width, 5.0), 0.1, growth)
        )

    both = jax.grad(total)(0.4, jnp.asarray([1.0, 100.0]))
    alone = jax.grad(total)(0.4, jnp.asarray([1.0]))
    np.testing.assert_allclose(both, alone, rtol=1e-6)


def test_arguments_are_guarded_once():
    """Four of these numbers and the inertia ratio have to be finite; a velocity is asked, too."""
    numbers = [0.4, 5.0, 9.81, 0.7, 0.15]

    def ratio(b, slenderness, g, c, i):
        return jr.rotation_ratio(jr.Scene(jr.Block(b, slenderness, g), c, i))

    program = str(jax.make_jaxpr(ratio)(*numbers))
    assert len(re.findall(r"= lt \S+ inf", program)) == 6


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([0.1, 0.8, 0.5, 0.4], "levels must increase, got 0.5 after 0.8"),
        ([[1, 2], [4, 4]], "levels must increase, got 4 after 4"),
        ([1.0, np.nan], "levels must increase, got nan after 1"),
    ],
)
def test_values_that_do_not_increase_are_named(values, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        check_increasing("levels", values)


def test_values_that_increase_or_are_traced_pass():
    check_increasing("levels", [0.1])
    check_increasing("levels", [[1, 2], [0, 5]])
    jax.jit(lambda values: check_increasing("levels", values))(jnp.array([2.0, 1.0]))


RECORDS = ("cape mendocino", "napa north")
ALL_BUT_ONE = np.array([[True, True], [True, False]])


@pytest.mark.parametrize(
    ("complete", "labels", "where"),
    [
        (
            ALL_BUT_ONE,
            {"record": RECORDS, "level": [0.4, 0.8]},
            "record 'napa north' at level 0.8",
        ),
        (
            ALL_BUT_ONE,
            {"frequency_ratio": [1.0, 2.0], "sample": None},
            "frequency ratio 2, sample 2",
        ),
        (
            ALL_BUT_ONE & False,
            {"record": RECORDS, "level": [0.4, 0.8]},
            "record 'cape mendocino' at level 0.4 (and 3 others)",
        ),
        (
            ALL_BUT_ONE[:, 1] & False,
            {"object": np.array(["vase", "urn"])},
            "object 'vase' (and 1 other)",
        ),
        (np.array(False), {"factor": "between 0.5 and 2"}, "factor between 0.5 and 2"),
    ],
)
def test_the_first_unfinished_integration_is_named(complete, labels, where):
    with pytest.raises(
        ValueError, match=f"^integration did not finish for {re.escape(where)}$"
    ):
        require_complete(complete, **labels)


def test_finished_integrations_pass():
    require_complete(ALL_BUT_ONE | True, record=RECORDS, level=[0.4, 0.8])
