"""Signs of life of long computations: bars on a terminal, and lines from commands."""

import contextlib
import contextvars
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sized
from dataclasses import dataclass
from typing import TypeVar

_Item = TypeVar("_Item")
_SILENT = 2.0  # seconds before a sign of life
_EVERY = 30.0  # seconds from one line to the next, where there is no terminal
# Held while a clock is shown. A lock and no context variable, since threads that work for the
# body have contexts of their own.
_showing = threading.Lock()
_silent = contextvars.ContextVar("_silent", default=False)
# Events of JAX: the first comes before a program is made or looked up, the second after it.
_BEFORE = "/jax/compilation_cache/compile_requests_use_cache"
_AFTER = "/jax/core/compile/backend_compile_duration"


@dataclass(eq=False)
class _Loop:
    """A loop that goes on: what it does, and how far it is."""

    label: str
    total: int | None
    done: int = 0

    def __str__(self) -> str:
        of = "" if self.total is None else f" of {self.total}"
        return f"{self.label}: {self.done}{of}"


class _Doing:
    """The loops that go on, the outer ones first, and the programs that are compiled."""

    def __init__(self) -> None:
        self.loops: list[_Loop] = []
        self.compiling = False
        self.compiled = 0
        self.spoken = False  # whether there are lines where there is no terminal
        self.listening = False

    def __str__(self) -> str:
        # Threads may change the list meanwhile: a copy is looked at.
        parts = [str(loop) for loop in list(self.loops)]
        if self.compiling:
            parts.append(f"compiling program {self.compiled + 1}")
        return ", ".join(parts)


_doing = _Doing()


@contextlib.contextmanager
def hide_progress() -> Iterator[None]:
    """Show nothing inside: the whole shows its progress, and parts of it must not."""
    token = _silent.set(True)
    try:
        yield
    finally:
        _silent.reset(token)


@contextlib.contextmanager
def speak_of_waits() -> Iterator[None]:
    """Let clocks inside print a line now and then where stderr is no terminal, for commands.

    A library is silent there: whoever calls it decides what is printed.
    """
    _listen()
    before = _doing.spoken
    _doing.spoken = True
    try:
        yield
    finally:
        _doing.spoken = before


def announce(text: str) -> None:
    """Say how long something will take, in a line on stderr; only from commands."""
    if _doing.spoken and not _silent.get() and sys.stderr is not None:
        print(f"jaxrock: {text}", file=sys.stderr, flush=True)


def show_progress(items: Iterable[_Item], label: str) -> Iterable[_Item]:
    """Iterate over `items`, with a progress bar if it takes long and stderr is a terminal."""
    # In a process without stderr `print` would write to stdout, and tqdm would fail.
    if _silent.get() or sys.stderr is None:
        return items
    from tqdm import tqdm

    total = len(items) if isinstance(items, Sized) else None
    counted = _count(items, _Loop(label, total))
    return tqdm(counted, label, total, delay=_SILENT, disable=None, leave=False)


def _count(items: Iterable[_Item], loop: _Loop) -> Iterator[_Item]:
    """Iterate over items, so that a clock can say how many are done."""
    _doing.loops.append(loop)
    try:
        for item in items:
            yield item
            loop.done += 1
    finally:
        _doing.loops.remove(loop)


@contextlib.contextmanager
def show_clock(label: str) -> Iterator[None]:
    """Show the time taken by the body if it is long and stderr is a terminal.

    Of several nested clocks only the outermost is shown.
    """
    terminal = sys.stderr is not None and sys.stderr.isatty()
    hidden = _silent.get() or sys.stderr is None or not (terminal or _doing.spoken)
    if hidden or not _showing.acquire(blocking=False):
        yield
        return
    # A thread of its own: the body may be one call of a compiled program.
    done = threading.Event()
    show = _show_elapsed if terminal else _print_lines
    thread = threading.Thread(target=show, args=(label, done), daemon=True)
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
        form = "{desc}: {elapsed}{postfix}"
        with tqdm(desc=label, bar_format=form, leave=False) as clock:
            # It counts from the start of the body, not from its own.
            clock.start_t -= _SILENT
            while not done.wait(0.5):
                # Loops have bars of their own.
                clock.set_postfix_str("compiling" if _doing.compiling else "", refresh=False)
                clock.refresh()


def _print_lines(label: str, done: threading.Event) -> None:
    """Print a line now and then about what goes on, until `done`."""
    begin = time.monotonic()
    while not done.wait(_EVERY):
        seconds = time.monotonic() - begin
        said = str(_doing)
        # It may be closed or full: then there is nobody to be told.
        with contextlib.suppress(OSError, ValueError):
            words = f"{label}: {seconds:.0f} s" + (f", {said}" if said else "")
            print(words, file=sys.stderr, flush=True)


def _listen() -> None:
    """Note when JAX compiles; once in a process, since listeners cannot be taken back."""
    if _doing.listening:
        return
    import jax.monitoring

    _doing.listening = True
    jax.monitoring.register_event_listener(_note_before)
    jax.monitoring.register_event_duration_secs_listener(_note_after)


def _note_before(event: str, **_: object) -> None:
    """Note that a program is about to be compiled, or read from where it is kept."""
    if event == _BEFORE:
        _doing.compiling = True


def _note_after(event: str, duration_secs: float, **_: object) -> None:
    """Note that a program has been compiled or read."""
    if event == _AFTER:
        _doing.compiling = False
        _doing.compiled += 1
