"""Sign changes of margins that are known, found where halving and interpolation should."""

import numpy as np
import pytest

from jaxrock.numerics import EvaluatedMargin, find_brackets, refine_brackets, roots

pytestmark = pytest.mark.float64


def evaluate(case, value):
    """Smooth in case 0, a jump in 1, a narrow window between modes in 2, none in 3, NaN in 4.

    The note is the value.
    """
    margins = [
        np.cos(value),
        np.where(value < 2.3, 1.0, -3.0 + value / 10),
        np.select([value < 4.98, value < 5.03], [-1.0, 0.01], -0.5),
        value + 1,
        np.where(value > 7, np.nan, -1.0),
    ]
    mode = np.where((case == 2) & (value > 4.8) & (value < 5.2), 1, 0)
    return EvaluatedMargin(np.choose(case, margins), mode, value)


PLACES = [*(np.pi * np.r_[0.5:3:1]), 2.3, 4.98, 5.03]


def check_ends(changes):
    """Each end has the evaluation that was made there."""
    assert changes.success.all()
    assert (changes.at_stands.margin >= 0).all()
    assert (changes.at_falls.margin < 0).all()
    np.testing.assert_array_equal(changes.at_stands.note, changes.stands)
    np.testing.assert_array_equal(changes.at_falls.note, changes.falls)


def test_brackets_and_places():
    values = np.broadcast_to(np.linspace(1.0, 9.0, 17), (5, 17))
    found = find_brackets(evaluate, values, 6)
    assert found.sign_changes.tolist() == [3, 1, 2, 0, 0]
    assert found.complete.tolist() == [True, True, True, True, False]
    assert found.negative_first.tolist() == [False, False, True, False, True]
    assert found.column.tolist() == [0, 1, 2, 0, 0, 1]
    changes = refine_brackets(evaluate, found, traced=False)
    np.testing.assert_allclose(changes.stands, PLACES, rtol=1e-15)
    np.testing.assert_allclose(changes.falls, PLACES, rtol=1e-15)
    check_ends(changes)


def test_refinement_ends_at_the_tolerance(monkeypatch):
    """With both ends inside of it, by as many bisections as that takes, whatever the margin."""
    monkeypatch.setattr(roots, "_MOST_LEVELS", 1)
    values = np.broadcast_to(np.linspace(1.0, 9.0, 17), (5, 17))
    found = find_brackets(evaluate, values, 6)
    sizes = []

    def count_and_evaluate(case, value):
        sizes.append(value.size)
        return evaluate(case, value)

    changes = refine_brackets(count_and_evaluate, found, traced=False, tolerance=1e-7)
    np.testing.assert_allclose(changes.stands, PLACES, rtol=1e-7)
    # Relative to the wider end of the bracket as it was found.
    width = abs(found.ends[1] - found.ends[0])
    widest = 1e-7 * np.maximum(abs(found.ends[0]), abs(found.ends[1]))
    assert (abs(changes.falls - changes.stands) <= widest).all()
    assert sum(sizes) == np.ceil(np.log2(width / widest)).sum()
    check_ends(changes)
