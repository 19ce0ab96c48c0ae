"""Options for XLA, for programs that follow a batch on their own."""

import functools

import jax
import numpy as np

from .taylor import materialize

_Option = bool | int | str


@functools.cache
def choose_compiler_options(platform: str) -> dict[str, _Option] | None:
    """Choose the options for a platform, leaving out any that its compiler refuses."""
    if platform != "cpu":
        return None
    # By itself XLA does not take the widest vectors of a processor. A minimum that does not
    # propagate NaN is faster, and blocks with NaN are masked here anyway.
    options: dict[str, _Option] = {
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_enable_fast_min_max": True,
    }
    if jax.__version_info__ < (0, 11):
        # This pass removes the barriers against recomputation, too early in these versions.
        options["xla_disable_hlo_passes"] = "cse_barrier_expander"
    return {name: value for name, value in options.items() if _is_taken(name, value)}


def _is_taken(name: str, value: _Option) -> bool:
    """Tell whether the compiler takes an option, which it may not know in another version."""
    try:
        trial = jax.jit(lambda x: materialize(x + x) * x, compiler_options={name: value})
        # On a processor, whatever the default device is.
        with jax.default_device(jax.local_devices(backend="cpu")[0]):
            trial.lower(np.zeros(2, np.float32)).compile()
    except Exception:  # another type in each version
        return False
    return True
