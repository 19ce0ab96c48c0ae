"""Compiled programs of commands, kept for the next command in the user's cache folder.

JAX finds a program by all that it consists of, its own version and the processor included: a
program that is found fits. JAX can bound the folder by itself, with the package filelock; but
JAX 0.8 then fails at every program once a process was killed between two of its files.
"""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import jax
import platformdirs

MAX_BYTES = 100_000_000  # of the folder; a command leaves 0.3 MB


@contextlib.contextmanager
def keep_compiled() -> Iterator[None]:
    """Keep the programs that are compiled inside, and use those of earlier commands.

    Nothing is changed if the user has told JAX where to keep them, or not to keep any, or if
    there can be no folder for them.
    """
    folder = platformdirs.user_cache_path("jaxrock", appauthor=False) / "compiled"
    told = jax.config.jax_compilation_cache_dir or not jax.config.jax_enable_compilation_cache
    # For a user without a home the path is relative: it would litter the current folder.
    if folder.is_absolute() and not told:
        # JAX runs the programs that it finds: nobody else may write them there. A folder that
        # cannot be made, as on a disk that is read only, costs time and nothing else.
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _drop_oldest(folder)
            jax.config.update("jax_compilation_cache_dir", str(folder))
            # By default JAX keeps only what took a second to compile. A command compiles many
            # programs that take less, and runs each of them once.
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    with warnings.catch_warnings():
        # A program that a killed process has cut off is compiled anew each time, until it is
        # dropped. JAX has no class of warning for its cache.
        warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation")
        yield


def _drop_oldest(folder: Path) -> None:
    """Remove the programs that were used longest ago, until `MAX_BYTES` are left."""
    files = [(path, path.stat()) for path in folder.iterdir()]
    size = 0
    # Reading a file sets its time of access, unless the system is mounted without: then the
    # times are those of writing, and the oldest go.
    for path, status in sorted(files, key=lambda file: -file[1].st_atime):
        size += status.st_size
        if size > MAX_BYTES:
            path.unlink(missing_ok=True)
