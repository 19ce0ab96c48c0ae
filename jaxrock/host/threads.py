"""Threads that work under the JAX settings of the thread that starts them."""

import concurrent.futures
import contextlib
import functools
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

import jax

_T = TypeVar("_T")
_R = TypeVar("_R")
_NAME = "jaxrock-worker"  # of threads


def processors() -> int:
    """Count the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def mapped(function: Callable[[_T], _R], items: Iterable[_T], workers: int) -> list[_R]:
    """Compute the results of a function by threads, in the order of the items.

    However many threads call this at once, as those of Dask do, together they keep no more
    processors busy than there are.
    """
    # One of its own threads must not wait for others, of which none may be left.
    if workers == 1 or threading.current_thread().name.startswith(_NAME):
        return list(map(function, items))
    settings = settings_of_jax()

    def under_settings(item: _T) -> _R:
        with under(settings):
            return function(item)

    return list(_pool(workers).map(under_settings, items))


@functools.cache
def _pool(workers: int) -> concurrent.futures.ThreadPoolExecutor:
    return concurrent.futures.ThreadPoolExecutor(workers, _NAME)


def settings_of_jax() -> dict[str, Any]:
    """Collect the settings of JAX that a context manager can make, for a thread or process.

    A setting made by a context manager, such as ``with jax.enable_x64(True):``, applies to its
    own thread only.
    """
    return {name: getattr(jax.config, f"jax_{name}") for name in _settings()}


@contextlib.contextmanager
def under(settings: Mapping[str, Any]) -> Iterator[None]:
    """Give JAX these settings inside."""
    with contextlib.ExitStack() as stack:
        for name, value in settings.items():
            if getattr(jax.config, f"jax_{name}") != value:
                stack.enter_context(getattr(jax, name)(value))
        yield


@functools.cache
def _settings() -> list[str]:
    """Names of the settings of JAX that a context manager can make."""
    names = [
        name.removeprefix("jax_") for name in jax.config.values if name.startswith("jax_")
    ]
    return [name for name in names if hasattr(jax, name)]
