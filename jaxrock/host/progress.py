"""Signs of life of what takes longer than two seconds, on a terminal only."""

import contextlib
import contextvars
import sys
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

_Item = TypeVar("_Item")
_SILENT = 2.0  # seconds
_showing = threading.Lock()
_silent = contextvars.ContextVar("_silent", default=False)


@contextlib.contextmanager
def without_progress() -> Iterator[None]:
    """Show nothing inside: of a part of something that has a progress of its own."""
    token = _silent.set(True)
    try:
        yield
    finally:
        _silent.reset(token)


def with_progress(items: Iterable[_Item], label: str) -> Iterable[_Item]:
    """Iterate over `items`, with a progress bar if it takes long and stderr is a terminal."""
    if _silent.get():
        return items
    from tqdm import tqdm

    return tqdm(items, desc=label, delay=_SILENT, disable=None, leave=False)


@contextlib.contextmanager
def with_clock(label: str) -> Iterator[None]:
    """Show the time taken by the body if it is long and stderr is a terminal.

    Of several nested ones only the outermost does.
    """
    hidden = _silent.get() or not sys.stderr.isatty()
    if hidden or not _showing.acquire(blocking=False):
        yield
        return
    done = threading.Event()
    thread = threading.Thread(target=_show, args=(label, done), daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        _showing.release()


def _show(label: str, done: threading.Event) -> None:
    from tqdm import tqdm

    if not done.wait(_SILENT):
        with tqdm(desc=label, bar_format="{desc}: {elapsed}", leave=False) as clock:
            clock.start_t -= _SILENT
            while not done.wait(0.5):
                clock.refresh()
