"""Progress of long work: a bar on a terminal, once it takes seconds."""

import contextlib
import contextvars
import logging
import sys
import threading
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from tqdm import tqdm

_Item = TypeVar("_Item")
_open_bar = contextvars.ContextVar["tqdm | None"]("_open_bar", default=None)


@contextlib.contextmanager
def count_work(label: str, amount: int | None = None) -> Iterator[tqdm]:
    """Let the body count what it has done by `update`, of an amount if that is known.

    A step inside of another one shows nothing. What it counts the other one counts, so that
    both have to count the same: motions that are simulated.
    """
    if (outer := _open_bar.get()) is not None:
        yield outer
        return
    with _make_bar(label, total=amount) as bar:
        token = _open_bar.set(bar)
        try:
            yield bar
        finally:
            _open_bar.reset(token)


def show_progress(items: Iterable[_Item], label: str) -> Iterable[_Item]:
    """Iterate over `items`, each of which counts as much as the others."""
    return items if _open_bar.get() is not None else _make_bar(label, iterable=items)


def _make_bar(label: str, **options: Any) -> tqdm:
    """Make a bar that shows itself where somebody may look, and only one at a time does."""
    # A process may have been started without a standard error. The tasks of Dask run in other
    # threads, where the bars of several would write over each other.
    is_seen = sys.stderr is not None and sys.stderr.isatty()
    is_seen &= threading.current_thread() is threading.main_thread()
    # What ends within two seconds needs no bar.
    return tqdm(desc=label, delay=2, leave=False, disable=not is_seen, **options)


def announce(text: str) -> None:
    """Log what takes long to the logger ``jaxrock``, which the command line shows."""
    logging.getLogger("jaxrock").info(text)
