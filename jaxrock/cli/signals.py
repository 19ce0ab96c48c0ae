"""Ends of a command by Ctrl-C, SIGTERM and SIGHUP: with one line, and nothing half-written.

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
        # A command under nohup, or in the background of a shell, is started to ignore them.
        if number and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, _frame: FrameType | None) -> None:
    """Remove unfinished files, say why in one line, exit with 128 plus the number."""
    try:
        # Dask would report every worker that is gone, in many lines.
        logging.disable()
        # Killed and not asked to end: a worker in a compiled program would have to wait for
        # it.
        for worker in multiprocessing.active_children():
            worker.kill()
        # After the workers, which could write still.
        remove_unfinished()
    finally:
        name = signal.Signals(number).name
        reason = "interrupted" if name == "SIGINT" else f"ended by {name}"
        # A terminal shows ^C or a clock on the line where the cursor is.
        start = "\n" if os.isatty(2) else ""
        # By the file descriptor, since `sys.stderr` may be in the middle of a write: Python
        # would raise an error about entering it again. Standard error may be closed.
        with contextlib.suppress(OSError):
            os.write(2, f"{start}jaxrock: {reason}\n".encode())
        # Without what Python does at its end: waiting for threads of JAX and Dask can take
        # long, or for ever. 128 plus the number is what a shell reports of a process ended by
        # a signal.
        os._exit(128 + number)


@contextlib.contextmanager
def shield_from_interrupts() -> Iterator[None]:
    """Let processes that are started inside never hear of Ctrl-C.

    A terminal sends it to all processes of a command. Each worker would print a traceback of
    its own, while this process ends them anyway.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    # The resource tracker of multiprocessing has to be started before. When multiprocessing
    # starts it by itself, with the first worker, it unblocks signals of this process
    # afterwards. The tracker removes semaphores of processes that are killed; by the variable
    # it does not complain of them.
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore"
    try:
        resource_tracker.ensure_running()
    finally:
        del os.environ["PYTHONWARNINGS"]
        if before is not None:
            os.environ["PYTHONWARNINGS"] = before
    # Threads and processes that are started inside inherit the mask, and keep it.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        # One that came meanwhile was kept back, and is delivered now.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
