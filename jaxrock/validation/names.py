"""Names and flags as arguments."""

from collections.abc import Iterable

import numpy as np

from .arrays import describe


def as_name(
    argument: str, value: object, allowed: Iterable[str], *, or_none: bool = False
) -> str:
    """Return a name as a plain `str`.

    Raises
    ------
    ValueError
        If it is none of those that are allowed. The error names the argument, and says with
        `or_none` that None is allowed as well.
    """
    names = tuple(allowed)
    if isinstance(value, str) and value in names:
        return str(value)
    choice = ", ".join(names) + (", or None" if or_none else "")
    raise ValueError(f"{argument} must be one of {choice}, got {describe(value)}")


def as_flag(argument: str, value: object) -> bool:
    """Return a flag as a plain `bool`; a `ValueError` for anything but True and False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{argument} must be True or False, got {describe(value)}")
    return bool(value)
