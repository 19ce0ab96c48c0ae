"""Reading regular files, and writing files whole or not at all."""

import contextlib
import errno
import os
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

_PREFIX, _LOCK = ".unfinished-", ".lock"
_changing = threading.RLock()  # held while a scratch folder is made, moved or removed
_unfinished: list[contextlib.ExitStack] = []  # what removes them


def read_regular(path: Path) -> bytes:
    """The content of a file; an `OSError` for a pipe or a device, which might never end."""
    if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a regular file was expected, not a pipe or a device")
    return path.read_bytes()


def sync(path: Path) -> None:
    """Have a file, or all files of a folder, on the disk itself, before its name is."""
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    for file in files:
        with open(file, "rb") as stream:
            os.fsync(stream.fileno())


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
    undo = contextlib.ExitStack()
    made: list[Path] = []  # new folders, and files moved into them, the innermost first
    _unfinished.append(undo)
    try:
        with _changing:
            undo.callback(_unmake, made)
            made += [path for path in (folder, *folder.parents) if not path.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            _sweep(folder)
            scratch = _scratch(folder, undo)
        yield scratch
        for name in names:
            sync(scratch / name)
        with _changing:  # all or none, even if `abandon` is called meanwhile
            for name in names:
                os.replace(scratch / name, folder / name)
                made[:0] = [folder / name] if made else []
            made.clear()
    except (OSError, CannotWrite, RuntimeError) as error:  # CannotWrite: of the scratch folder
        if isinstance(error, RuntimeError) and not str(error).startswith("NetCDF:"):
            raise  # netCDF4 reports a full disk, among others, as "NetCDF: ..."
        raise CannotWrite(argument, folder, error) from error
    finally:
        with _changing:
            _unfinished.remove(undo)
            undo.close()


def abandon() -> None:
    """Remove what this process has not finished writing, and let it write nothing from now on.

    For a process that is about to end, from any thread: others wait at the next scratch folder
    that they would make, move or remove. A move that has begun is completed.
    """
    _changing.acquire(timeout=10)  # seconds; a file system that hangs must not keep it alive
    for undo in reversed(_unfinished):
        undo.close()


def _unmake(made: list[Path]) -> None:
    for path in made:
        with contextlib.suppress(OSError):
            path.rmdir() if path.is_dir() else path.unlink()


def _scratch(folder: Path, undo: contextlib.ExitStack) -> Path:
    """A new folder in `folder`, with a lock that tells others that its process is alive."""
    scratch = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
    # Twice: with the lock, and without, when no file in it is open, which a network needs.
    undo.callback(_remove, scratch)
    if fcntl is not None:
        lock = undo.enter_context((scratch / ".new").open("x"))
        undo.callback(_removed, scratch)
        with contextlib.suppress(OSError):  # where there are no locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.rename(lock.name, scratch / _LOCK)  # which others look for
    return scratch


def _sweep(folder: Path) -> None:
    """Remove the scratch folders of processes that were killed, and name them."""
    if fcntl is None:
        return
    for path in sorted(folder.glob(_PREFIX + 8 * "[a-z0-9_]")):  # as `tempfile` names them
        try:
            with open(path / _LOCK, "r+") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                os.stat(lock.name)
                _removed(path)
        except OSError:  # its process is alive, or another one has just removed it
            continue
        reason = _removed(path)
        how = f"could not be removed: {reason}" if reason else "is now removed"
        warnings.warn(f"{str(path)!r}, left by a process that was killed, {how}", stacklevel=4)


def _remove(scratch: Path) -> None:
    """Remove a scratch folder, for seconds, as another thread may still write into it."""
    # Under another name that thread finds it no more; one by which it can still be swept.
    renamed = scratch.with_name(_PREFIX + scratch.name[: len(_PREFIX) - 1 : -1])
    with contextlib.suppress(OSError):  # gone already, or open, where that forbids it
        if not renamed.exists():
            scratch = scratch.rename(renamed)
    until = time.monotonic() + 2
    while (reason := _removed(scratch)) and time.monotonic() < until:
        time.sleep(0.01)
    if reason:
        warnings.warn(f"{str(scratch)!r} cannot be removed: {reason}", stacklevel=4)


def _removed(folder: Path) -> str | None:
    """Remove a folder with its content, or say why that is not possible."""
    try:
        # Takes one file descriptor at a time, unlike `shutil.rmtree`: they may have run out.
        for path, folders, files in os.walk(folder, topdown=False):
            for name in files:
                os.unlink(os.path.join(path, name))
            for name in folders:
                os.rmdir(os.path.join(path, name))
        os.rmdir(folder)
    except OSError as error:
        return error.strerror if folder.exists() else None
    return None
