"""Names and flags as arguments: plain ones, whatever library they come from."""

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from .arrays import describe

_T = TypeVar("_T")


def as_text(value: _T) -> _T:
    """Return a plain `str` for a string of NumPy, pandas or xarray; anything else as it is.

    An element of a coordinate is a `numpy.str_` or an array without axes. JAX takes both for
    numbers, and neither prints as what it says.
    """
    text: Any = value
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        text = text.item()
    return str(text) if isinstance(text, str) else value  # pyright: ignore[reportReturnType]


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
    name = as_text(value)
    names = tuple(allowed)
    if isinstance(name, str) and name in names:
        return name
    choice = ", ".join(names) + (", or None" if or_none else "")
    raise ValueError(f"{argument} must be one of {choice}, got {describe(name)}")


def require_names(method: Callable[..., _T]) -> Callable[..., _T]:
    """Let a class method say how it is called where arguments are given by their places."""
    names = [
        parameter.name
        for parameter in inspect.signature(method).parameters.values()
        if parameter.kind is parameter.KEYWORD_ONLY
    ]

    @functools.wraps(method)
    def call(cls: type, *values: object, **named: Any) -> _T:
        if values:
            pairs = zip(names, values, strict=False)
            typed = ", ".join(f"{name}={describe(value)}" for name, value in pairs)
            raise TypeError(
                f"{method.__name__} takes its arguments by name:"
                f" {method.__qualname__}({typed})"
            )
        return method(cls, **named)

    return call


def as_flag(argument: str, value: object) -> bool:
    """Return a flag as a plain `bool`; a `ValueError` for anything but True and False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{argument} must be True or False, got {describe(value)}")
    return bool(value)
