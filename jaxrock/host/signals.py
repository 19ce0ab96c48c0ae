"""Ctrl-C, SIGTERM and SIGHUP end a command at once, with one line.

Python would raise an exception in the main thread. Under JAX it gets lost: in its hook on the
garbage collector it is printed and forgotten, in a callback it becomes another error, and while a
program is compiled or runs nothing is raised at all. So a thread of its own waits for signals.
"""

import atexit
import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from .files import abandon

_heard: list[socket.socket] = []  # the pair through which signals arrive; empty before `watch`
_finished: list[int] = []  # the exit code, once it is known


def watch() -> None:
    """From now on signals end this process, except those that it was started to ignore.

    Outside of the main thread, or with too few file descriptors, Python's handlers stay.
    """
    if _heard or threading.current_thread() is not threading.main_thread():
        return
    try:
        _heard.extend(socket.socketpair())
    except OSError:
        return
    ear, mouth = _heard
    mouth.setblocking(False)
    atexit.register(_leave)  # as the first, so that it comes last
    # Windows has no SIGHUP.
    numbers = [getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP")]
    numbers = [n for n in numbers if n and signal.getsignal(n) != signal.SIG_IGN]
    threading.Thread(target=_listen, args=(ear, numbers), daemon=True).start()
    signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
    for number in numbers:
        signal.signal(number, lambda *_: None)


def finish(code: int) -> None:
    """Let this process end right after its exit handlers, with an exit code.

    What Python and C++ would destroy after them is left alone: signals are not heard then.
    """
    _finished.append(code)


def _leave() -> None:
    if _finished:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, AttributeError):  # closed, or none
                stream.flush()
        os._exit(_finished[-1])


def _listen(ear: socket.socket, numbers: Sequence[int]) -> None:
    """Wait for a signal, remove unfinished files, say why in one line, exit with 128 plus it."""
    number = -1
    while number not in numbers:  # others have handlers of their own
        number = ear.recv(1)[0]
    try:
        abandon()
    finally:
        name = signal.Signals(number).name
        reason = "interrupted" if name == "SIGINT" else f"ended by {name}"
        start = "\n" if os.isatty(2) else ""  # after ^C or a clock
        with contextlib.suppress(OSError):  # standard error may be closed
            os.write(2, f"{start}jaxrock: {reason}\n".encode())
        os._exit(128 + number)


def _is_command() -> bool:
    """Whether this process is ``jaxrock`` or ``python -m jaxrock``, seen from an import."""
    if "--multiprocessing-fork" in sys.orig_argv:  # a worker of one, which has its name
        return False
    program, given = (sys.argv or [""])[0], [*sys.orig_argv, "-m", ""]
    if program != "-m":
        return Path(program).stem == "jaxrock"
    return given[given.index("-m") + 1] == "jaxrock"


if _is_command():  # before the import of JAX, which takes a second
    watch()
