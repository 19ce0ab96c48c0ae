"""Writing files whole or not at all."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path


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

    A missing folder is made. If the body raises, nothing is left behind.

    Raises
    ------
    ValueError
        Naming the `argument` that said where to write: if a file exists and `overwrite` is
        false, or if anything cannot be written.
    """
    check_free(argument, folder, names, overwrite)
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    scratch, moved = None, []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
        yield scratch
        for name in names:
            os.replace(scratch / name, folder / name)
            moved.append(folder / name)
        made = []
    except OSError as error:
        raise CannotWrite(argument, folder, error.strerror or error) from error
    except CannotWrite as error:  # from the body, which writes into the scratch folder
        raise CannotWrite(argument, folder, error.reason) from error
    finally:
        if scratch is not None:
            shutil.rmtree(scratch)
        for path in moved if made else []:  # in a folder that was not there before
            path.unlink()
        for path in made:
            if path.exists():
                path.rmdir()
