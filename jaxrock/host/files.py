"""Files that are written whole or not at all, whatever interrupts it."""

import contextlib
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_scratch_folders = set[str]()  # of this process, beside the folders of the files


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
        for path in (folder / name for name in names):
            if path.exists() and not overwrite:
                raise ValueError(f"{argument}: {str(path)!r} exists; --force overwrites it")
        # As near to the target as there is a folder: only within one file system is a move
        # atomic.
        nearest = next(path for path in (folder, *folder.parents) if path.exists())
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=nearest) as scratch:
            _scratch_folders.add(scratch)
            yield Path(scratch)
            with defer_interrupts():
                folder.mkdir(parents=True, exist_ok=True)
                for name in names:
                    os.replace(Path(scratch, name), folder / name)
    except (OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not str(error).startswith("NetCDF:"):
            raise  # netCDF4 reports a full disk, among others, as "NetCDF: ..."
        where = f"{argument}: the folder {str(folder)!r} cannot be written to"
        raise ValueError(f"{where}: {getattr(error, 'strerror', None) or error}") from error
