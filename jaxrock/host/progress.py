"""Progress of long loops: a bar on a terminal, elsewhere a log message when a loop ends.

The library logs to the logger ``jaxrock`` at level INFO, which shows nothing unless somebody
asks for it, as the command line does.
"""

import contextlib
import contextvars
import logging
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

_Item = TypeVar("_Item")
_SHORT = 2.0  # seconds before a bar is shown
_LONG = 5.0  # seconds; the end of a shorter loop is not worth a line
_logger = logging.getLogger("jaxrock")
_silent = contextvars.ContextVar("_silent", default=False)


@contextlib.contextmanager
def hide_progress() -> Iterator[None]:
    """Show nothing inside: the whole shows its progress, and parts of it should not."""
    token = _silent.set(True)
    try:
        yield
    finally:
        _silent.reset(token)


def show_progress(items: Iterable[_Item], label: str) -> Iterable[_Item]:
    """Iterate over `items`; show how far it is, or that it has ended, if it takes long."""
    if _silent.get():
        return items
    # A process may have been started without a standard error.
    if sys.stderr is not None and sys.stderr.isatty():
        from tqdm import tqdm

        return tqdm(items, label, delay=_SHORT, leave=False)
    return _log_end(items, label)


def _log_end(items: Iterable[_Item], label: str) -> Iterator[_Item]:
    """Iterate over items; log how long it took, if it was long."""
    start = time.monotonic()
    yield from items
    elapsed = time.monotonic() - start
    if elapsed > _LONG:
        announce(f"{label}: done in {elapsed:.0f} s")


def announce(text: str) -> None:
    """Log what takes long, or how long it will take."""
    _logger.info(text)
