"""Which of the values of a parameter are for the default run."""

import pytest


def first_by_default(values, count=1):
    """The first ones; the others are marked as taking long."""
    values = list(values)
    others = [pytest.param(value, marks=pytest.mark.thorough) for value in values[count:]]
    return values[:count] + others
