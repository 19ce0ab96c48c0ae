"""Guarding of traced arguments, about which nothing can be raised.

Where a value is traced (under ``jit``, ``vmap``, ``grad``), the elements outside of its domain
become NaN. A harmless value stands in for them while the function is evaluated, so that
neither their neighbours nor the derivatives of these are affected.
"""

import contextlib
import contextvars
import functools
import inspect
import operator
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp

from .arrays import Booleans, as_real
from .domains import Checked, Domain, check, check_kind, check_shapes, is_checked, list_fields

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
        all_valid: Booleans | bool = True
        for field in list_fields(type(value)):
            part, valid = replace_invalid(vars(value)[field.name], field.domain)
            # Only what has changed is replaced: what has been guarded already is known by its
            # identity.
            if valid is not True:
                get_part = operator.attrgetter(field.name)
                value = eqx.tree_at(get_part, value, part)
                all_valid = _combine_validity(all_valid, valid)
        return value, all_valid

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


def _combine_validity(first: Booleans | bool, second: Booleans | bool) -> Booleans | bool:
    """Combine two masks; True, no array, where nothing had to be guarded."""
    return second if first is True else first if second is True else first & second


def elementwise(  # noqa: C901
    *prepare: Callable[[dict[str, Any]], None],
    **declared: Domain | Callable[..., object],
) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Guard the arguments of an elementwise function.

    The decorated function sees valid elements only. Where a traced argument is not valid,
    results are NaN with derivative zero, so that a masked sum over a batch has the derivative
    of the elements that are summed. Concrete arguments are checked instead.

    Parameters
    ----------
    *prepare : callable
        Functions of all arguments, which may replace some before values are checked.
    **declared : Domain or callable
        By the names of the arguments: the domain of a number, or a function that converts the
        argument. `Checked` modules are not declared; they are recognized by the annotation.

    Returns
    -------
    decorator : callable
        Keeps the docstring, in which the domains are to be found in words. The attribute
        `guards` of a decorated function has the domains by argument.
    """
    guards = {name: part for name, part in declared.items() if isinstance(part, Domain)}
    converters = {name: part for name, part in declared.items() if callable(part)}

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:  # noqa: C901
        signature = inspect.signature(function)
        parameters = signature.parameters.values()
        kinds = {p.name: p.annotation for p in parameters if is_checked(p.annotation)}

        def call_masked(arguments: dict[str, Any]) -> _R:
            """Call the function with stand-ins, and write NaN where they stood."""
            valid: Booleans | bool = True
            for name, value in arguments.items():
                arguments[name], part = replace_invalid(value, guards.get(name))
                valid = _combine_validity(valid, part)
            result = cast("Callable[..., _R]", function)(**arguments)
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
                takes = ", ".join(signature.parameters)
                raise TypeError(f"{function.__name__}({takes}): {error}") from None
            bound.apply_defaults()
            arguments = bound.arguments
            # Kinds before values before shapes: the first message is about the gravest error.
            for name, kind in kinds.items():
                check_kind(name, arguments[name], kind)
            for name in guards:
                arguments[name] = as_real(name, arguments[name])
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
