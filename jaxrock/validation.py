"""What an argument may be, said once.

Every quantity has a `Domain`. A concrete value outside of it is a `ValueError` that names the
argument, the value and what is allowed. Where the value is traced (under ``jit``, ``vmap``,
``grad``) nothing can be raised: the elements concerned become NaN, and a harmless value stands
in for them while the function is evaluated, so that neither their neighbours nor the
derivatives of these are affected.
"""

import contextlib
import contextvars
import dataclasses
import functools
import inspect
import operator
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast, get_args

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
Numbers = TypeAliasType("Numbers", Number | Sequence[Any])
Reals = TypeAliasType("Reals", Float[Array, "..."])
Integers = TypeAliasType("Integers", Int[Array, "..."])
Booleans = TypeAliasType("Booleans", Bool[Array, "..."])

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
AT_LEAST_ONE = Domain("finite and at least 1", lambda x: (x >= 1) & (x < jnp.inf), 1.0)
RIGHT_ANGLE = Domain("between 0 and pi / 2", lambda x: (x > 0) & (x < jnp.pi / 2), 1.0)
UNIT_INTERVAL = Domain("between 0 and 1", lambda x: (x >= 0) & (x <= 1), 0.5)
BELOW_ONE = Domain("at least 0 and less than 1", lambda x: (x >= 0) & (x < 1), 0.5)
COUNT = Domain(
    "a whole number from 1 on, or inf", lambda x: (x >= 1) & (x == jnp.floor(x)), 1.0
)
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
        return jax.device_put(np.asarray(value, dtype))
    return jnp.asarray(value)


def as_real(name: str, value: Any) -> Array:
    """`value` as an array of floating-point numbers; Python numbers stay weakly typed."""
    # Quantities with units (of pint, astropy, unyt) would lose them without a word.
    if hasattr(type(value), "units") or hasattr(type(value), "unit"):
        raise ValueError(
            f"{name} must be a number without a unit, in SI, got {described(value)}"
        )
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        array = as_array(float(value) if isinstance(value, int | float) else value)
        if jnp.issubdtype(array.dtype, jnp.integer):
            with jax.numpy_dtype_promotion("standard"):
                return array * 1.0  # weakly typed: it takes the precision of other arguments
        if array.dtype in (jnp.float32, jnp.float64):
            return array
        if jnp.issubdtype(array.dtype, jnp.floating):
            value = array.dtype
    must = "a real number or an array of them"
    if isinstance(value, np.dtype):
        must += ", in float32 or float64"
    raise ValueError(f"{name} must be {must}, got {described(value)}")


def described(value: Any) -> str:
    """Describe a value in a few words, for what an error got."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, eqx.Module):
        return f"a {type(value).__name__}"
    if isinstance(value, list | tuple) and value:
        rows = [row for row in value if isinstance(row, list | tuple) or np.ndim(row)]
        lengths = sorted({len(row) for row in rows})
        if lengths[1:]:
            return f"rows of different lengths, {lengths[0]} to {lengths[-1]}"
        if isinstance(value[0], eqx.Module):
            return f"a list of {len(value)} {type(value[0]).__name__}s"
    words = " ".join(repr(value).split())
    return words if len(words) <= 60 else f"{words[:57]}..."


def check_kind(name: str, value: Any, *kinds: Any, hint: str = "") -> None:
    """Raise `ValueError` if a value is of none of these classes; the hint says what to do."""
    if not isinstance(value, kinds):
        names = [f"a {'function' if kind is Callable else kind.__name__}" for kind in kinds]
        must = " or ".join([", ".join(names[:-1]), names[-1]][len(names) == 1 :])
        if inspect.isclass(value) and issubclass(value, kinds):
            hint = f"; {value.__name__}(...) makes one"
        if isinstance(value, list | tuple) and any(isinstance(each, kinds) for each in value):
            hint = hint or f"; one {kinds[0].__name__} of arrays stands for many"
        raise ValueError(f"{name} must be {must}, got {described(value)}{hint}")


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
    fields = _fields(type(value))
    return [
        pair for name, _, own, _ in fields for pair in _shapes(name, vars(value)[name], own)
    ]


def of_one_precision(tree: _T) -> _T:
    """Bring a pytree of numbers to the precision that JAX promotes them to together."""
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*jax.tree.leaves(tree))

    def converted(leaf: Any) -> Any:
        if isinstance(leaf, jax.core.Tracer):
            return jnp.asarray(leaf, dtype)
        if isinstance(leaf, jax.Array) and leaf.dtype == dtype and not leaf.weak_type:
            return leaf
        return as_array(np.asarray(leaf, dtype))

    return jax.tree.map(converted, tree)


def check(name: str, value: Any, domain: Domain | None) -> None:
    """Raise `ValueError` if a value, or a field of a module, is concrete and not in its domain."""
    if isinstance(value, Checked):
        Checked.check(value)
    if domain is None or isinstance(value, jax.core.Tracer):
        return
    values = np.asarray(value)
    with np.errstate(invalid="ignore"):
        outside = ~np.asarray(domain.contains(values))
    if outside.any():
        first = f"{float(values[outside].flat[0]):.9g}"
        if values.ndim:
            first = f"{first} (first of {outside.sum()} such elements out of {outside.size})"
        raise ValueError(f"{name} must be {domain.allowed}, got {first}")


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
        for name, domain, _, kind in _fields(type(self)):
            if kind is not None:
                check_kind(name, parts[name], kind)
            check(name, parts[name], domain)
        check_shapes(itself=self)


def _is_checked(kind: Any) -> bool:
    return inspect.isclass(kind) and issubclass(kind, Checked)


@functools.cache
def _fields(module: type[Checked]) -> list[tuple[str, Any, int, Any]]:
    """Of each field the name, the domain, its own axes and, if it is such a module, its class."""
    return [
        (field.name, field.metadata.get("domain"), field.metadata.get("own_axes", 0), kind)
        for field in dataclasses.fields(module)
        for kind in [field.type if _is_checked(field.type) else None]
    ]


def quantities(module: Checked) -> Iterator[tuple[str, Any, Domain, str]]:
    """Name, value, domain and unit of every `quantity` of a module, also of its modules."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if isinstance(value, Checked):
            yield from quantities(value)
        elif field.metadata.get("domain") is not None:
            yield field.name, value, field.metadata["domain"], field.metadata.get("unit", "")


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


def within(value: _T, domain: Domain | None = None) -> tuple[_T, Any]:
    """Put stand-ins for values outside of domains; tell where the values are valid."""
    if isinstance(value, Checked):
        oks = []
        for name, its_domain, _, _ in _fields(type(value)):
            part, ok = within(vars(value)[name], its_domain)
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
        kinds = {name: of.annotation for name, of in given if _is_checked(of.annotation)}

        def masked(arguments: dict[str, Any]) -> Any:
            pairs = {
                name: within(value, guards.get(name)) for name, value in arguments.items()
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
