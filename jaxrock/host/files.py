"""Reading regular files, and writing files whole or not at all."""

import contextlib
import errno
import os
import platform
import stat
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

# Names of scratch folders begin with it; the machine and the number of the process follow.
_PREFIX = ".unfinished-"
# The paths to remove if this process ends now, for each call of `write_whole` by the `id` of
# its list. Threads may write several at once.
_unfinished: dict[int, list[Path]] = {}


def read_regular(path: Path) -> bytes:
    """Read a file; an `OSError` for a pipe or a device, which might never end."""
    if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "a regular file was expected, not a pipe or a device")
    return path.read_bytes()


def sync(path: Path) -> None:
    """Bring a file, or all files of a folder, onto the disk itself.

    Without this a power failure could keep the name of a file and lose its content.
    """
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    for file in files:
        with open(file, "rb") as stream:
            os.fsync(stream.fileno())


class CannotWrite(ValueError):
    """The error that a folder cannot be written to, for the `reason` of another error."""

    def __init__(self, argument: str, folder: Path, error: Exception):
        self.reason = (
            getattr(error, "reason", None) or getattr(error, "strerror", None) or error
        )
        where = f"{argument}: the folder {str(folder)!r}"
        super().__init__(f"{where} cannot be written to: {self.reason}")


def check_free(argument: str, folder: Path, names: Sequence[str], overwrite: bool) -> None:
    """Raise `ValueError` if a file is in the way, naming the `argument` that said where.

    Commands call this before they compute, so that a long computation is not lost.
    """
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
def write_whole(
    argument: str, folder: Path, names: Sequence[str], overwrite: bool
) -> Iterator[Path]:
    """Let the body write the files `names` into a scratch folder, then move them to `folder`.

    A missing folder is made. If the body raises, nothing is left behind. Scratch folders of
    processes that were killed are removed first, with a warning that names them. A
    `ValueError` names the `argument` that said where to write: if a file exists and
    `overwrite` is false, or if anything cannot be written.
    """
    check_free(argument, folder, names, overwrite)

    # `begun` lists, from the inside out, all that is to go if the body raises or the process
    # is told to end: the scratch folder, folders that were made, and files moved into these.
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    begun = list(made)
    _unfinished[id(begun)] = begun
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(folder)
        mark = f"{_PREFIX}{platform.node()}-{os.getpid()}-"
        # In the folder itself: only within one file system is a move atomic.
        scratch = Path(tempfile.mkdtemp(prefix=mark, dir=folder))
        begun.insert(0, scratch)
        yield scratch

        # All are on the disk before the first gets its name, so that a full disk leaves none.
        for name in names:
            sync(scratch / name)
        for name in names:
            os.replace(scratch / name, folder / name)
            if made:  # a new folder goes with all that is in it
                begun.insert(0, folder / name)
        # All is well: only the empty scratch folder is left to remove.
        begun[:] = [scratch]
    except (OSError, CannotWrite, RuntimeError) as error:  # CannotWrite: of the scratch folder
        if isinstance(error, RuntimeError) and not str(error).startswith("NetCDF:"):
            raise  # netCDF4 reports a full disk, among others, as "NetCDF: ..."
        raise CannotWrite(argument, folder, error) from error
    finally:
        _remove(begun)
        del _unfinished[id(begun)]


def remove_unfinished() -> None:
    """Remove what this process has not finished writing, before it ends."""
    # A copy: calls in other threads may end meanwhile.
    for begun in list(_unfinished.values()):
        _remove(begun)


def _remove(paths: Sequence[Path]) -> None:
    """Remove files, scratch folders with their content, and other folders if empty."""
    for path in paths:
        for _ in range(5 if path.name.startswith(_PREFIX) else 0):
            _remove_tree(path)  # another thread may still write into it
        with contextlib.suppress(OSError):  # not empty, gone already, or not ours to remove
            path.rmdir() if path.is_dir() else path.unlink()


def _remove_tree(path: Path) -> None:
    """Remove a file, or a folder with its content, with one file descriptor at most."""
    if path.is_dir() and not path.is_symlink():
        with contextlib.suppress(OSError):
            for inner in path.iterdir():
                _remove_tree(inner)
        with contextlib.suppress(OSError):
            path.rmdir()
    else:
        path.unlink(missing_ok=True)


def _remove_abandoned(folder: Path) -> None:
    """Remove, with a warning, scratch folders of killed processes of this machine."""
    # On a shared file system the processes of other machines cannot be asked.
    for path in folder.glob(f"{_PREFIX}{platform.node()}-*-*"):
        number = path.name.split("-")[-2]
        if number.isdecimal() and not _is_alive(int(number)):
            _remove([path])
            how = "could not be removed" if path.exists() else "is now removed"
            warnings.warn(
                f"{str(path)!r}, left by a process that was killed, {how}", stacklevel=4
            )


def _is_alive(process: int) -> bool:
    """Tell whether a process of this machine runs, by its number."""
    # On Windows signal 0 is not a question. Scratch folders that are left there stay.
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # of another user
        return True
    return True
