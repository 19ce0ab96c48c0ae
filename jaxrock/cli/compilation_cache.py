"""What commands have compiled, for the next command in the user's cache folder.

JAX finds a program by all that it consists of, its own version and the processor included. So
what it finds always fits; what fits no longer is not found, and goes as the oldest.
"""

import contextlib
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import platformdirs

LARGEST = 100_000_000  # bytes of the folder; a command leaves 0.3 MB
_CACHE_ERROR = re.compile(
    "Error (reading|writing) persistent compilation cache entry for '(.*?)'"
)


@contextlib.contextmanager
def cached() -> Iterator[None]:
    """Keep what is compiled inside, and use what was compiled before.

    Unless the user has told JAX where to keep it, or not to, and unless there is no folder for
    it.
    """
    folder = platformdirs.user_cache_path("jaxrock", appauthor=False) / "compiled"
    told = jax.config.jax_compilation_cache_dir or not jax.config.jax_enable_compilation_cache
    own = folder.is_absolute() and not told  # relative for a user without a home
    if own:
        with contextlib.suppress(OSError):  # nobody else's, since JAX runs what it finds
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not own or not folder.is_dir():
        yield
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    try:
        with _in_silence(folder):
            yield
    finally:
        _drop_oldest(folder)


@contextlib.contextmanager
def _in_silence(folder: Path) -> Iterator[None]:
    """Hide that JAX cannot read or write a program, and remove what it cannot read.

    It writes in place: what was cut off when its process was killed would stay so for ever.
    """
    with warnings.catch_warnings():
        show = warnings.showwarning

        def filtered(message: Any, *place: Any, **options: Any) -> None:
            error = _CACHE_ERROR.match(str(message))
            if error is None:
                show(message, *place, **options)
            elif error[1] == "reading":
                for path in folder.iterdir():
                    if path.name.startswith(f"{error[2]}-"):
                        path.unlink(missing_ok=True)

        # Shown, and so filtered, also where warnings are errors.
        warnings.filterwarnings("always", message=_CACHE_ERROR.pattern)
        warnings.showwarning = filtered
        yield


def _drop_oldest(folder: Path) -> None:
    """Remove what was not used for longest, until `LARGEST` is left."""
    with contextlib.suppress(OSError):  # another command does the same
        files = [(path, path.stat()) for path in folder.iterdir()]
        size = 0
        for path, status in sorted(files, key=lambda file: -file[1].st_atime):
            size += status.st_size
            if size > LARGEST:
                path.unlink()
