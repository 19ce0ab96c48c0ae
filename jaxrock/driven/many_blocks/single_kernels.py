"""Programs that take steps, as fast as XLA can make them.

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
import numpy as np
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
    """Call a function so that XLA makes a single function of it, on a processor.

    It must not contain a scatter, a product of matrices, or a call of a library.
    """
    # What it closes over becomes an argument, too.
    arrays, static = eqx.partition((function, arguments), eqx.is_array)

    @jax.jit
    def call(arrays: PyTree) -> tuple[_Tree, PyTree]:
        # The attributes are those of the call, not of what is in it.
        with set_xla_metadata(**{_STAYS: None, _IS_ONE_FUNCTION: None}):
            function, arguments = eqx.combine(arrays, static)
            # All arguments are returned as well: at one that is not used XLA breaks off.
            return function(*arguments), arrays

    with set_xla_metadata(**{_STAYS: "false", _IS_ONE_FUNCTION: "true"}):
        return call(arrays)[0]


def call_loop(function: Callable[..., _Tree], *arguments: object) -> _Tree:
    """Call a loop over steps, so that XLA makes a single function of it."""
    if not _by_calls.get():
        return function(*arguments)
    return call_as_one_function(eqx.filter_closure_convert(function, *arguments), *arguments)


def jit_steps(
    function: Callable[..., _Tree], platform: str, static_argnames: tuple[str, ...]
) -> Callable[..., _Tree]:
    """Jit a function that takes steps, so that it is as fast on a platform as it can be."""

    @functools.wraps(function)
    def write_as_calls(*arguments: object, **options: object) -> _Tree:
        token = _by_calls.set(True)
        try:
            return function(*arguments, **options)
        finally:
            _by_calls.reset(token)

    on_processor = platform == "cpu"
    return jax.jit(
        write_as_calls if on_processor and jax.__version_info__ < (0, 12) else function,
        static_argnames=static_argnames,
        compiler_options=_choose_processor_options() if on_processor else None,
    )


@functools.cache
def _choose_processor_options() -> dict[str, bool | int] | None:
    """Choose options for the compiler, none where this version refuses them."""
    # By itself XLA does not take the widest vectors of a processor. A minimum that does not
    # propagate NaN is faster, and blocks with NaN are masked here anyway.
    options = {"xla_cpu_prefer_vector_width": 512, "xla_cpu_enable_fast_min_max": True}
    try:
        # On a processor, whatever the default device is.
        with jax.default_device(jax.local_devices(backend="cpu")[0]):
            trial = jax.jit(lambda x: x + x, compiler_options=options)
            trial.lower(np.zeros(2, np.float32)).compile()
    except Exception:  # another type in each version
        return None
    return options
