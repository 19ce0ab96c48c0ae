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
except ImportError:  # not on Windows, where leftovers stay
    fcntl = None

_PREFIX = ".unfinished-"
_NAME = re.compile(re.escape(_PREFIX) + "[a-z0-9_]{8}")  # as `tempfile` makes them
_LOCK = ".lock"  # in a scratch folder; held by the process that fills it
_ours = threading.RLock()  # held while a scratch folder is made, moved or removed
_unfinished: list["_Scratch"] = []


def read_regular(path: Path) -> bytes:
    """The content of a file; an `OSError` for a pipe or a device, which might never end."""
    if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a regular file was expected, not a pipe or a device")
    return path.read_bytes()


class CannotWrite(ValueError):
    """A folder that cannot be written to; `reason` says why."""

    def __init__(self, argument: str, folder: Path, reason: object):
        super().__init__(f"{argument}: the folder {str(folder)!r} cannot be written to: {reason}")
        self.reason = reason


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
        raise CannotWrite(argument, folder, error.strerror or error) from error


@contextlib.contextmanager
def written_whole(
    argument: str, folder: Path, names: Sequence[str], overwrite: bool
) -> Iterator[Path]:
    """Let the body write the files `names` into a scratch folder, then move them to `folder`.

    A missing folder is made. If the body raises, nothing is left behind; what processes left
    there that were killed is removed first.

    Raises
    ------
    ValueError
        Naming the `argument` that said where to write: if a file exists and `overwrite` is
        false, or if anything cannot be written.

    Warns
    -----
    UserWarning
        Naming what processes that were killed had left.
    """
    check_free(argument, folder, names, overwrite)
    scratch, moved = None, []
    try:
        with _ours:
            made = [path for path in (folder, *folder.parents) if not path.exists()]
            scratch = _Scratch(made)
            folder.mkdir(parents=True, exist_ok=True)
            _sweep(folder)
            scratch.make(folder)
        assert scratch.path is not None
        yield scratch.path
        with _ours:  # all or none, also for `abandon`
            for name in names:
                os.replace(scratch.path / name, folder / name)
                moved.append(folder / name)
            scratch.made = []
    except OSError as error:
        raise CannotWrite(argument, folder, error.strerror or error) from error
    except CannotWrite as error:  # from the body, which writes into the scratch folder
        raise CannotWrite(argument, folder, error.reason) from error
    except RuntimeError as error:
        if str(error).startswith("NetCDF:"):  # how it reports a full disk, among others
            raise CannotWrite(argument, folder, error) from error
        raise
    finally:
        if scratch is not None:
            with _ours:
                for path in moved if scratch.made else []:  # in a folder that was not there before
                    path.unlink()
                scratch.remove()


def abandon() -> None:
    """Remove what this process has not finished writing, and let it write nothing from now on.

    For a process that is about to end, from any thread: others wait at the next file that they
    would make, move or remove. Files that are being moved to their place still get there, all.
    """
    _ours.acquire(timeout=10)  # seconds; a file system that hangs must not keep it alive
    for scratch in reversed(_unfinished):
        scratch.remove(patience=2)


class _Scratch:
    """A folder for files that are not finished, and the folders that were made for it."""

    def __init__(self, made: list[Path]):
        self.made = made
        self.path: Path | None = None
        self._lock: int | None = None
        _unfinished.append(self)

    def make(self, folder: Path) -> None:
        """Make it in `folder`, locked: the lock is what says that its process is alive."""
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
            try:
                self._lock = _locked(self.path)
            except BlockingIOError:  # taken for a leftover in just this moment
                continue
            except _NoLocks:
                self._lock = None  # nobody can tell whether its process is alive
            except OSError:
                self.path.rmdir()
                self.path = None
                raise
            return

    def remove(self, patience: float = 0.0) -> None:
        """Remove it with what is in it, and the folders made for it if nothing else is there."""
        if self not in _unfinished:
            return
        _unfinished.remove(self)
        reason = self.path and _remove(self.path, self._lock, patience)
        if reason:
            warnings.warn(f"{str(self.path)!r} cannot be removed: {reason}", stacklevel=3)
        for path in self.made:
            with contextlib.suppress(OSError):
                path.rmdir()


class _NoLocks(OSError):
    """Files cannot be locked here."""


def _locked(folder: Path) -> int:
    """A descriptor that holds the lock of a scratch folder until it is closed.

    Raises
    ------
    BlockingIOError
        If a process that is alive holds it, or has just removed the folder.
    OSError
        If there are no locks here, or the file cannot be opened.
    """
    if fcntl is None:
        raise _NoLocks
    path = folder / _LOCK
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except FileNotFoundError:
        raise BlockingIOError from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not os.path.samestat(os.fstat(lock), os.stat(path)):
            raise BlockingIOError
    except OSError as error:
        os.close(lock)
        taken = isinstance(error, BlockingIOError | FileNotFoundError)
        raise (BlockingIOError if taken else _NoLocks) from error
    return lock


def _sweep(folder: Path) -> None:
    """Remove the scratch folders of processes that were killed, and name them."""
    try:
        found = [path for path in sorted(folder.iterdir()) if _NAME.fullmatch(path.name)]
    except PermissionError:  # one may write there, but not see what there is
        return
    for path in found:
        if path.is_symlink():
            continue
        try:
            lock = _locked(path)
        except OSError:  # its process is alive, or nobody can tell, or it is no folder
            continue
        reason = _remove(path, lock)
        how = f"could not be removed: {reason}" if reason else "is now removed"
        warnings.warn(f"{str(path)!r}, left by a process that was killed, {how}", stacklevel=3)


def _remove(folder: Path, lock: int | None, patience: float = 0.0) -> str | None:
    """Remove a scratch folder and give its lock back, or say why that cannot be."""
    reason = _removed(folder, patience)
    if lock is not None:
        os.close(lock)
    # Now there is a file descriptor more, and on a network nobody has a file of it open.
    return reason and _removed(folder)


def _removed(folder: Path, patience: float = 0.0) -> str | None:
    """Remove a folder, or say why that cannot be.

    Within `patience`, in seconds, try again: another thread may still write into it. Of the
    file descriptors it takes one at a time, unlike `shutil.rmtree`: they may be what is short.
    """
    until = time.monotonic() + patience
    while True:
        try:
            for path, folders, files in os.walk(folder, topdown=False, onerror=_raise):
                for name in files:
                    os.unlink(os.path.join(path, name))
                for name in folders:
                    os.rmdir(os.path.join(path, name))
            os.rmdir(folder)
            return None
        except OSError as error:
            if not folder.exists():
                return None
            if time.monotonic() >= until:
                return error.strerror
            time.sleep(0.01)


def _raise(error: OSError) -> None:
    raise error
