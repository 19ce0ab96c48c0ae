"""Which of the values of a parameter are for the default run, and which for releases only."""

import pytest


def first_by_default(values, count=1):
    """The first ones; the others are marked as taking long."""
    values = list(values)
    return values[:count] + [_long(value) for value in values[count:]]


def some_by_default(values, some):
    """Those that are among some; the others are marked as taking long."""
    return [value if value in some else _long(value) for value in values]


def first_before_release(values, count):
    """The first ones; the others are marked as running before a release only."""
    values = list(values)
    marks = [pytest.mark.thorough, pytest.mark.release]
    return values[:count] + [pytest.param(value, marks=marks) for value in values[count:]]


def _long(value):
    return pytest.param(value, marks=pytest.mark.thorough)
