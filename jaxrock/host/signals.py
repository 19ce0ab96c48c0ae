"""Ctrl-C, SIGTERM and SIGHUP end a command at once, with one line.

Python turns Ctrl-C into an exception in the main thread, wherever that is. Under JAX it gets lost:
in JAX's hook on the garbage collector it is printed and forgotten, in a callback it becomes
another error, and while a program is compiled or runs nothing is raised at all. So nothing is ever
raised here: a thread of its own waits for the signal, removes unfinished files and ends the
process.
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

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP
_heard: list[socket.socket] = []  # the pair through which signals arrive; empty before `watch`
_finished: list[int] = []  # the exit code, once it is known


def end(number: int) -> None:
    """Remove unfinished files, say in one line why, and exit with 128 plus the signal's number."""
    try:
        abandon()
    finally:
        name = signal.Signals(number).name
        reason = "interrupted" if name == "SIGINT" else f"ended by {name}"
        start = "\n" if os.isatty(2) else ""  # after ^C or a clock
        with contextlib.suppress(OSError):  # standard error may be closed
            os.write(2, f"{start}jaxrock: {reason}\n".encode())
        os._exit(128 + number)


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
    numbers = [getattr(signal, name) for name in _ENDING if hasattr(signal, name)]
    numbers = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
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
    while True:
        for number in ear.recv(64):  # of every signal that has a handler
            if number in numbers:
                end(number)


def _is_command() -> bool:
    """Whether this process is ``jaxrock`` or ``python -m jaxrock``, seen from an import."""
    program = sys.argv[0] if sys.argv else ""
    if program != "-m":
        return Path(program).stem == "jaxrock"
    arguments = sys.orig_argv
    return "-m" in arguments and arguments[arguments.index("-m") + 1 :][:1] == ["jaxrock"]


if _is_command():  # before the import of JAX, which takes a second
    watch()
