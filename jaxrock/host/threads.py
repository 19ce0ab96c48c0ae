"""Threads that work under the JAX settings of the thread that starts them."""

import concurrent.futures
import contextlib
import functools
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import jax

_T = TypeVar("_T")
_R = TypeVar("_R")
_NAME = "jaxrock-worker"  # with which the names of threads begin


def count_processors() -> int:
    """Count the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def map_in_threads(
    function: Callable[[_T], _R], items: Iterable[_T], workers: int
) -> list[_R]:
    """Compute the results of a function by threads, in the order of the items.

    However many threads call this at once, as those of Dask do, together they keep no more
    processors busy than there are.
    """
    # A thread of the pool must not wait for others: none may be left.
    if workers == 1 or threading.current_thread().name.startswith(_NAME):
        return list(map(function, items))
    settings = read_jax_settings()

    def compute(item: _T) -> _R:
        with apply_settings(settings):
            return function(item)

    return list(_make_pool(workers).map(compute, items))


# One for all calls that want so many workers, which thereby share processors.
@functools.cache
def _make_pool(workers: int) -> concurrent.futures.ThreadPoolExecutor:
    """Make the pool of so many threads."""
    return concurrent.futures.ThreadPoolExecutor(workers, _NAME)


def read_jax_settings() -> dict[str, object]:
    """Read the settings of JAX that a context manager can make, for another thread or process.

    A setting made by a context manager, such as ``with jax.enable_x64(True):``, applies to its
    own thread only.
    """
    return {name: getattr(jax.config, f"jax_{name}") for name in _list_settings()}


@contextlib.contextmanager
def apply_settings(settings: Mapping[str, object]) -> Iterator[None]:
    """Let JAX work under these settings inside."""
    with contextlib.ExitStack() as stack:
        for name, value in settings.items():
            if getattr(jax.config, f"jax_{name}") != value:
                stack.enter_context(getattr(jax, name)(value))
        yield


@functools.cache
def _list_settings() -> list[str]:
    """List the settings of JAX that a context manager can make."""
    # JAX has no list of them; each has the name of its flag.
    names = [
        name.removeprefix("jax_") for name in jax.config.values if name.startswith("jax_")
    ]
    return [name for name in names if hasattr(jax, name)]
