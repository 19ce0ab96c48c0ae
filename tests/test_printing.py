"""What is printed of arguments and answers: alone, many, and traced."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.host import format_number

BLOCK = jr.Block(0.1, 5.0)
SINE = jr.Sine(3.0, 0.5)


@pytest.mark.parametrize(
    ("value", "pieces"),
    [
        (0.25, ["0.25 m"]),
        (np.array([2.0, 1.0, np.nan]), ["1 to 2 m", "NaN", "1 of 3"]),
        (np.array([1.0, 1.0]), ["1 m"]),
        (np.full(2, np.nan), ["none of 2"]),
        (np.array([True, False]), ["1 of 2"]),
        ({"a": 1.0, "b": 2.0}, ["a 1", "b 2"]),
    ],
)
def test_a_number_or_the_range_of_an_array_and_its_unit(value, pieces):
    assert all(piece in format_number(value, "m") for piece in pieces)


@pytest.mark.parametrize(
    ("make", "pieces"),
    [
        (lambda c: jr.Scene(BLOCK, c, 0.1), ["half-width 0.1 m", "9.81 m/s2", "0.1 m/s"]),
        (lambda c: jr.DrivenScene(BLOCK, c, SINE), ["restitution 0.7", "3 m/s2", "0.5 s"]),
        (lambda c: jr.Record(c * jnp.array([0.0, 1.0]), 0.1), ["2 samples", "0.1 s"]),
        (lambda c: jr.resonance.Oscillator(6.0, c), ["6 rad/s", "damping ratio 0.7"]),
        (lambda c: jr.model_error(jr.Scene(BLOCK, c, 0.1)), ["linearization", "rotation"]),
        (lambda c: jr.respond_batch(BLOCK, c, SINE), ["overturned", "no"]),
        (lambda c: jr.respond_to_train(BLOCK, c, [0.0], [0.1]), ["overturned", "no"]),
    ],
)
def test_arguments_and_answers_print_their_numbers_with_units(make, pieces):
    c = jnp.asarray(0.7)
    text = str(make(c))
    assert [piece for piece in pieces if piece not in text] == []
    assert repr(make(c)) == text
    traced = []
    jax.eval_shape(lambda c: traced.append(str(make(c))), c)
    assert "traced" in traced[0]


def test_many_print_a_line_for_each_quantity():
    text = str(jr.respond_batch(BLOCK, jnp.array([0.7, 0.9]), jr.Sine(3.5, 0.5)))
    labels = [line[:20].strip() for line in text.splitlines()]
    assert {"peak rotation", "overturned", "impacts"} <= set(labels)
    assert len(set(labels)) == len(labels)
    assert "1 of 2" in text


def test_derivatives_print_as_derivatives():
    scene = jr.Scene(jr.Block(0.4, 5.0), 0.8, 0.1)
    lines = str(jax.grad(jr.rotation_ratio)(scene)).splitlines()
    assert all(line.startswith("d/d ") for line in lines)
    assert [line.rpartition(" ")[2] for line in lines if "gravity" in line] == ["1/(m/s2)"]
    assert "d/d" not in str(scene)
    # Some of these derivatives are numbers that a scene may have, and 0 may be one as well.
    for answer in (jr.overturning_margin, jr.launch_velocity, lambda scene: scene.intensity):
        assert str(jax.grad(answer)(scene)).startswith("d/d half-width")


def test_a_number_outside_of_its_domain_is_no_derivative():
    """Tree operations check nothing."""
    turned = eqx.tree_at(lambda s: s.restitution, jr.Scene(BLOCK, 0.7, 0.1), jnp.asarray(1.4))
    assert "outside" in str(turned)
    assert "restitution 1.4" in str(turned)
    assert "d/d" not in str(turned)


def test_a_status_is_printed_where_something_ran_out():
    response = jr.respond_batch(BLOCK, 0.9, jr.Sine(np.array([1.0, 2.0, 3.0]), 0.5))
    assert jr.Status(2).description not in str(response)
    stopped = eqx.tree_at(lambda response: response.status, response, jnp.array([0, 2, 3]))
    assert f"{jr.Status(2).description}: 1 of 3" in str(stopped)
    assert len({status.description for status in jr.Status} - {""}) == len(jr.Status)
