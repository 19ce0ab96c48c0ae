"""Threads that work under the JAX settings of the thread that starts them."""

import concurrent.futures
import contextlib
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax

_T = TypeVar("_T")
_R = TypeVar("_R")


def mapped(function: Callable[[_T], _R], items: Iterable[_T], workers: int) -> list[_R]:
    """The results of a function, computed by threads, in the order of the items.

    A setting made by a context manager, such as ``with jax.enable_x64(True):``, applies to its own
    thread only. The workers take over the settings of the caller.
    """
    names = [name.removeprefix("jax_") for name in jax.config.values if name.startswith("jax_")]
    names = [name for name in names if hasattr(jax, name)]  # those with a context manager
    settings: dict[str, Any] = {name: getattr(jax.config, f"jax_{name}") for name in names}

    def under_settings(item: _T) -> _R:
        with contextlib.ExitStack() as stack:
            for name, value in settings.items():
                if getattr(jax.config, f"jax_{name}") != value:
                    stack.enter_context(getattr(jax, name)(value))
            return function(item)

    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        return list(pool.map(under_settings, items))
