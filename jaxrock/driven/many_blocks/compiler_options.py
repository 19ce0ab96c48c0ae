"""Compilation of programs that simulate a batch on their own, with options for XLA."""

import functools
from collections.abc import Callable
from typing import TypeVar

import jax
import numpy as np

from .single_kernels import needs_calls, write_as_calls

_Option = bool | int
_R = TypeVar("_R")


def jit_steps(
    function: Callable[..., _R], platform: str, static_argnames: tuple[str, ...]
) -> Callable[..., _R]:
    """Jit a function that takes steps, so that it is as fast on a platform as it can be."""
    write = write_as_calls(function) if needs_calls(platform) else function
    return jax.jit(
        write,
        static_argnames=static_argnames,
        compiler_options=_choose_compiler_options(platform),
    )


@functools.cache
def _choose_compiler_options(platform: str) -> dict[str, _Option] | None:
    """Choose the options for a platform, leaving out any that its compiler refuses."""
    if platform != "cpu":
        return None
    # By itself XLA does not take the widest vectors of a processor. A minimum that does not
    # propagate NaN is faster, and blocks with NaN are masked here anyway.
    options: dict[str, _Option] = {
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_enable_fast_min_max": True,
    }
    return {name: value for name, value in options.items() if _is_taken(name, value)}


def _is_taken(name: str, value: _Option) -> bool:
    """Return whether the compiler takes an option, which it may not know in another version."""
    try:
        trial = jax.jit(lambda x: x + x, compiler_options={name: value})
        # On a processor, whatever the default device is.
        with jax.default_device(jax.local_devices(backend="cpu")[0]):
            trial.lower(np.zeros(2, np.float32)).compile()
    except Exception:  # another type in each version
        return False
    return True
