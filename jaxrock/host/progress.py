"""Progress bars and clocks of computations that take long, on a terminal only."""

import contextlib
import contextvars
import sys
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

_Item = TypeVar("_Item")
_SILENT = 2.0  # seconds before a sign of life
# Held while a clock is shown. A lock and no context variable, since threads that work for the
# body have contexts of their own.
_showing = threading.Lock()
_silent = contextvars.ContextVar("_silent", default=False)


@contextlib.contextmanager
def hide_progress() -> Iterator[None]:
    """Show nothing inside: the whole shows its progress, and parts of it must not."""
    token = _silent.set(True)
    try:
        yield
    finally:
        _silent.reset(token)


def show_progress(items: Iterable[_Item], label: str) -> Iterable[_Item]:
    """Iterate over `items`, with a progress bar if it takes long and stderr is a terminal."""
    if _silent.get():
        return items
    from tqdm import tqdm

    return tqdm(items, desc=label, delay=_SILENT, disable=None, leave=False)


@contextlib.contextmanager
def show_clock(label: str) -> Iterator[None]:
    """Show the time taken by the body if it is long and stderr is a terminal.

    Of several nested clocks only the outermost is shown.
    """
    hidden = _silent.get() or not sys.stderr.isatty()
    if hidden or not _showing.acquire(blocking=False):
        yield
        return
    # A thread of its own: the body may be one call of a compiled program.
    done = threading.Event()
    thread = threading.Thread(target=_show_elapsed, args=(label, done), daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        _showing.release()


def _show_elapsed(label: str, done: threading.Event) -> None:
    """Show a clock once the silence is over, until `done`."""
    from tqdm import tqdm

    if not done.wait(_SILENT):
        with tqdm(desc=label, bar_format="{desc}: {elapsed}", leave=False) as clock:
            # It counts from the start of the body, not from its own.
            clock.start_t -= _SILENT
            while not done.wait(0.5):
                clock.refresh()
