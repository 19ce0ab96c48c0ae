"""Sign changes of margins that are known, found where halving and interpolation should."""

import jax
import numpy as np
import pytest

from jaxrock.numerics import roots
from jaxrock.numerics.brackets import find_brackets
from jaxrock.numerics.roots import refine_brackets

pytestmark = pytest.mark.float64


def margin(case, value):
    """Smooth in case 0, a jump in 1, a narrow window between modes in 2, none in 3, NaN in 4."""
    margins = [
        np.cos(value),
        np.where(value < 2.3, 1.0, -3.0 + value / 10),
        np.select([value < 4.98, value < 5.03], [-1.0, 0.01], -0.5),
        value + 1,
        np.where(value > 7, np.nan, -1.0),
    ]
    mode = np.where((case == 2) & (value > 4.8) & (value < 5.2), 1, 0)
    return np.choose(case, margins), mode


def test_brackets_and_places():
    sizes = []

    def margin_and_mode(case, value):
        sizes.append(value.size)
        return margin(case, value)

    values = np.broadcast_to(np.linspace(1.0, 9.0, 17), (5, 17))
    found = find_brackets(margin_and_mode, values, 6)
    assert found.sign_changes.tolist() == [3, 1, 2, 0, 0]
    assert found.complete.tolist() == [True, True, True, True, False]
    assert found.negative_first.tolist() == [False, False, True, False, True]
    assert found.column.tolist() == [0, 1, 2, 0, 0, 1]
    stands, falls, left = refine_brackets(lambda *at: margin(*at)[0], found, traced=False)
    np.testing.assert_allclose(
        stands, [*(np.pi * np.r_[0.5:3:1]), 2.3, 4.98, 5.03], rtol=1e-15
    )
    np.testing.assert_allclose(falls, stands, rtol=1e-15)
    assert (left >= 0).all()
    # Far from all that, nothing is halved: every point would have been 5,125.
    assert sum(sizes) < 5 * 17 + 6 * 40


def test_nothing_hides_without_halving():
    found = find_brackets(margin, np.array([[4.0, 6.0], [2.5, 3.0]]), 0)
    assert found.sign_changes.tolist() == [1, 0]
    empty = find_brackets(margin, np.zeros((0, 4)), 3)
    assert empty.sign_changes.size == 0
    assert empty.case.size == 0


def test_steps_ahead_are_those_of_one_by_one(monkeypatch):
    """At jumps in fewer calls, and to the same bits whatever else is sought."""
    values = np.broadcast_to(np.linspace(1.0, 9.0, 17), (5, 17))
    found = find_brackets(margin, values, 6)
    calls = []

    def asked(case, value):
        calls.append(value.size)
        return margin(case, value)[0]

    ahead = refine_brackets(asked, found, traced=False, alone=True)
    several = len(calls)
    counts = found._replace(sign_changes=None, negative_first=None, complete=None)
    monkeypatch.setattr(roots, "_MOST_LEVELS", 1)
    calls.clear()
    single = refine_brackets(asked, found, traced=False, alone=True)
    np.testing.assert_array_equal(ahead, single)
    assert several < len(calls) / 3
    monkeypatch.undo()
    for k in range(found.case.size):
        one = jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], counts)
        np.testing.assert_array_equal(
            refine_brackets(asked, one, traced=False, alone=True), [[row[k]] for row in single]
        )
