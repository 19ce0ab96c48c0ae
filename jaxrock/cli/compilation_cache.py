"""Compiled programs of commands, kept for the next command in the user's cache folder.

JAX finds a program by all that it consists of, its own version and the processor included. A
program that is found fits, therefore. One that fits no longer is not found any more, and is
removed in time as the one that was used longest ago.
"""

import contextlib
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import jax
import platformdirs

LARGEST = 100_000_000  # bytes of the folder; a command leaves 0.3 MB
# JAX has no class of warning for its cache: these are known by how they begin.
_CACHE_ERROR = re.compile(
    "Error (reading|writing) persistent compilation cache entry for '(.*?)'"
)


@contextlib.contextmanager
def keep_compiled() -> Iterator[None]:
    """Keep the programs that are compiled inside, and use those of earlier commands.

    Nothing is changed if the user has told JAX where to keep them, or not to keep any, or if
    there can be no folder for them.
    """
    folder = platformdirs.user_cache_path("jaxrock", appauthor=False) / "compiled"
    told = jax.config.jax_compilation_cache_dir or not jax.config.jax_enable_compilation_cache
    # For a user without a home the path is relative: it would litter the current folder.
    own = folder.is_absolute() and not told
    if own:
        # JAX runs the programs that it finds: nobody else may write them there. A folder that
        # cannot be made, as on a disk that is read only, costs time and nothing else.
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not own or not folder.is_dir():
        yield
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # By default JAX keeps only what took a second to compile. A command compiles many programs
    # that take less, and runs each of them once.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    try:
        with _silence_cache_errors(folder):
            yield
    finally:
        _drop_oldest(folder)


@contextlib.contextmanager
def _silence_cache_errors(folder: Path) -> Iterator[None]:
    """Hide the warnings that JAX cannot read or write a program, and remove those unreadable.

    JAX writes in place. A file that was cut off, as its process was killed, would stay as it
    is for ever, since JAX does not write a program that is there already.
    """
    with warnings.catch_warnings():
        show = warnings.showwarning

        def show_others(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            """Show a warning that is not about the cache; remove a file that is unreadable."""
            error = _CACHE_ERROR.match(str(message))
            if error is None:
                show(message, category, filename, lineno, file, line)
            # The warning names the program, and not its key: all files of that name go.
            elif error[1] == "reading":
                for path in folder.iterdir():
                    if path.name.startswith(f"{error[2]}-"):
                        path.unlink(missing_ok=True)

        # Where warnings are errors (python -W error) this one would end the command before it
        # is shown, and so before it gets here.
        warnings.filterwarnings("always", message=_CACHE_ERROR.pattern)
        warnings.showwarning = show_others
        yield


def _drop_oldest(folder: Path) -> None:
    """Remove the programs that were used longest ago, until `LARGEST` is left.

    JAX can bound the folder by itself, but then needs the package filelock.
    """
    # A command beside this one may have removed a file since it was listed. The next one goes
    # on.
    with contextlib.suppress(OSError):
        files = [(path, path.stat()) for path in folder.iterdir()]
        size = 0
        # Reading a file sets its time of access, unless the system is mounted without: then
        # the times are those of writing, and the oldest go.
        for path, status in sorted(files, key=lambda file: -file[1].st_atime):
            size += status.st_size
            if size > LARGEST:
                path.unlink()
