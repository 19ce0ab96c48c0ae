"""What is printed of arguments and answers: alone, many, and traced."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.host import format_number

BLOCK = jr.Block(0.1, 5.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.25, "0.25 m"),
        (np.array([2.0, 1.0, np.nan]), "1 to 2 m, NaN in 1 of 3"),
        (np.array([1.0, 1.0]), "1 m"),
        (np.full(2, np.nan), "none of 2"),
        (np.array([True, False]), "1 of 2"),
        (np.array(True), "yes"),
        ({"a": 1.0, "b": 2.0}, "a 1, b 2"),
        (None, "None"),
    ],
)
def test_a_value_and_its_unit(value, text):
    assert format_number(value, "m") == text


@pytest.mark.parametrize(
    ("thing", "text"),
    [
        (lambda c: jr.Scene(BLOCK, c, 0.1), "restitution 0.7, pulses of 0.1 m/s"),
        (lambda c: jr.DrivenScene(BLOCK, c, jr.Sine(3.0, 0.5)), "one-sine pulse of 3 m/s2"),
        (
            lambda c: jr.Record(c * jnp.array([0.0, 1.0]), 0.1),
            "record of 2 samples, step 0.1 s",
        ),
        (lambda c: jr.resonance.Oscillator(6.0, c), "damping ratio 0.7"),
        (
            lambda c: jr.model_error(jr.Scene(BLOCK, c, 0.1)),
            "linearizing             rotation",
        ),
        (lambda c: jr.respond_batch(BLOCK, c, jr.Sine(3.0, 0.5)), "overturned          no"),
        (lambda c: jr.respond_to_train(BLOCK, c, [0.0], [0.1]), "overturned          no"),
    ],
)
def test_arguments_and_answers_print_themselves(thing, text):
    c = jnp.asarray(0.7)
    assert text in str(thing(c))
    traced = []
    jax.eval_shape(lambda c: traced.append(str(thing(c))), c)
    assert "traced" in traced[0]


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (
            jr.overturning.SurvivalWindows(2.0, np.array([[3.0, np.inf]])),
            "stands again from 3 to the end of the range",
        ),
        (
            jr.overturning.SurvivalWindows(np.inf, np.empty((0, 2))),
            "stands everywhere in the range",
        ),
        (
            jr.steady.PulsedThreshold(*jnp.array([2.0, 0.1, 0.5]), *jnp.array([True, False])),
            "amplitude           2 m",
        ),
        (
            jr.steady.PulsedPhase(*jnp.arange(5.0), *jnp.array([True, True, False, False])),
            "period              2 s",
        ),
        (
            jr.sensitivity.MomentEstimate(
                1.0, 0.1, 1.1, 0.2, {"intensity": 1.0}, True, 0.01, 0.02, 0.0
            ),
            "variance fractions  intensity 1",
        ),
        (
            jr.sensitivity.ReliabilityResult(
                0.1, 0.2, 1.0, {"intensity": 1.0}, 0.0, jr.Status.COMPLETE
            ),
            "probability         0.1",
        ),
        (
            jr.sensitivity.DerivativeBasedMeasures(("C",), *np.ones((3, 1)), 0.5, 0.1, 0.0),
            "0.5 +- 0.1",
        ),
    ],
)
def test_results_that_are_never_traced(answer, text):
    assert text in str(answer)


def test_repr_says_what_print_says():
    assert repr(BLOCK) == str(BLOCK) == "half-width 0.1 m, slenderness 5, gravity 9.81 m/s2"
    assert f"{[BLOCK]}" == f"[{BLOCK}]"
    assert repr(jr.Sine(3.0, 0.5)) == "one-sine pulse of 3 m/s2, duration 0.5 s, from 0 s on"


def test_derivatives_print_as_derivatives():
    scene = jr.Scene(jr.Block(0.4, 5.0), 0.8, 0.1)
    lines = str(jax.grad(jr.rotation_ratio)(scene)).splitlines()
    assert lines[0] == "d/d half-width -0.329681 1/m"
    assert lines[2] == "d/d gravity -0.0134427 1/(m/s2)"
    assert lines[-1] == "d/d intensity 2.63745 1/(m/s)"
    assert "d/d" not in str(scene)
    # Some of these derivatives are numbers that a scene may have, and 0 may be one as well.
    for answer in (jr.overturning_margin, jr.launch_velocity, lambda scene: scene.intensity):
        assert str(jax.grad(answer)(scene)).startswith("d/d half-width")
        assert str(jax.grad(answer)(scene).block).startswith("d/d half-width")


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("restitution", 1.4, "restitution 1.4"),
        ("intensity", np.array([0.1, -0.1]), "intensity -0.1 to 0.1 m/s"),
    ],
)
def test_a_number_outside_of_its_domain_is_no_derivative(name, value, text):
    """Tree operations check nothing."""
    for scene in (jr.Scene(BLOCK, 0.7, 0.1), jr.DrivenScene(BLOCK, 0.7, jr.Sine(3.0, 0.5))):
        if hasattr(scene, name):
            changed = eqx.tree_at(lambda s: getattr(s, name), scene, jnp.asarray(value))
            assert str(changed) == f"outside of its domain: {text}"
    turned = eqx.tree_at(lambda block: block.slenderness, BLOCK, jnp.asarray(-5.0))
    assert str(turned) == "outside of its domain: slenderness -5"


@pytest.mark.thorough
def test_a_block_that_is_not_lifted_says_so():
    response = jr.respond(jr.Block(0.2, 5.0), 0.9, jr.HalfSine(0.5, 0.3, start=0.3), 5.0)
    assert str(response).splitlines()[1] == "the ground does not lift the block"


@pytest.mark.thorough
def test_a_block_that_leaves_the_ground_says_when():
    response = jr.respond(jr.Block(0.2, 5.0), 0.9, jr.HalfSine(60.0, 0.3, start=0.3), 5.0)
    assert "the block leaves the ground at 0.4351 s; the model ends there" in str(response)
    assert "inf" not in str(response)


@pytest.mark.thorough
def test_many_at_once():
    restitution = jnp.array([0.7, 0.9])
    response = jr.respond_batch(BLOCK, restitution, jr.Sine(3.5, 0.5))
    assert "overturned          1 of 2" in str(response)
    assert "within tolerance    2 of 2" in str(
        jr.respond_within(BLOCK, restitution, jr.Sine(3.5, 0.5), 1e-3)
    )
    found = jr.critical_amplitude(BLOCK, restitution, jr.Sine, 0.5)
    assert "complete            2 of 2" in str(found)


RESPONSE = jr.respond_batch(BLOCK, 0.9, jr.Sine(np.array([1.0, 2.0, 3.0]), 0.5))


@pytest.mark.parametrize(
    ("status", "line"),
    [
        ([0, 0, 0], None),
        (
            [0, 2, 3],
            "status              ran out of steps, or could not go on: 1 of 3,"
            " an argument is out of range: 1 of 3",
        ),
        (3, "status              an argument is out of range"),
    ],
)
def test_a_status_is_said_where_something_ran_out(status, line):
    result = eqx.tree_at(lambda response: response.status, RESPONSE, jnp.array(status))
    lines = str(result).splitlines()
    if line is None:
        assert not any(text.startswith("status") for text in lines)
    else:
        assert lines[-1] == line


def test_every_status_has_a_description():
    descriptions = {status.description for status in jr.Status}
    assert len(descriptions) == len(jr.Status)
    assert all(descriptions)


def test_a_train_with_too_many_impacts_says_so():
    train = jr.respond_to_train(BLOCK, 1.0, [0.0, 1e6], [0.1, 0.1])
    assert train.status == jr.Status.STOPPED
    assert np.isnan(train.peak_rotation)
    assert "status              ran out of steps, or could not go on" in str(train)
