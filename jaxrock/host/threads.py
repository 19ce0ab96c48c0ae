"""Threads that work under the JAX settings of the thread that starts them."""

import concurrent.futures
import contextlib
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax

_T = TypeVar("_T")
_R = TypeVar("_R")


def _settings() -> dict[str, Any]:
    """What JAX has a context manager for, as it is in this thread."""
    full = [name for name in jax.config.values if name.startswith("jax_")]
    short = {name.removeprefix("jax_"): name for name in full}
    return {s: getattr(jax.config, name) for s, name in short.items() if hasattr(jax, s)}


def mapped(function: Callable[[_T], _R], items: Iterable[_T], workers: int) -> list[_R]:
    """The results of a function, computed by threads, in the order of the items.

    A setting made by a context manager, such as ``with jax.enable_x64(True):``, holds in its
    own thread only. Here the workers take over those of the caller.
    """
    items = list(items)
    if len(items) < 2:
        return [function(item) for item in items]
    settings = _settings()

    def under_settings(item: _T) -> _R:
        with contextlib.ExitStack() as stack:
            own = _settings()
            for name in own:
                if settings[name] != own[name]:
                    stack.enter_context(getattr(jax, name)(settings[name]))
            return function(item)

    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        return list(pool.map(under_settings, items))
