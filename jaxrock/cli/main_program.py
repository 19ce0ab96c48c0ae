"""The command line: ``jaxrock assess``, ``spectrum``, ``respond``, and so on."""

import contextlib
import gc
import json
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax

from ..host import with_clock
from .arguments import make_parser, read_words
from .commands import COMMANDS
from .compilation_cache import cached
from .options import Command, read
from .signals import end_on_signals
from .storing import Storing
from .study import Run

_PARSER = make_parser({**COMMANDS, Run.command: Run})


def run_main(arguments: Sequence[str] | None) -> None:
    """Run `main`."""
    if arguments is None:
        end_on_signals()
        gc.freeze()  # what was imported stays
        # Tracing makes many objects, and few of them are garbage.
        gc.set_threshold(100_000, 20, 50)
    jax.config.update("jax_enable_x64", True)
    try:
        code = _run(arguments)
    except SystemExit as stop:  # after --help, or where there is no such command
        code = int(stop.code or 0)
    except KeyboardInterrupt:
        _complain("interrupted")
        code = 128 + signal.SIGINT
    except (ValueError, OSError, MemoryError, ModuleNotFoundError) as error:
        _complain(f"error: {error}")
        code = 2
    if code:
        raise SystemExit(code)


def _run(arguments: Sequence[str] | None) -> int:
    with _standard_output():
        command = read_words(_PARSER, sys.argv[1:] if arguments is None else arguments)
    keeps = arguments is None and not command.no_cache
    with _surroundings(), cached() if keeps else contextlib.nullcontext():
        _leave_lost_folder(command)
        read.cache_clear()  # files may have changed since the last command
        command.check()
        # Dask shows how far it is.
        shown = isinstance(command, Storing) and command.store is not None
        with contextlib.nullcontext() if shown else with_clock("jaxrock"):
            answer = command.run()
    with _standard_output():
        print(_json(answer.data) if command.as_json else answer.text)
    for error in answer.errors:
        _complain(f"error: {error}")
    return answer.code


def _complain(text: str) -> None:
    with contextlib.suppress(OSError):  # the exit code says it as well
        print(f"jaxrock: {text}", file=sys.stderr)


def _json(value: Any) -> str:
    # Python writes numbers that are not finite as constants that JSON does not have.
    finite = json.loads(json.dumps(value), parse_constant=lambda _: None)
    return json.dumps(finite, indent=2)


def _leave_lost_folder(command: Command) -> None:
    """Leave a current folder that is gone, whose path JAX asks for, unless an option needs it."""
    try:
        os.getcwd()
    except FileNotFoundError:
        for name, path in command.paths().items():
            if not Path(path).is_absolute():
                message = f"{name}: {path!s} starts at the current folder, which is gone"
                raise ValueError(message) from None
        os.chdir(os.sep)


@contextlib.contextmanager
def _surroundings() -> Iterator[None]:
    """Draw into files, whatever backend is asked for; print a warning as a line like an error."""
    backend = os.environ.get("MPLBACKEND")
    os.environ["MPLBACKEND"] = "agg"
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: _complain(f"warning: {message}")
            yield
    finally:
        del os.environ["MPLBACKEND"]
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


@contextlib.contextmanager
def _standard_output() -> Iterator[None]:
    """Write out everything that is printed inside, or raise an error that says why not."""
    try:
        try:
            yield
        finally:
            print(end="", flush=True)  # nothing where it was closed by who started this
    except OSError as error:
        with contextlib.suppress(OSError):  # Python tries again at its end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # as in `jaxrock ... | head`
            raise SystemExit(128 + signal.SIGPIPE) from None
        raise ValueError(f"standard output cannot be written to: {error.strerror}") from error
