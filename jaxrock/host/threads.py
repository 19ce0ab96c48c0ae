"""Threads that work under the JAX settings of the thread that starts them."""

import concurrent.futures
import contextlib
import functools
import os
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax

_T = TypeVar("_T")
_R = TypeVar("_R")


def processors() -> int:
    """How many of them this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def mapped(function: Callable[[_T], _R], items: Iterable[_T], workers: int) -> list[_R]:
    """The results of a function, computed by threads, in the order of the items.

    A setting made by a context manager, such as ``with jax.enable_x64(True):``, applies to its own
    thread only. The workers take over the settings of the caller.
    """
    if workers == 1:
        return list(map(function, items))
    settings: dict[str, Any] = {name: getattr(jax.config, f"jax_{name}") for name in _settings()}

    def under_settings(item: _T) -> _R:
        with contextlib.ExitStack() as stack:
            for name, value in settings.items():
                if getattr(jax.config, f"jax_{name}") != value:
                    stack.enter_context(getattr(jax, name)(value))
            return function(item)

    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        return list(pool.map(under_settings, items))


@functools.cache
def _settings() -> list[str]:
    """Names of the settings of JAX that a context manager can make."""
    names = [name.removeprefix("jax_") for name in jax.config.values if name.startswith("jax_")]
    return [name for name in names if hasattr(jax, name)]
