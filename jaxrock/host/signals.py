"""Ending when told to: Ctrl-C, SIGTERM and SIGHUP end a command at once, with one line.

Python turns Ctrl-C into an exception in the main thread, wherever that is. JAX calls Python
from C++: what is raised in its hook on the garbage collector is printed and forgotten, what is
raised in a callback becomes another error, and while a program is compiled or runs nothing is
raised at all. So here nothing is ever raised: a thread of its own hears of the signal, removes
what is not finished, and ends the process.
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
_heard: list[socket.socket] = []  # both ends of where signals are heard; empty until they are
_finished: list[int] = []  # the exit code, once it is known


def end(number: int) -> None:
    """End this process: remove what is not finished, say why in one line, exit as shells do.

    The exit code is 128 and the number of the signal.
    """
    try:
        abandon()
    finally:
        say("interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}")
        os._exit(128 + number)


def say(text: str) -> None:
    """A line on standard error, if that can be written to, from any thread."""
    start = "\n" if os.isatty(2) else ""  # after ^C or a clock
    with contextlib.suppress(OSError):
        os.write(2, f"{start}jaxrock: {text}\n".encode())


def watch() -> None:
    """From now on let signals end this process; those that it was started to ignore do not.

    Nothing happens outside of the main thread, or if there are too few file descriptors:
    Python's own ways stay.
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
    """Have this process end with an exit code once all that is to be done at exit is done.

    Without what Python and C++ would then still take apart, when nobody hears of signals.
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
    given = sys.orig_argv
    return given[given.index("-m") + 1 :][:1] == ["jaxrock"] if "-m" in given else False


if _is_command():  # before JAX and all else is imported, which takes a second
    watch()
