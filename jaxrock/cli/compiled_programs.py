"""Compiled programs of commands, kept for the next command in the user's cache folder."""

import contextlib
from pathlib import Path

import jax
import platformdirs

MAX_BYTES = 100_000_000  # of the folder; a command leaves 0.3 MB


def keep_compiled() -> None:
    """Keep the programs that are compiled from now on, and use those of earlier commands.

    Nothing is changed if the user has told JAX where to keep them, or not to keep any, or if
    there can be no folder for them.
    """
    folder = platformdirs.user_cache_path("jaxrock", appauthor=False) / "compiled"
    told = jax.config.jax_compilation_cache_dir or not jax.config.jax_enable_compilation_cache
    # For a user without a home the path is relative: it would litter the current folder.
    if told or not folder.is_absolute():
        return
    # JAX runs the programs that it finds: nobody else may write them there. A folder that
    # cannot be made, as on a disk that is read only, costs time and nothing else.
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _drop_oldest(folder)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        # By default JAX keeps only what took a second to compile.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)


def _drop_oldest(folder: Path) -> None:
    """Remove the programs that were used longest ago, until `MAX_BYTES` are left.

    JAX can do this with the package filelock, but JAX 0.8 then fails at every program once a
    process was killed between two of its files.
    """
    size = 0
    for path in sorted(folder.iterdir(), key=lambda file: -file.stat().st_atime):
        size += path.stat().st_size
        if size > MAX_BYTES:
            path.unlink(missing_ok=True)
