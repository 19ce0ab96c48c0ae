"""Numbers and arrays as arguments: what signatures call them, and how they are brought in."""

import contextlib
from collections.abc import Sequence
from types import ModuleType
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.dtypes
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Real
from typing_extensions import TypeAliasType

# Signatures in `help` show these by name instead of all that they stand for.
Number = TypeAliasType("Number", Real[ArrayLike, "..."])


Numbers = TypeAliasType("Numbers", Number | Sequence[object])


Flags = TypeAliasType("Flags", Bool[ArrayLike, "..."] | Numbers)


Reals = TypeAliasType("Reals", Float[Array, "..."])


Integers = TypeAliasType("Integers", Int[Array, "..."])


Booleans = TypeAliasType("Booleans", Bool[Array, "..."])


# In what NumPy computes for concrete values and JAX for traced ones, by the same lines.
AnyArray = np.ndarray | jax.Array


_T = TypeVar("_T")


def is_traced(tree: object) -> bool:
    """Return whether a pytree has a traced leaf.

    Public functions are called in two ways. Of concrete numbers one can raise an error, search
    on the host, and compute in NumPy, which compiles nothing. Of traced ones, inside of
    `jit`, `vmap` or `grad`, only JAX may compute, and wrong ones become NaN. This and
    `choose_namespace` are the only questions by which functions tell the two apart.
    """
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def check_concrete(tree: object, reason: str) -> None:
    """Raise `ValueError` for a traced pytree: `reason` says why it cannot be one."""
    if is_traced(tree):
        raise ValueError(
            f"arguments must be concrete here, outside of jit, vmap and grad: {reason}"
        )


def choose_namespace(tree: object) -> ModuleType:
    """Choose JAX for a traced pytree, NumPy for a concrete one; see `is_traced`."""
    return jnp if is_traced(tree) else np


# Anything may be tried; `as_real` refuses values that are no arrays.
def as_array(value: Any) -> Array:
    """Make `value` an array of JAX."""
    # By way of NumPy where possible: JAX would compile a conversion for every shape.
    if isinstance(value, list | tuple) and not is_traced(value):
        value = np.asarray(value)
    if isinstance(value, np.ndarray | np.generic):
        dtype = jax.dtypes.canonicalize_dtype(value.dtype)
        return jax.device_put(np.asarray(value, dtype))
    return jnp.asarray(value)


def carries_unit(value: object) -> bool:
    """Return whether a value, or one in a list, carries a unit, which NumPy and JAX drop.

    Quantities of astropy and unyt and labelled arrays of xarray lose it without a word, those
    of pint with a warning.
    """
    # By the class: a module of ours, or a Python number, has no such attribute. Of a list one
    # of each class, since it may be a million numbers.
    if isinstance(value, list | tuple):
        return any(map(carries_unit, {type(part): part for part in value}.values()))
    has_unit = hasattr(type(value), "units") or hasattr(type(value), "unit")
    return has_unit or "units" in getattr(value, "attrs", ())


def as_real(name: str, value: object, *, unit: str | None = None) -> Array:
    """Make `value` an array of floating-point numbers; Python numbers stay weakly typed.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like
        Numbers in SI.
    unit : str, optional
        Unit of the argument in SI, such as "m/s2", for the message.

    Returns
    -------
    Array

    Raises
    ------
    ValueError
        If it is none, or carries a unit. The error names the argument.
    """
    allowed = "a real number or an array of them, in float32 or float64"
    if carries_unit(value):
        allowed = f"a plain number in {unit or 'SI'}, without a unit attached"
        raise ValueError(f"{name} must be {allowed}, got {describe(value)}")
    # What NumPy and JAX say of a value that is no array would not name the argument.
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        array = as_array(float(value) if isinstance(value, int | float) else value)
        if jnp.issubdtype(array.dtype, jnp.integer):
            with jax.numpy_dtype_promotion("standard"):
                return array * 1.0  # weakly typed: it takes the precision of other arguments
        if array.dtype in (jnp.float32, jnp.float64):
            return array
    raise ValueError(f"{name} must be {allowed}, got {describe(value)}")


def add_article(name: str) -> str:
    """Put the indefinite article before the name of a class."""
    return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"


def describe(value: object) -> str:
    """Describe a value in a few words, for the end of an error message."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, eqx.Module):
        return add_article(type(value).__name__)
    if isinstance(value, list | tuple) and value and isinstance(value[0], eqx.Module):
        return f"a list of {len(value)} {type(value[0]).__name__}s"
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def unify_precision(tree: _T) -> _T:
    """Bring a pytree of numbers to the precision that JAX promotes them to together."""
    # The caller may have made promotion strict, which is meant for other arrays.
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*jax.tree.leaves(tree))

    def convert(leaf: ArrayLike) -> Array:
        if is_traced(leaf):
            return jnp.asarray(leaf, dtype)
        # As it is where it can stay: a copy of a long record takes time and memory.
        if isinstance(leaf, jax.Array) and leaf.dtype == dtype and not leaf.weak_type:
            return leaf
        # By way of NumPy, as in `as_array`.
        return as_array(np.asarray(leaf, dtype))

    return jax.tree.map(convert, tree)
