"""Guarding of traced arguments, about which nothing can be raised.

Where a value is traced (under ``jit``, ``vmap``, ``grad``), the elements outside of its domain
become NaN. A harmless value stands in for them while the function is evaluated, so that
neither their neighbours nor the derivatives of these are affected.
"""

import contextlib
import contextvars
import dataclasses
import functools
import inspect
import operator
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp

from .arrays import Booleans, as_real
from .domains import (
    Checked,
    Domain,
    check,
    check_kind,
    check_shapes,
    is_checked,
    list_fields,
    quantity,
)

_P = ParamSpec("_P")


_R = TypeVar("_R")


_T = TypeVar("_T")


# The guarded values of the function being traced. Functions that it calls need not guard them
# again, which would only hinder the compiler. None outside of a guarded function.
_guarded_values: contextvars.ContextVar[list[tuple[object, Domain]] | None] = (
    contextvars.ContextVar("_guarded_values", default=None)
)


@contextlib.contextmanager
def guard_once() -> Iterator[None]:
    """Guard no value twice inside."""
    token = _guarded_values.set([])
    try:
        yield
    finally:
        _guarded_values.reset(token)


def replace_invalid(value: _T, domain: Domain | None = None) -> tuple[_T, Booleans | bool]:
    """Put stand-ins for values outside of domains, and tell where the values are valid.

    Parameters
    ----------
    value : array_like or Checked
        Of a module all fields are treated, each by its own domain.
    domain : Domain, optional
        None leaves the value as it is.

    Returns
    -------
    value : array_like or Checked
    valid : Array or bool
        True, not an array, where nothing had to be guarded.
    """
    if isinstance(value, Checked):
        parts = []
        for field in list_fields(type(value)):
            part, valid = replace_invalid(vars(value)[field.name], field.domain)
            # Only what has changed is replaced: what has been guarded already is known by its
            # identity.
            if valid is not True:
                name = field.name
                value = eqx.tree_at(lambda m, name=name: getattr(m, name), value, part)
            parts.append(valid)
        return value, _combine_validity(parts)

    guarded = _guarded_values.get()
    # By identity, not by value: tracers cannot be compared.
    if domain is None or any(value is v and domain is d for v, d in guarded or ()):
        return value, True
    number = cast("jax.Array", value)
    valid = domain.contains(number)
    # Before the function, and not only after it: in the derivative of `where` the branch that
    # is not taken is multiplied by 0, which gives NaN if it is infinite or NaN.
    value = cast("_T", jnp.where(valid, number, domain.stand_in))
    if guarded is not None:
        guarded.append((value, domain))
    return value, cast("jax.Array", valid)


def _combine_validity(parts: Iterable[Booleans | bool]) -> Booleans | bool:
    """Tell where all parts are valid; True, no array, where nothing had to be guarded."""
    guarded = [valid for valid in parts if valid is not True]
    return functools.reduce(operator.and_, guarded or [True])


def _check_argument(
    name: str, value: object, kind: type[Checked], function: Callable[..., object]
) -> None:
    """Check the kind of an argument; name the parts of a module that has such a part."""
    hint = ""
    if isinstance(value, Checked) and not isinstance(value, kind):
        fields = {field.name for field in list_fields(type(value))}
        parts = [part for part in inspect.signature(function).parameters if part in fields]
        if name in parts:
            whole = type(value).__name__.lower()
            listed = ", ".join(f"{whole}.{part}" for part in parts)
            hint = f"; write {function.__name__}({listed})"
    check_kind(name, value, kind, hint=hint)


def elementwise(  # noqa: C901
    *prepare: Callable[[dict[str, Any]], None],
    **declared: Domain | dataclasses.Field | Callable[..., object],
) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Guard the arguments of an elementwise function.

    The decorated function sees valid elements only. Where a traced argument is not valid,
    results are NaN with derivative zero, so that a masked sum over a batch has the derivative
    of the elements that are summed. Concrete arguments are checked instead.

    Parameters
    ----------
    *prepare : callable
        Functions of all arguments, which may replace some before values are checked.
    **declared : quantity, Domain or callable
        By the names of the arguments: a `quantity`, with its domain and unit; the domain of an
        argument that takes no unit; or a function that converts the argument. `Checked`
        modules are not declared; they are recognized by the annotation.

    Returns
    -------
    decorator : callable
        Keeps the docstring, in which the domains are to be found in words. The attribute
        `guards` of a decorated function has the domains by argument.
    """
    guards: dict[str, Domain] = {}
    converters: dict[str, Callable[..., object]] = {}
    for name, declaration in declared.items():
        if isinstance(declaration, Domain):
            declaration = quantity(declaration)
        if isinstance(declaration, dataclasses.Field):
            unit = declaration.metadata["unit"]
            guards[name] = declaration.metadata["domain"]
            converters[name] = functools.partial(as_real, name, unit=unit)
        else:
            converters[name] = declaration

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:  # noqa: C901
        signature = inspect.signature(function)
        given = signature.parameters.items()
        kinds = {name: of.annotation for name, of in given if is_checked(of.annotation)}

        def call_masked(arguments: dict[str, object]) -> _R:
            """Call the function with stand-ins, and write NaN where they stood."""
            pairs = {
                name: replace_invalid(value, guards.get(name))
                for name, value in arguments.items()
            }
            valid = _combine_validity(ok for _, ok in pairs.values())
            inner = cast("Callable[..., _R]", function)
            result = inner(**{name: value for name, (value, _) in pairs.items()})
            if valid is True:
                return result
            return jax.tree.map(lambda leaf: jnp.where(valid, leaf, jnp.nan), result)

        # Outside of `jit`, one program instead of one for every operation; inlined where
        # traced.
        @functools.partial(jax.jit, inline=True)
        def call_compiled(arguments: dict[str, Any]) -> _R:
            """Call the function as the outermost of all guarded ones."""
            with guard_once():
                return call_masked(arguments)

        @functools.wraps(function)
        def call_checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            try:
                bound = signature.bind(*args, **kwargs)
            except TypeError as error:
                # Of too many or too few arguments the first are often of another kind.
                for name, value in zip(signature.parameters, args, strict=False):
                    if name in kinds:
                        _check_argument(name, value, kinds[name], function)
                takes = ", ".join(signature.parameters)
                raise TypeError(f"{function.__name__}({takes}): {error}") from None
            bound.apply_defaults()
            arguments = bound.arguments
            # Kinds before values before shapes: the first message is about the gravest error.
            for name, kind in kinds.items():
                _check_argument(name, arguments[name], kind, function)
            for name, convert in converters.items():
                arguments[name] = convert(arguments[name])
            for replace in prepare:
                replace(arguments)
            for name, value in arguments.items():
                check(name, value, guards.get(name))
            check_shapes(**arguments)
            is_outermost = _guarded_values.get() is None
            return (call_compiled if is_outermost else call_masked)(arguments)

        # A test compares docstrings with them.
        call_checked.guards = guards  # pyright: ignore[reportAttributeAccessIssue]
        return call_checked

    return decorate
