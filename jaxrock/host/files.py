"""Reading regular files, and writing files whole or not at all, whatever interrupts it."""

import contextlib
import errno
import os
import shutil
import signal
import stat
import threading
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Of this process, beside the folders of the files.
_scratch_folders = set[Path]()


def read_regular(path: Path) -> bytes:
    """Read a file; an `OSError` for a pipe or a device, which might never end."""
    if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a regular file was expected, not a pipe or a device")
    return path.read_bytes()


def sync(path: Path) -> None:
    """Bring a file, or all files of a folder, onto the disk itself.

    Without this a power failure could keep the name of a file and lose its content.
    """
    inner = [path] if path.is_file() else path.rglob("*")
    for file in inner:
        if file.is_file():
            with open(file, "rb") as stream:
                os.fsync(stream.fileno())


@contextlib.contextmanager
def defer_interrupts() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the body is done.

    A handler may raise an exception anywhere, even in a library that holds a lock: whoever
    wants the lock next, as to close a file, waits for ever. Only the main thread has handlers,
    and only it is interrupted.
    """
    is_main = threading.current_thread() is threading.main_thread()
    # A handler that is not Python's, as in R, could not be put back.
    numbers = [n for n in _SIGNALS if is_main and signal.getsignal(n) is not None]
    waiting = set[int]()
    handlers = {n: signal.signal(n, lambda came, _: waiting.add(came)) for n in numbers}
    try:
        yield
    finally:
        for number, handler in reversed(handlers.items()):
            signal.signal(number, handler)
        for number in waiting:
            signal.raise_signal(number)


def end_process(number: int, _: object) -> None:
    """Remove unfinished files and end this process at once, as a handler of signals.

    For a process that has nothing else to do. No exception is raised, which could meet a lock
    as `defer_interrupts` says. The exit code is the one of a shell, 128 + number.
    """
    for scratch in tuple(_scratch_folders):
        shutil.rmtree(scratch, ignore_errors=True)
    with contextlib.suppress(OSError):
        os.write(2, b"jaxrock: interrupted\n")  # `print` may be what is interrupted
    os._exit(128 + number)


class CannotWrite(ValueError):
    """The error that a folder cannot be written to, for the `reason` of another error."""

    def __init__(self, argument: str, folder: Path, error: Exception):
        self.reason = (
            getattr(error, "reason", None) or getattr(error, "strerror", None) or error
        )
        where = f"{argument}: the folder {str(folder)!r}"
        super().__init__(f"{where} cannot be written to: {self.reason}")


@contextlib.contextmanager
def write_whole(
    argument: str, folder: Path, names: Sequence[str], overwrite: bool
) -> Iterator[Path]:
    """Let the body write the files `names` into a scratch folder, then move them to `folder`.

    Nothing is computed before it is known that the files can be written. A missing folder is
    made. If the body raises, nothing is left behind. A `ValueError` names the `argument` that
    said where to write: if a file exists and `overwrite` is false, or if anything cannot be
    written.
    """
    try:
        _check_free(argument, folder, names, overwrite)
        # As near to the target as there is a folder: only within one file system is a move
        # atomic.
        nearest = next(path for path in (folder, *folder.parents) if path.is_dir())
        scratch = nearest / f".unfinished-{uuid.uuid4().hex[:8]}"
        _scratch_folders.add(scratch)
        try:
            scratch.mkdir()
            yield scratch
            # All are on the disk before the first gets its name: a full disk leaves none.
            for name in names:
                sync(scratch / name)
            # Another run may have written meanwhile.
            _check_free(argument, folder, names, overwrite)
            with defer_interrupts():
                folder.mkdir(parents=True, exist_ok=True)
                for name in names:
                    os.replace(scratch / name, folder / name)
        finally:
            with defer_interrupts():
                shutil.rmtree(scratch, ignore_errors=True)
            _scratch_folders.discard(scratch)
    except (OSError, CannotWrite, RuntimeError) as error:  # CannotWrite: of the scratch folder
        if isinstance(error, RuntimeError) and not str(error).startswith("NetCDF:"):
            raise  # netCDF4 reports a full disk, among others, as "NetCDF: ..."
        raise CannotWrite(argument, folder, error) from error


def _check_free(argument: str, folder: Path, names: Sequence[str], overwrite: bool) -> None:
    """Raise `ValueError` if a file is in the way, `OSError` if there can be no such folder."""
    for path in (folder / name for name in names):
        if path.is_dir():
            raise ValueError(f"{argument}: {str(path)!r} is a folder, a file was expected")
        if path.exists() and not path.is_file():  # a device, which the file would replace
            raise ValueError(f"{argument}: {str(path)!r} is not a regular file")
        if path.exists() and not overwrite:
            raise ValueError(f"{argument}: {str(path)!r} exists; --force overwrites it")
    for parent in (folder, *folder.parents):
        if parent.exists() and not parent.is_dir():
            raise NotADirectoryError(f"{str(parent)!r} is a file")
