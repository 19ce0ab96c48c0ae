"""Showing that something goes on: from two seconds on, and only on a terminal."""

import contextlib
import sys
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

_Item = TypeVar("_Item")
_SILENT = 2.0  # seconds
_showing = threading.Lock()


def with_progress(items: Iterable[_Item], label: str) -> Iterable[_Item]:
    """`items`, showing how many are done if they take long and standard error is a terminal."""
    from tqdm import tqdm

    return tqdm(items, desc=label, delay=_SILENT, disable=None, leave=False)


@contextlib.contextmanager
def with_clock(label: str) -> Iterator[None]:
    """Show the time that the body has taken if it takes long and standard error is a terminal.

    Of several inside of each other only the outermost shows it.
    """
    if not sys.stderr.isatty() or not _showing.acquire(blocking=False):
        yield
        return
    done = threading.Event()

    def show() -> None:
        from tqdm import tqdm

        if done.wait(_SILENT):
            return
        with tqdm(desc=label, bar_format="{desc}: {elapsed}", leave=False) as clock:
            clock.start_t -= _SILENT
            while not done.wait(0.5):
                clock.refresh()

    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        _showing.release()
