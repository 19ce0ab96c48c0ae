"""Reading regular files, and writing files whole or not at all."""

import contextlib
import errno
import os
import re
import stat
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

try:
    import fcntl
except ImportError:  # on Windows, where scratch folders of killed processes stay
    fcntl = None

_PREFIX = ".unfinished-"
_NAME = re.compile(re.escape(_PREFIX) + "[a-z0-9_]{8}")  # as `tempfile` makes them
_LOCK = ".lock"  # in a scratch folder; held by the process that fills it
_changing = threading.RLock()  # held while a scratch folder is made, moved or removed
_unfinished: list["_Scratch"] = []


def read_regular(path: Path) -> bytes:
    """The content of a file; an `OSError` for a pipe or a device, which might never end."""
    if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a regular file was expected, not a pipe or a device")
    return path.read_bytes()


class CannotWrite(ValueError):
    """A folder that cannot be written to, because of the `reason` that an error gives."""

    def __init__(self, argument: str, folder: Path, error: Exception):
        self.reason = getattr(error, "reason", None) or getattr(error, "strerror", None) or error
        where = f"{argument}: the folder {str(folder)!r}"
        super().__init__(f"{where} cannot be written to: {self.reason}")


def check_free(argument: str, folder: Path, names: Sequence[str], overwrite: bool) -> None:
    """Raise `ValueError` if a file is in the way, naming the `argument` that said where."""
    try:
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
    except OSError as error:
        raise CannotWrite(argument, folder, error) from error


@contextlib.contextmanager
def written_whole(
    argument: str, folder: Path, names: Sequence[str], overwrite: bool
) -> Iterator[Path]:
    """Let the body write the files `names` into a scratch folder, then move them to `folder`.

    A missing folder is made. If the body raises, nothing is left behind. Scratch folders of
    processes that were killed are removed first, with a warning that names them. A `ValueError`
    names the `argument` that said where to write: if a file exists and `overwrite` is false, or
    if anything cannot be written.
    """
    check_free(argument, folder, names, overwrite)
    scratch, moved = None, []
    try:
        with _changing:
            scratch = _Scratch([path for path in (folder, *folder.parents) if not path.exists()])
            folder.mkdir(parents=True, exist_ok=True)
            _sweep(folder)
            path = scratch.make(folder)
        yield path
        with _changing:  # all or none, even if `abandon` is called meanwhile
            for name in names:
                os.replace(path / name, folder / name)
                moved.append(folder / name)
            scratch.made = []
    except (OSError, CannotWrite, RuntimeError) as error:  # CannotWrite: of the scratch folder
        if isinstance(error, RuntimeError) and not str(error).startswith("NetCDF:"):
            raise  # netCDF4 reports a full disk, among others, as "NetCDF: ..."
        raise CannotWrite(argument, folder, error) from error
    finally:
        if scratch is not None:
            with _changing:
                for path in moved if scratch.made else []:  # in a folder that was not there before
                    path.unlink()
                scratch.remove()


def abandon() -> None:
    """Remove what this process has not finished writing, and let it write nothing from now on.

    For a process that is about to end, from any thread: others wait at the next scratch folder
    that they would make, move or remove. A move that has begun is completed.
    """
    _changing.acquire(timeout=10)  # seconds; a file system that hangs must not keep it alive
    for scratch in reversed(_unfinished):
        scratch.remove(patience=2)


class _Scratch:
    """A folder for files that are not finished, and the folders that were made for it."""

    def __init__(self, made: list[Path]):
        self.made = made
        self.path: Path | None = None
        self._lock: int | None = None
        _unfinished.append(self)

    def make(self, folder: Path) -> Path:
        """Make it in `folder`, locked: the lock tells others that its process is alive."""
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
            try:
                self._lock = _locked(self.path)
            except BlockingIOError:  # another process has just taken it for a leftover
                continue
            except OSError:
                self.path.rmdir()
                self.path = None
                raise
            return self.path

    def remove(self, patience: float = 0.0) -> None:
        """Remove it with its content, and the folders made for it if nothing else is there."""
        if self not in _unfinished:
            return
        _unfinished.remove(self)
        reason = self.path and _remove(self.path, self._lock, patience)
        if reason:
            warnings.warn(f"{str(self.path)!r} cannot be removed: {reason}", stacklevel=3)
        for path in self.made:
            with contextlib.suppress(OSError):
                path.rmdir()


def _locked(folder: Path) -> int | None:
    """A descriptor that holds the lock of a scratch folder until closed; None without locks.

    A `BlockingIOError` if a process that is alive holds it, or has just removed the folder.
    """
    if fcntl is None:
        return None
    path = folder / _LOCK
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except FileNotFoundError:
        raise BlockingIOError from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(lock), os.stat(path)):
            return lock
    except OSError as error:
        if not isinstance(error, BlockingIOError | FileNotFoundError):
            os.close(lock)
            return None
    os.close(lock)
    raise BlockingIOError


def _sweep(folder: Path) -> None:
    """Remove the scratch folders of processes that were killed, and name them."""
    try:
        leftovers = [path for path in sorted(folder.iterdir()) if _NAME.fullmatch(path.name)]
    except PermissionError:  # a folder may be writable, but not readable
        return
    for path in leftovers:
        lock = None
        with contextlib.suppress(OSError):  # its process is alive, or it is no folder
            lock = None if path.is_symlink() else _locked(path)
        if lock is not None:
            reason = _remove(path, lock)
            how = f"could not be removed: {reason}" if reason else "is now removed"
            warnings.warn(f"{str(path)!r}, left by a process that was killed, {how}", stacklevel=3)


def _remove(folder: Path, lock: int | None, patience: float = 0.0) -> str | None:
    """Remove a scratch folder and release its lock, or say why that is not possible.

    For `patience`, in seconds, try again: another thread may still write into it.
    """
    until = time.monotonic() + patience
    while (reason := _removed(folder)) and time.monotonic() < until:
        time.sleep(0.01)
    if lock is not None:
        os.close(lock)
    # Now one more file descriptor is free, and no file in it is open, which a network needs.
    return reason and _removed(folder)


def _removed(folder: Path) -> str | None:
    # Takes one file descriptor at a time, unlike `shutil.rmtree`: they may have run out.
    try:
        for path, folders, files in os.walk(folder, topdown=False, onerror=_raise):
            for name in files:
                os.unlink(os.path.join(path, name))
            for name in folders:
                os.rmdir(os.path.join(path, name))
        os.rmdir(folder)
    except OSError as error:
        return error.strerror if folder.exists() else None
    return None


def _raise(error: OSError) -> None:
    raise error
