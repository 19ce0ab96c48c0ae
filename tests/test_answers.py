"""Every answer is what it was when the table was written; see the README of the tests.

`python tests/tools/write_answers.py --only NAME` is for a change that is meant.
"""

import numpy as np
import pytest
from tables.answers.table import (
    GROUPS,
    Answer,
    describe_change,
    find_group,
    list_changes,
    read_table,
)

pytestmark = pytest.mark.float64


@pytest.mark.parametrize(
    "name",
    [
        name if group.by_default else pytest.param(name, marks=pytest.mark.thorough)
        for name, group in GROUPS.items()
    ],
)
def test_answers_have_not_changed(name):
    """By default those of programs that are small, or that other tests use as well."""
    changes = list_changes(name)
    assert not changes, "\n".join(["", *changes])


def test_every_answer_is_of_a_group():
    assert {find_group(name) for name in read_table()} == set(GROUPS)


@pytest.mark.parametrize(
    ("new", "old", "change"),
    [
        ([1.0, np.nan, np.inf], [1.0, np.nan, np.inf], ""),
        ([1.0, 1e-4], [1.0, 1e-4 + 0.9e-9], ""),  # a thousandth of the largest number counts
        (
            [1.0, 1e-4],
            [1.0, 1e-4 + 1.1e-9],
            "0.0001000011 is now 0.0001 at [1], 1 of 2 differ",
        ),
        (1.0, 1.0 + 2e-6, "1.000002 is now 1.0, 1 of 1 differ"),
        ([1.0, 2.0], [1.0, np.nan], "nan is now 2.0 at [1], 1 of 2 differ"),
        ([1.0, -np.inf], [1.0, np.inf], "inf is now -inf at [1], 1 of 2 differ"),
        ([[1.0, 2.0]], [1.0, 2.0], "shape (2,) is now (1, 2)"),
        ([True, False], [True, True], "True is now False at [1], 1 of 2 differ"),
        (["stands"], ["falls"], "'falls' is now 'stands' at [0], 1 of 1 differ"),
        ([1, 2], [1, 3], "3 is now 2 at [1], 1 of 2 differ"),
        ({"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0}, "b: 3.0 is now 2.0, 1 of 1 differ"),
        ({"a": 1.0}, {"b": 1.0}, "parts ['b'] are now ['a']"),
    ],
)
def test_what_counts_as_a_change(new, old, change):
    assert describe_change(Answer(new, 1e-6), Answer(old, 1e-6)) == change


def test_a_wider_tolerance_is_a_change():
    assert "1e-06" in describe_change(Answer(1.0, 1e-6), Answer(1.0, 1e-9))
