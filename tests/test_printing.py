"""What is printed of arguments and answers: alone, many, and traced."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.host import format_number

BLOCK = jr.Block(0.1, 5.0)


def test_a_number_or_the_range_of_an_array_and_its_unit():
    for value, pieces in (
        (0.25, ["0.25 m"]),
        (np.array([2.0, 1.0, np.nan]), ["1 to 2 m", "NaN", "1 of 3"]),
        (np.full(2, np.nan), ["none of 2"]),
        (np.array([True, False]), ["1 of 2"]),
    ):
        assert all(piece in format_number(value, "m") for piece in pieces)


@pytest.mark.parametrize(
    ("make", "pieces"),
    [
        (lambda c: jr.Scene(BLOCK, c, 0.1), ["half-width 0.1 m", "9.81 m/s2", "0.1 m/s"]),
        (lambda c: jr.Record(c * jnp.array([0.0, 1.0]), 0.1), ["2 samples", "0.1 s"]),
    ],
)
def test_arguments_print_their_numbers_with_units(make, pieces):
    c = jnp.asarray(0.7)
    text = repr(make(c))
    assert [piece for piece in pieces if piece not in text] == []
    traced = []
    jax.eval_shape(lambda c: traced.append(str(make(c))), c)
    assert "traced" in traced[0]


def test_a_status_is_printed_where_something_ran_out():
    response = jr.respond_batch(BLOCK, 0.9, jr.Sine(np.array([1.0, 2.0, 3.0]), 0.5))
    assert jr.Status(2).description not in str(response)
    stopped = eqx.tree_at(lambda response: response.status, response, jnp.array([0, 2, 3]))
    assert f"{jr.Status(2).description}: 1 of 3" in str(stopped)
