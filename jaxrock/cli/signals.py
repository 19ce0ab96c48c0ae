"""Ctrl-C, SIGTERM and SIGHUP end a command with one line, and leave nothing half-written.

The handler ends the process itself: an exception can get lost under JAX, in a hook on the
garbage collector or in a callback. Python calls it between two of its own instructions, so
while XLA compiles or runs a program it has to wait.
"""

import contextlib
import logging
import multiprocessing
import os
import signal
from collections.abc import Iterator
from multiprocessing import resource_tracker
from types import FrameType

from ..host import remove_unfinished


def end_on_signals() -> None:
    """Let signals end this process, except those that it was started to ignore."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, _frame: FrameType | None) -> None:
    """Remove unfinished files, say why in one line, exit with 128 plus the number."""
    try:
        logging.disable()  # what Dask says of workers that are gone
        for worker in multiprocessing.active_children():
            worker.kill()
        remove_unfinished()
    finally:
        name = signal.Signals(number).name
        reason = "interrupted" if name == "SIGINT" else f"ended by {name}"
        start = "\n" if os.isatty(2) else ""  # after ^C or a clock
        with contextlib.suppress(OSError):  # standard error may be closed
            os.write(2, f"{start}jaxrock: {reason}\n".encode())
        os._exit(128 + number)


@contextlib.contextmanager
def started_deaf() -> Iterator[None]:
    """Start processes inside which never hear of Ctrl-C: a terminal sends it to them as well."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    # What multiprocessing has to start first: it would unblock signals. It removes semaphores
    # of processes that are killed, and is not to complain of them.
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore"
    try:
        resource_tracker.ensure_running()
    finally:
        del os.environ["PYTHONWARNINGS"]
        if before is not None:
            os.environ["PYTHONWARNINGS"] = before
    # Threads and processes that are started inside inherit it.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
