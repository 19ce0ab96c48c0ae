"""Writing files whole or not at all."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path


@contextlib.contextmanager
def written_whole(folder: Path, names: Sequence[str], overwrite: bool) -> Iterator[Path]:
    """Let the body write the files `names` into a scratch folder, then move them to `folder`.

    A missing folder is made. If the body raises, nothing is left behind.

    Raises
    ------
    ValueError
        If a file exists and `overwrite` is false, or the folder cannot be written to.
    """
    existing = [name for name in names if (folder / name).exists()]
    if existing and not overwrite:
        raise ValueError(f"{folder / existing[0]} exists and overwriting it was not asked for")
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    scratch = None
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            scratch = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
        except OSError as error:
            reason = error.strerror or error
            raise ValueError(f"the folder {str(folder)!r} cannot be written to: {reason}") from None
        yield scratch
        for name in names:
            os.replace(scratch / name, folder / name)
        made = []
    finally:
        if scratch is not None:
            shutil.rmtree(scratch)
        for path in made:
            if path.exists():
                path.rmdir()
