"""What commands have compiled, kept for the next command in the user's cache folder.

JAX finds a program by all that it consists of, its own version and the processor included: what
it finds always fits, and what no longer does is not found and goes as the oldest.
"""

import contextlib
import os
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import platformdirs

LARGEST = 100_000_000  # bytes; a command leaves 0.3 MB
_UNREADABLE = re.compile("Error reading persistent compilation cache entry for '(.*?)'")
_ANY_ERROR = "Error (reading|writing) persistent compilation cache entry"


@contextlib.contextmanager
def kept() -> Iterator[None]:
    """Keep what is compiled inside, and take from there what was compiled before.

    Unless the user has told JAX where to keep it, or not to; and unless there is no folder for
    it. Nothing of this is worth a word: what cannot be read is removed, and compiled again.
    """
    folder = platformdirs.user_cache_path("jaxrock", appauthor=False) / "compiled"
    told = jax.config.jax_compilation_cache_dir or not jax.config.jax_enable_compilation_cache
    if told or not folder.is_absolute():  # as it is for a user without a home
        yield
        return
    with contextlib.suppress(OSError):  # nobody else's, since JAX runs what it finds
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not folder.is_dir():
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
    """Say no word of what JAX cannot read or write; remove what it cannot read.

    JAX writes in place, so a program that was being written when its process was killed is cut
    off, and JAX would leave it so for ever.
    """
    with warnings.catch_warnings():
        show = warnings.showwarning

        def heard(message: Any, *rest: Any, **named: Any) -> None:
            if not re.match(_ANY_ERROR, str(message)):
                show(message, *rest, **named)
            elif unreadable := _UNREADABLE.match(str(message)):
                for path in folder.glob("*"):
                    if path.name.startswith(f"{unreadable[1]}-"):
                        path.unlink(missing_ok=True)

        warnings.filterwarnings("always", message=_ANY_ERROR)  # also where warnings are errors
        warnings.showwarning = heard
        yield


def _drop_oldest(folder: Path) -> None:
    """Remove what was not used for longest, until `LARGEST` is kept."""
    with contextlib.suppress(OSError):  # another command does the same
        files = [(path, path.stat()) for path in folder.iterdir()]
        size = 0
        for path, found in sorted(files, key=lambda file: -file[1].st_atime):
            size += found.st_size
            if size > LARGEST:
                os.unlink(path)
