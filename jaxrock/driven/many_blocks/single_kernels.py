"""Values that are computed once, and loops that are one function of the processor.

XLA fuses the elementwise operations of a step into a hundred loops over lanes, each of which is
a function. By default it calls them one by one through a scheduler, which for 64 lanes takes
longer than their computations. From JAX 0.12 on, XLA makes one function of a whole loop over
steps even if it contains barriers. Earlier versions do so for a call with an attribute that asks
for it, if the barriers are calls too, with an attribute that forbids inlining.
"""

import functools
from collections.abc import Callable
from contextvars import ContextVar
from typing import TypeVar

import equinox as eqx
import jax
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import PyTree

_Tree = TypeVar("_Tree")
# Attributes of a call that XLA reads: it stays a call, and becomes one function.
_STAYS = "inlineable"
_IS_ONE_FUNCTION = "xla_cpu_small_call"

_by_calls: ContextVar[bool] = ContextVar("by_calls", default=False)


def materialize(values: _Tree) -> _Tree:
    """Compute the values here and once: XLA would do so again wherever they are used.

    XLA fuses elementwise operations into their users, without counting how many users there
    are. The coefficients of a series, each of which enters all later ones, would be computed
    exponentially often.
    """
    if _by_calls.get():
        with set_xla_metadata(**{_STAYS: "false"}):
            return _return_as_it_is(values)
    return jax.lax.optimization_barrier(values)


@jax.jit
def _return_as_it_is(values: _Tree) -> _Tree:
    return values


def call_as_one_function(function: Callable[..., _Tree], *arguments: object) -> _Tree:
    """Call a function, a loop over steps, so that XLA makes a single function of it.

    It must not contain a scatter, a product of matrices, or a call of a library.
    """
    if not _by_calls.get():
        return function(*arguments)
    # What it closes over becomes an argument, too.
    closed = eqx.filter_closure_convert(function, *arguments)
    arrays, static = eqx.partition((closed, arguments), eqx.is_array)

    @jax.jit
    def call(arrays: PyTree) -> tuple[_Tree, PyTree]:
        # The attributes are those of the call, not of what is in it.
        with set_xla_metadata(**{_STAYS: None, _IS_ONE_FUNCTION: None}):
            closed, arguments = eqx.combine(arrays, static)
            # All arguments are returned as well: at one that is not used XLA breaks off.
            return closed(*arguments), arrays

    with set_xla_metadata(**{_STAYS: "false", _IS_ONE_FUNCTION: "true"}):
        return call(arrays)[0]


def needs_calls(platform: str) -> bool:
    """Return whether barriers and loops have to be calls, on a platform."""
    return platform == "cpu" and jax.__version_info__ < (0, 12)


def write_as_calls(function: Callable[..., _Tree]) -> Callable[..., _Tree]:
    """Make a function that is traced for a processor write barriers and loops as calls."""

    @functools.wraps(function)
    def write(*arguments: object, **options: object) -> _Tree:
        token = _by_calls.set(True)
        try:
            return function(*arguments, **options)
        finally:
            _by_calls.reset(token)

    return write
