"""Which of the values of a parameter are for the default run."""

import pytest


def first_by_default(values, count=1):
    """The first ones; the others are marked as taking long."""
    values = list(values)
    return values[:count] + [_long(value) for value in values[count:]]


def some_by_default(values, some):
    """Those that are among some; the others are marked as taking long."""
    return [value if value in some else _long(value) for value in values]


def _long(value):
    return pytest.param(value, marks=pytest.mark.thorough)
