"""Domains: the values that a quantity may have, and errors for concrete ones outside.

A concrete value outside of its domain is a `ValueError` that names the argument, the value and
the domain.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeGuard

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .arrays import AnyArray, Numbers, add_article, as_real, describe, is_traced


class Domain(NamedTuple):
    """The values that an argument may have."""

    allowed: str  # in words, for the error message and the docstring
    # By NumPy, where concrete arguments are checked; by JAX, where traced ones are guarded.
    contains: Callable[[AnyArray], AnyArray]  # False for NaN
    stand_in: float  # replaces a value outside


# Comparisons serve NumPy and JAX alike, and NaN fails them all.
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


# A field specifier of a dataclass has to pass for a value of any field: hence `Any`.
def quantity(domain: Domain | None, unit: str | None = None, own_axes: int = 0) -> Any:
    """Declare a field of a `Checked` module.

    Parameters
    ----------
    domain : Domain, optional
        None allows all values.
    unit : str, optional
        In SI, as it is printed; "" for a plain number.
    own_axes : int
        How many axes, the last ones, belong to the quantity itself and to no batch.

    Returns
    -------
    field
        A field of a dataclass.
    """
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
        for field in list_fields(type(self)):
            if field.kind is not None:
                check_kind(field.name, parts[field.name], field.kind)
            check(field.name, parts[field.name], field.domain)
        check_shapes(itself=self)


def is_checked(kind: object) -> TypeGuard[type[Checked]]:
    """Return whether an annotation is a class of `Checked` modules."""
    return inspect.isclass(kind) and issubclass(kind, Checked)


class Declaration(NamedTuple):
    """A field of a `Checked` class, as it was declared."""

    name: str
    domain: Domain | None
    unit: str | None
    own_axes: int
    kind: type[Checked] | None  # the class of a field that is such a module itself


# Asked for at every call, and a class does not change.
@functools.cache
def list_fields(module: type[Checked]) -> list[Declaration]:
    """List the fields of a class as they were declared."""
    return [
        Declaration(
            field.name,
            field.metadata.get("domain"),
            field.metadata.get("unit"),
            field.metadata.get("own_axes", 0),
            field.type if is_checked(field.type) else None,
        )
        for field in dataclasses.fields(module)
    ]


def as_field(module: type[Checked], name: str, value: object) -> Array:
    """Make the value of a field an array, as `as_real` does."""
    return as_real(name, value, unit=module.__dataclass_fields__[name].metadata["unit"])


def iterate_quantities(module: Checked) -> Iterator[tuple[str, object, Domain, str]]:
    """Iterate over name, value, domain and unit of the numbers in a module and its modules."""
    for field in list_fields(type(module)):
        value = vars(module)[field.name]
        if isinstance(value, Checked):
            yield from iterate_quantities(value)
        elif field.domain is not None:
            yield field.name, value, field.domain, field.unit or ""


def check(name: str, value: object, domain: Domain | None) -> None:
    """Raise `ValueError` if a concrete value, or field of a module, is not in its domain."""
    if isinstance(value, Checked):
        # Again, though it was checked when it was made: tree operations of JAX make modules
        # without that. Through the class, since Equinox wraps each method of an instance.
        Checked.check(value)
    if domain is None or is_traced(value):
        return
    values = np.asarray(value)
    with np.errstate(invalid="ignore"):  # NaN is outside, and no reason for a warning
        outside = ~np.asarray(domain.contains(values))
    if outside.any():
        first = f"{float(values[outside].flat[0]):.9g}"
        if values.ndim:
            first = (
                f"{first} (out of range: {outside.sum()} of {outside.size} elements,"
                " this is the first)"
            )
        raise ValueError(f"{name} must be {domain.allowed}, got {first}")


def check_increasing(name: str, values: Numbers) -> None:
    """Check that concrete values increase along their last axis.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    values : array_like, shape (..., n)
        NaN does not increase. Traced values are not checked.

    Raises
    ------
    ValueError
        If a value is not greater than the one before it. The message has the first such pair.
    """
    if is_traced(values):
        return
    array = np.asarray(values)
    before = array[..., :-1]
    after = array[..., 1:]
    falls = ~(after > before)
    if falls.any():
        first = f"{after[falls][0]:.9g} after {before[falls][0]:.9g}"
        raise ValueError(f"{name} must increase, got {first}")


def check_shapes(**arguments: object) -> None:
    """Raise `ValueError` if arguments, and fields of modules, do not broadcast.

    Traced ones are checked as well: their shapes are known.
    """
    shapes = [pair for name, value in arguments.items() for pair in _list_shapes(name, value)]
    if len(some := {shape for _, shape in shapes if shape}) > 1:
        try:
            np.broadcast_shapes(*some)
        except ValueError:
            listed = ", ".join(f"{name} of {shape}" for name, shape in shapes if shape)
            raise ValueError(
                f"shapes must broadcast against each other, got {listed}"
            ) from None


def _list_shapes(
    name: str, value: object, own_axes: int = 0
) -> list[tuple[str, tuple[int, ...]]]:
    """List name and shape of a value, or of all fields of a module, without own axes."""
    if not isinstance(value, Checked):
        shape = getattr(value, "shape", ())
        return [(name, shape[: len(shape) - own_axes])]
    return [
        pair
        for field in list_fields(type(value))
        for pair in _list_shapes(field.name, vars(value)[field.name], field.own_axes)
    ]


# `Callable` is a kind as well, but no `type` for type checkers: hence `Any`.
def check_kind(name: str, value: object, *kinds: Any, hint: str = "") -> None:
    """Raise `ValueError` if a value is of none of these classes; `hint` says what to do."""
    if isinstance(value, kinds):
        return
    names = [add_article("function" if kind is Callable else kind.__name__) for kind in kinds]
    raise ValueError(f"{name} must be {' or '.join(names)}, got {describe(value)}{hint}")
