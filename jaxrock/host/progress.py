"""Progress of long work: a bar with a percentage on a terminal, elsewhere log messages.

The library logs to the logger ``jaxrock`` at level INFO, which shows nothing unless somebody
asks for it, as the command line does.
"""

import contextlib
import contextvars
import logging
import sys
import threading
import time
from collections.abc import Collection, Iterable, Iterator
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from tqdm import tqdm

_Item = TypeVar("_Item")
_SHORT = 2.0  # seconds before a bar is shown
_MOMENT = 0.1  # seconds between two looks at how far a step is
_LONG = 5.0  # seconds; the end of a shorter step is not worth a line
_BETWEEN = 10.0  # seconds between lines that say how far a step is, at least
_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}"
_logger = logging.getLogger("jaxrock")
_open = contextvars.ContextVar["Work | None"]("_open", default=None)
_name = contextvars.ContextVar("_name", default="")


class Work:
    """A step of known length, some of which is done.

    Threads may advance it together. A part of an `outer` step shows nothing itself.
    """

    def __init__(self, label: str, amount: float | int, outer: "Work | None" = None):
        self._label = _name.get() + label
        self._outer = outer
        self._fraction = 0.0
        self._start = time.monotonic()
        self._next = self._start + _SHORT
        self._logged = self._start
        self._percent = 0
        self._bar: tqdm | None = None
        self._lock = threading.Lock()
        self.expect(amount)

    def expect(self, amount: float | int) -> None:
        """Correct how much is still to be done; what is done stays the same fraction."""
        self._step = (1 - self._fraction) / max(amount, 1)

    def advance(self, amount: float | int = 1) -> None:
        """Count an amount as done, and show how far the step is if it takes long."""
        if self._outer is not None:
            self._outer.advance(amount)
            return
        with self._lock:
            self._fraction = min(self._fraction + amount * self._step, 1.0)
            now = time.monotonic()
            # What ends without having been shown needs no bar.
            if now < self._next or (self._bar is None and self._fraction == 1):
                return
            self._next = now + _MOMENT
            # A process may have been started without a standard error.
            if sys.stderr is not None and sys.stderr.isatty():
                self._show_bar(now)
            elif now - self._logged >= _BETWEEN and int(100 * self._fraction) > self._percent:
                self._logged = now
                self._percent = int(100 * self._fraction)
                announce(f"{self._label}: {self._percent} % after {now - self._start:.0f} s")

    def _show_bar(self, now: float) -> None:
        """Show a bar, or move it on."""
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(
                desc=self._label,
                total=100,
                bar_format=_FORMAT,
                leave=False,
                smoothing=0,
                mininterval=0,
                miniters=0,
            )
            self._bar.start_t -= now - self._start
        self._bar.update(100 * self._fraction - self._bar.n)

    def close(self, complete: bool) -> None:
        """Take the bar away; log how long the step took, if it was long and is complete."""
        elapsed = time.monotonic() - self._start
        if self._bar is not None:
            self._bar.close()
        elif complete and elapsed > _LONG:
            announce(f"{self._label}: done in {elapsed:.0f} s")


class _Silent(Work):
    """A step whose progress nobody sees."""

    def advance(self, amount: float | int = 1) -> None:
        """Show nothing."""


@contextlib.contextmanager
def hide_progress() -> Iterator[None]:
    """Show nothing inside: the whole shows its progress, and parts of it should not."""
    token = _open.set(_Silent("", 1))
    try:
        yield
    finally:
        _open.reset(token)


@contextlib.contextmanager
def name_work(name: str) -> Iterator[None]:
    """Put a name in front of the labels of the steps inside."""
    token = _name.set(f"{_name.get()}{name}, ")
    try:
        yield
    finally:
        _name.reset(token)


@contextlib.contextmanager
def count_work(label: str, amount: float | int) -> Iterator[Work]:
    """Show how much of a step is done, if it takes long.

    A step inside of another one shows nothing. What advances it advances the other one, so
    that both have to count the same: motions that are simulated.
    """
    outer = _open.get()
    if outer is not None:
        yield Work(label, amount, outer)
        return
    work = Work(label, amount)
    token = _open.set(work)
    complete = False
    try:
        yield work
        complete = True
    finally:
        _open.reset(token)
        work.close(complete)


def show_progress(items: Collection[_Item], label: str) -> Iterable[_Item]:
    """Iterate over `items`; show how far it is, or that it has ended, if it takes long."""
    # One item is done or not; what it consists of may have a progress.
    if _open.get() is not None or len(items) < 2:
        return items
    return _count_items(items, label)


def _count_items(items: Collection[_Item], label: str) -> Iterator[_Item]:
    """Iterate over items, each of which counts as much as the others."""
    work = Work(label, len(items))
    complete = False
    try:
        for item in items:
            yield item
            work.advance()
        complete = True
    finally:
        work.close(complete)


def announce(text: str) -> None:
    """Log what takes long, or how long it will take."""
    _logger.info(text)
