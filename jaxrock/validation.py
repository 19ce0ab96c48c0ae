"""What an argument may be, said once.

Every quantity has a `Domain`. A concrete value outside of it is a `ValueError` that names the
argument, the value and what is allowed. Where the value is traced (under ``jit``, ``vmap``,
``grad``) nothing can be raised: the elements concerned become NaN, and a harmless value stands in
for them while the function is evaluated, so that neither their neighbours nor the derivatives
of these are affected.
"""

import contextlib
import contextvars
import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.core
import jax.dtypes
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Real

Number = Real[ArrayLike, "..."]
Numbers = Number | Sequence[Any]
Reals = Float[Array, "..."]
Booleans = Bool[Array, "..."]

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")


class Domain(NamedTuple):
    """The values that an argument may have."""

    allowed: str  # in words, for the error message
    contains: Callable[[Any], Any]
    stand_in: float  # replaces a value outside


POSITIVE = Domain("finite and greater than 0", lambda x: (x > 0) & (x < jnp.inf), 1.0)
NON_NEGATIVE = Domain("finite and at least 0", lambda x: (x >= 0) & (x < jnp.inf), 0.0)
FINITE = Domain("finite", lambda x: abs(x) < jnp.inf, 0.0)
UNIT_INTERVAL = Domain("between 0 and 1", lambda x: (x >= 0) & (x <= 1), 0.5)
BELOW_ONE = Domain("at least 0 and less than 1", lambda x: (x >= 0) & (x < 1), 0.5)
COUNT = Domain("a whole number from 1 on, or inf", lambda x: (x >= 1) & (x == jnp.floor(x)), 1.0)
GROWTH = Domain("at least 0", lambda x: x >= 0, 0.0)


def as_array(value: Any) -> Array:
    """`value` as an array."""
    # By way of NumPy where possible: JAX would compile a conversion for every shape.
    if isinstance(value, list | tuple):
        leaves = jax.tree.leaves(value)
        if not any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            value = np.asarray(value)
    if isinstance(value, np.ndarray | np.generic):
        dtype = jax.dtypes.canonicalize_dtype(value.dtype)
        return jnp.asarray(np.asarray(value, dtype), dtype)
    return jnp.asarray(value)


def as_real(name: str, value: Any) -> Array:
    """`value` as an array of floating-point numbers; Python numbers stay weakly typed."""
    try:
        array = as_array(float(value) if isinstance(value, int | float) else value)
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is not None and jnp.issubdtype(array.dtype, jnp.floating):
        return array
    if array is not None and jnp.issubdtype(array.dtype, jnp.integer):
        with jax.numpy_dtype_promotion("standard"):
            return array * 1.0  # weakly typed: it takes the precision of other arguments
    raise ValueError(f"{name} must be a real number or an array of them, got {value!r}")


def of_one_precision(tree: _T) -> _T:
    """A pytree of numbers, all in the precision that JAX promotes them to together."""
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*jax.tree.leaves(tree))

    def converted(leaf: Any) -> Any:
        if isinstance(leaf, jax.core.Tracer):
            return jnp.asarray(leaf, dtype)
        if isinstance(leaf, jax.Array) and leaf.dtype == dtype and not leaf.weak_type:
            return leaf
        return as_array(np.asarray(leaf, dtype))

    return jax.tree.map(converted, tree)


def check(name: str, value: Any, domain: Domain) -> None:
    """Raise `ValueError` if `value` is concrete and anywhere outside `domain`."""
    if isinstance(value, jax.core.Tracer):
        return
    values = np.asarray(value)
    with np.errstate(invalid="ignore"):
        outside = ~np.asarray(domain.contains(values))
    if outside.any():
        first = f"{float(values[outside].flat[0]):.9g}"
        if values.ndim:
            first = f"{first} (first of {outside.sum()} such elements out of {outside.size})"
        raise ValueError(f"{name} must be {domain.allowed}, got {first}")


def quantity(domain: Domain) -> Any:
    """A field of a `Checked` module whose value has to be in `domain`."""
    return eqx.field(metadata={"domain": domain})


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
            If a concrete value is outside of its domain.
        """
        for field in self.__dataclass_fields__.values():
            value = getattr(self, field.name)
            if "domain" in field.metadata:
                check(field.name, value, field.metadata["domain"])
            elif isinstance(value, Checked):
                value.check()


_OUT_OF_RANGE = """

Raises
------
ValueError
    If a concrete {} is out of range. A traced one gives NaN.
"""

_M = TypeVar("_M", bound=Checked)

# The guarded values of the function being traced. Functions that it calls need not guard them
# again, which would only hinder the compiler. None outside of a guarded function.
_guarded: contextvars.ContextVar[list[tuple[Any, Domain]] | None] = contextvars.ContextVar(
    "_guarded", default=None
)


@contextlib.contextmanager
def guarding() -> Iterator[None]:
    """A scope in which no value is guarded twice."""
    token = _guarded.set([])
    try:
        yield
    finally:
        _guarded.reset(token)


def within(value: Any, domain: Any) -> tuple[Any, Any]:
    """The value with stand-ins outside of the domain, if it has one, and where it is valid."""
    if isinstance(value, Checked):
        return module_within(value)
    guarded = _guarded.get()
    if not isinstance(domain, Domain) or any(
        value is other and domain is its_domain for other, its_domain in guarded or ()
    ):
        return value, True
    valid = domain.contains(value)
    value = jnp.where(valid, value, domain.stand_in)
    if guarded is not None:
        guarded.append((value, domain))
    return value, valid


def module_within(module: _M) -> tuple[_M, Any]:
    """The module with stand-ins for quantities outside of their domains, and where it is valid."""
    valid: Any = True
    for name, field in module.__dataclass_fields__.items():
        value, ok = within(getattr(module, name), field.metadata.get("domain"))
        if ok is not True:
            module = eqx.tree_at(lambda m, name=name: getattr(m, name), module, value)
            valid = valid & ok
    return module, valid


def elementwise(
    **domains: Domain | Callable[[Any], Any],
) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Guard the arguments of an elementwise function.

    Arguments named in `domains`, and all `Checked` modules, are checked where they are concrete; a
    function in the place of a domain converts its argument. The decorated function sees valid
    elements only. Where an argument is not valid, results are NaN with derivative zero, so that a
    masked sum over a batch has the derivative of the elements that are summed. Docstrings get
    their section on errors.
    """
    guarded_names = [name for name, domain in domains.items() if isinstance(domain, Domain)]

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:
        signature = inspect.signature(function)

        def masked(arguments: dict[str, Any]) -> Any:
            valid: Any = True
            for name, value in arguments.items():
                arguments[name], ok = within(value, domains.get(name))
                valid = valid if ok is True else valid & ok
            result = cast("Callable[..., Any]", function)(**arguments)
            if valid is True:
                return result
            return jax.tree.map(lambda leaf: jnp.where(valid, leaf, jnp.nan), result)

        # Outside of `jit`, one program instead of one for every operation; inlined where traced.
        @functools.partial(jax.jit, inline=True)
        def outermost(arguments: dict[str, Any]) -> Any:
            with guarding():
                return masked(arguments)

        @functools.wraps(function)
        def guarded(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            for name, value in bound.arguments.items():
                if isinstance(value, Checked):
                    value.check()
                elif isinstance(domain := domains.get(name), Domain):
                    bound.arguments[name] = as_real(name, value)
                    check(name, bound.arguments[name], domain)
                elif domain is not None:
                    bound.arguments[name] = domain(value)
            compute = outermost if _guarded.get() is None else masked
            return compute(bound.arguments)

        if guarded_names and function.__doc__:
            names = " or ".join(f"`{name}`" for name in guarded_names)
            guarded.__doc__ = inspect.cleandoc(function.__doc__) + _OUT_OF_RANGE.format(names)
        return guarded

    return decorate
