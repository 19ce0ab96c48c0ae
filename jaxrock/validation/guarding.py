"""Guarding of traced arguments, about which nothing can be raised.

Where a value is traced (under ``jit``, ``vmap``, ``grad``), the elements outside of its domain
become NaN, and a harmless value stands in for them while the function is evaluated, so that
neither their neighbours nor the derivatives of these are affected.
"""

import contextlib
import contextvars
import functools
import inspect
import operator
import textwrap
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ParamSpec, TypeVar, cast, get_args

import equinox as eqx
import jax
import jax.numpy as jnp

from .arrays import as_real
from .domains import Checked, Domain, check, check_kind, check_shapes, fields_of, is_checked

_P = ParamSpec("_P")


_R = TypeVar("_R")


_T = TypeVar("_T")


# The guarded values of the function being traced. Functions that it calls need not guard them
# again, which would only hinder the compiler. None outside of a guarded function.
_guarded: contextvars.ContextVar[list[tuple[Any, Domain]] | None] = contextvars.ContextVar(
    "_guarded", default=None
)


@contextlib.contextmanager
def guarding() -> Iterator[None]:
    """Guard no value twice inside."""
    token = _guarded.set([])
    try:
        yield
    finally:
        _guarded.reset(token)


def replace_invalid(value: _T, domain: Domain | None = None) -> tuple[_T, Any]:
    """Put stand-ins for values outside of domains; tell where the values are valid."""
    if isinstance(value, Checked):
        oks = []
        for name, its_domain, _, _ in fields_of(type(value)):
            part, ok = replace_invalid(vars(value)[name], its_domain)
            if ok is not True:
                value = eqx.tree_at(lambda m, name=name: getattr(m, name), value, part)
            oks.append(ok)
        return value, _all(oks)
    guarded = _guarded.get()
    if domain is None or any(value is v and domain is d for v, d in guarded or ()):
        return value, True
    valid = domain.contains(value)
    value = cast("_T", jnp.where(valid, cast("Any", value), domain.stand_in))
    if guarded is not None:
        guarded.append((value, domain))
    return value, valid


def _all(oks: Iterable[Any]) -> Any:
    """Tell where all are valid; True where nothing had to be guarded."""
    return functools.reduce(operator.and_, [ok for ok in oks if ok is not True] or [True])


def elementwise(
    **domains: Domain | Callable[[Any], Any],
) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Guard the arguments of an elementwise function.

    Arguments named in `domains`, and all `Checked` modules, are checked where they are
    concrete; a function in the place of a domain converts its argument. The decorated function
    sees valid elements only. Where an argument is not valid, results are NaN with derivative
    zero, so that a masked sum over a batch has the derivative of the elements that are summed.
    Docstrings get a section on errors; a paragraph that begins with "Returns" becomes one,
    after parameters.
    """
    guards = {name: domain for name, domain in domains.items() if isinstance(domain, Domain)}

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:
        signature = inspect.signature(function)
        given = signature.parameters.items()
        kinds = {name: of.annotation for name, of in given if is_checked(of.annotation)}

        def masked(arguments: dict[str, Any]) -> Any:
            pairs = {
                name: replace_invalid(value, guards.get(name))
                for name, value in arguments.items()
            }
            valid = _all(ok for _, ok in pairs.values())
            inner = cast("Callable[..., Any]", function)
            result = inner(**{name: value for name, (value, _) in pairs.items()})
            if valid is True:
                return result
            return jax.tree.map(lambda leaf: jnp.where(valid, leaf, jnp.nan), result)

        # Outside of `jit`, one program instead of one for every operation; inlined where
        # traced.
        @functools.partial(jax.jit, inline=True)
        def outermost(arguments: dict[str, Any]) -> Any:
            with guarding():
                return masked(arguments)

        @functools.wraps(function)
        def guarded(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            arguments = bound.arguments
            for name, kind in kinds.items():
                check_kind(name, arguments[name], kind)
            for name, domain in domains.items():
                of_name = functools.partial(as_real, name)
                convert = of_name if isinstance(domain, Domain) else domain
                arguments[name] = convert(arguments[name])
            for name, value in arguments.items():
                check(name, value, guards.get(name))
            check_shapes(**arguments)
            return (outermost if _guarded.get() is None else masked)(arguments)

        guarded.__doc__ = _documented(
            inspect.cleandoc(function.__doc__ or ""), signature, guards
        )
        return guarded

    return decorate


def _documented(text: str, signature: inspect.Signature, guards: dict[str, Domain]) -> str:
    """Write a docstring in sections, with what signature and domains say."""
    summary, result, rest = text.partition("\nReturns ")
    if result and not rest.startswith("\n"):
        text = f"{summary}\nParameters\n----------\n"
        for name, parameter in signature.parameters.items():
            kinds = get_args(parameter.annotation) or (parameter.annotation,)
            words = [inspect.formatannotation(kind).rpartition(".")[2] for kind in kinds]
            if name in guards:
                words = [f"array_like\n    {guards[name].allowed.capitalize()}."]
            text += f"{name} : {' or '.join(words)}\n" if name != "self" else ""
        kind = "tuple of Array" if get_args(signature.return_annotation) else "Array"
        result, *rest = rest.rstrip().split("\n\n", 1)
        text += f"\nReturns\n-------\n{kind}, shape (...)\n{textwrap.indent(result, '    ')}\n"
        text += "".join(f"\n{part}" for part in rest)
    if guards:
        names = " or ".join(f"`{name}`" for name in guards)
        text += f"\n\nRaises\n------\nValueError\n    If a concrete {names} is out of range."
        text += " A traced one gives NaN.\n"
    return text
