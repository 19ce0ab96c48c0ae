"""The main program: reads a command line, runs its command, prints the answer or the error."""

import contextlib
import gc
import json
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax

from ..host import show_clock, speak_of_waits
from .arguments import make_parser, read_words
from .command import Command
from .commands import COMMANDS
from .compilation_cache import keep_compiled
from .options import read_motion
from .signals import end_on_signals
from .storing import Storing
from .study import Run

_PARSER = make_parser({**COMMANDS, Run.command: Run})


def run_main(arguments: Sequence[str] | None) -> None:
    """Run a command; end with the exit code of its answer, 2 for errors, 130 for Ctrl-C."""
    # Signals and the garbage collector belong to the process: not to be touched for a caller.
    if arguments is None:
        end_on_signals()
        gc.freeze()  # imported modules stay, and need not be looked through again
        # Tracing makes many objects, and few of them are garbage.
        gc.set_threshold(100_000, 20, 50)
    # Commands answer in float64, whatever the default of the library is.
    jax.config.update("jax_enable_x64", True)
    try:
        code = _run(arguments)
    except SystemExit as stop:  # after --help, or where there is no such command
        code = int(stop.code or 0)
    except KeyboardInterrupt:
        # Called with arguments, where no handler of `end_on_signals` is in its place.
        _complain("interrupted")
        code = 128 + signal.SIGINT
    # What a user can do something about. All else is a fault of jaxrock, and shows its
    # traceback.
    except (ValueError, OSError, MemoryError, ModuleNotFoundError) as error:
        _complain(f"error: {error}")
        code = 2
    if code:
        raise SystemExit(code)


def _run(arguments: Sequence[str] | None) -> int:
    """Read the words, check and run the command, print its answer, return the exit code."""
    # Help is printed while the words are read.
    with _flush_standard_output():
        command = read_words(_PARSER, sys.argv[1:] if arguments is None else arguments)
    # Where the compiled programs are kept is a setting of the process, too.
    keeps = arguments is None and not command.no_cache
    with _prepare_surroundings(), keep_compiled() if keeps else contextlib.nullcontext():
        _leave_lost_folder(command)
        # In a process that runs several commands, files may have changed since the last one.
        read_motion.cache_clear()
        command.check()
        # A store has the progress bar of Dask, into which a clock would write.
        shown = isinstance(command, Storing) and command.store is not None
        clock = contextlib.nullcontext() if shown else show_clock(f"jaxrock {command.command}")
        with speak_of_waits(), clock:
            answer = command.run()
    # After all files are in their places: if nobody takes the answer, they are there.
    with _flush_standard_output():
        print(_write_json(answer.data) if command.as_json else answer.text)
    for error in answer.errors:
        _complain(f"error: {error}")
    return answer.code


def _complain(text: str) -> None:
    """Print a line on standard error."""
    # It may be closed or full; the exit code says the same.
    with contextlib.suppress(OSError):
        print(f"jaxrock: {text}", file=sys.stderr)


def _write_json(value: object) -> str:
    """Write an answer as JSON, with null for numbers that are not finite."""
    # Python writes NaN and Infinity for them, which JSON does not have and other parsers
    # refuse.
    finite = json.loads(json.dumps(value), parse_constant=lambda _: None)
    return json.dumps(finite, indent=2)


def _leave_lost_folder(command: Command) -> None:
    """Leave a current folder that is gone, unless an option needs it.

    JAX asks for the path of the current folder. Without one it fails with an error that says
    nothing to a user.
    """
    try:
        os.getcwd()
    except FileNotFoundError:
        for name, path in command.find_paths().items():
            if not Path(path).is_absolute():
                message = f"{name}: {path!s} starts at the current folder, which is gone"
                raise ValueError(message) from None
        os.chdir(os.sep)  # which is always there


@contextlib.contextmanager
def _prepare_surroundings() -> Iterator[None]:
    """Draw into files, whatever backend is asked for, and print a warning as one line."""
    # MPLBACKEND may name a backend that needs a screen, or one that is not installed here. It
    # is set before matplotlib is imported, which reads it then.
    backend = os.environ.get("MPLBACKEND")
    os.environ["MPLBACKEND"] = "agg"
    try:
        # Without the path and the line of code, with which a user can do nothing; and once,
        # however often something is asked for.
        said = set[str]()

        def show_once(message: Warning | str, *_: object, **__: object) -> None:
            """Print a warning that was not printed before."""
            if str(message) not in said:
                said.add(str(message))
                _complain(f"warning: {message}")

        with warnings.catch_warnings():
            warnings.showwarning = show_once
            yield
    finally:
        del os.environ["MPLBACKEND"]
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


@contextlib.contextmanager
def _flush_standard_output() -> Iterator[None]:
    """Write out everything that is printed inside, or raise an error that says why not.

    Python writes when a buffer is full or at its end, where an error would be a traceback and
    the exit code 120. Here all is written before the exit code is known.
    """
    try:
        try:
            yield
        finally:
            # Not `sys.stdout.flush()`: where the process was started without a standard output
            # `sys.stdout` is None, and `print` does nothing.
            print(end="", flush=True)
    except OSError as error:
        # Python tries again at its end, with what is left in the buffer: that goes nowhere.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        # As in `jaxrock ... | head`: the reader has enough, which is no error. The exit code
        # is the one of a program that SIGPIPE ends; Python ignores that signal.
        if isinstance(error, BrokenPipeError):
            raise SystemExit(128 + signal.SIGPIPE) from None
        raise ValueError(f"standard output cannot be written to: {error.strerror}") from error
