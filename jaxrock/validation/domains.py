"""Domains: the values that a quantity may have, and errors for concrete ones outside.

A concrete value outside of its domain is a `ValueError` that names the argument, the value and
what is allowed.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .arrays import describe, is_traced


class Domain(NamedTuple):
    """The values that an argument may have."""

    allowed: str  # in words, for the error message
    contains: Callable[[Any], Any]
    stand_in: float  # replaces a value outside


POSITIVE = Domain("finite and greater than 0", lambda x: (x > 0) & (x < jnp.inf), 1.0)


NON_NEGATIVE = Domain("finite and at least 0", lambda x: (x >= 0) & (x < jnp.inf), 0.0)


FINITE = Domain("finite", lambda x: abs(x) < jnp.inf, 0.0)


AT_LEAST_ONE = Domain("finite and at least 1", lambda x: (x >= 1) & (x < jnp.inf), 1.0)


RIGHT_ANGLE = Domain("between 0 and pi / 2", lambda x: (x > 0) & (x < jnp.pi / 2), 1.0)


UNIT_INTERVAL = Domain("between 0 and 1", lambda x: (x >= 0) & (x <= 1), 0.5)


BELOW_ONE = Domain("at least 0 and less than 1", lambda x: (x >= 0) & (x < 1), 0.5)


COUNT = Domain(
    "a whole number from 1 on, or inf", lambda x: (x >= 1) & (x == jnp.floor(x)), 1.0
)


GROWTH = Domain("at least 0", lambda x: x >= 0, 0.0)


def quantity(domain: Domain | None, unit: str = "", own_axes: int = 0) -> Any:
    """Declare a field of a `Checked` module: domain, unit, and axes that are no batch's."""
    return eqx.field(metadata={"domain": domain, "unit": unit, "own_axes": own_axes})


class Checked(eqx.Module):
    """A module whose concrete `quantity` fields are checked when it is made.

    Raises
    ------
    ValueError
        If a concrete value is out of range. A traced one gives NaN.
    """

    def __check_init__(self):
        self.check()

    def check(self) -> None:
        """Check all fields, also those of `Checked` fields.

        Raises
        ------
        ValueError
            If a concrete value is outside of its domain, or if shapes do not broadcast.
        """
        parts = vars(self)  # much faster than attributes of an Equinox module
        for name, domain, _, kind in fields_of(type(self)):
            if kind is not None:
                check_kind(name, parts[name], kind)
            check(name, parts[name], domain)
        check_shapes(itself=self)


def check(name: str, value: Any, domain: Domain | None) -> None:
    """Raise `ValueError` if a value, or a field of a module, is concrete and not in its domain."""
    if isinstance(value, Checked):
        Checked.check(value)
    if domain is None or is_traced(value):
        return
    values = np.asarray(value)
    with np.errstate(invalid="ignore"):
        outside = ~np.asarray(domain.contains(values))
    if outside.any():
        first = f"{float(values[outside].flat[0]):.9g}"
        if values.ndim:
            first = f"{first} (first of {outside.sum()} such elements out of {outside.size})"
        raise ValueError(f"{name} must be {domain.allowed}, got {first}")


def check_kind(name: str, value: Any, *kinds: Any, hint: str = "") -> None:
    """Raise `ValueError` if a value is of none of these classes; the hint says what to do."""
    if not isinstance(value, kinds):
        names = [f"a {'function' if kind is Callable else kind.__name__}" for kind in kinds]
        must = " or ".join([", ".join(names[:-1]), names[-1]][len(names) == 1 :])
        if inspect.isclass(value) and issubclass(value, kinds):
            hint = f"; {value.__name__}(...) makes one"
        if isinstance(value, list | tuple) and any(isinstance(each, kinds) for each in value):
            hint = hint or f"; one {kinds[0].__name__} of arrays stands for many"
        raise ValueError(f"{name} must be {must}, got {describe(value)}{hint}")


def check_shapes(**arguments: Any) -> None:
    """Raise `ValueError` if numbers and those in modules, traced or not, do not broadcast."""
    shapes = [pair for name, value in arguments.items() for pair in _shapes(name, value)]
    if len(some := {shape for _, shape in shapes if shape}) > 1:
        try:
            np.broadcast_shapes(*some)
        except ValueError:
            got = ", ".join(f"{name} of {shape}" for name, shape in shapes if shape)
            raise ValueError(f"shapes must broadcast against each other, got {got}") from None


def _shapes(name: str, value: Any, own_axes: int = 0) -> list[tuple[str, tuple[int, ...]]]:
    if not isinstance(value, Checked):
        shape = getattr(value, "shape", ())
        return [(name, shape[: len(shape) - own_axes])]
    fields = fields_of(type(value))
    return [
        pair for name, _, own, _ in fields for pair in _shapes(name, vars(value)[name], own)
    ]


def is_checked(kind: Any) -> bool:
    """Tell whether an annotation is a class of `Checked` modules."""
    return inspect.isclass(kind) and issubclass(kind, Checked)


@functools.cache
def fields_of(module: type[Checked]) -> list[tuple[str, Any, int, Any]]:
    """Of each field the name, the domain, its own axes and, if it is such a module, its class."""
    return [
        (field.name, field.metadata.get("domain"), field.metadata.get("own_axes", 0), kind)
        for field in dataclasses.fields(module)
        for kind in [field.type if is_checked(field.type) else None]
    ]


def quantities(module: Checked) -> Iterator[tuple[str, Any, Domain, str]]:
    """Name, value, domain and unit of every `quantity` of a module, also of its modules."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if isinstance(value, Checked):
            yield from quantities(value)
        elif field.metadata.get("domain") is not None:
            yield field.name, value, field.metadata["domain"], field.metadata.get("unit", "")
