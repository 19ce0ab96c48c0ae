"""Threads that work under the JAX settings of the thread that starts them."""

import concurrent.futures
import os
import sys
from collections.abc import Callable, Iterable
from typing import TypeVar

import jax

_R = TypeVar("_R")
# Settings that a context manager may have made for its own thread only, such as
# ``with jax.enable_x64(True):``.
_SETTINGS = ("enable_x64", "default_device", "default_matmul_precision", "debug_nans")


def count_processors() -> int:
    """Count the processors that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def map_in_threads(
    function: Callable[..., _R], items: Iterable[object], workers: int
) -> list[_R]:
    """Compute the results of a function by threads, in the order of the items."""
    if workers == 1:
        return list(map(function, items))
    settings = {name: getattr(jax.config, f"jax_{name}") for name in _SETTINGS}

    def apply_settings() -> None:
        # They end with their thread, and this with the pool.
        for name, value in settings.items():
            getattr(jax, name)(value).__enter__()

    with concurrent.futures.ThreadPoolExecutor(workers, initializer=apply_settings) as pool:
        return list(pool.map(function, items))
