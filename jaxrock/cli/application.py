"""The application: all commands, and how one of them is run.

A new command is a function in a file of this room and a line in `COMMANDS`.
"""

import contextlib
import functools
import gc
import logging
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import get_args

import jax
from cyclopts import App, CycloptsError, Parameter

from ..host import read_version
from .answers import Answer
from .assess import assess
from .compiled_programs import keep_compiled
from .critical import critical
from .fit import fit
from .fragility import fragility
from .harmonic import harmonic
from .inventory import inventory
from .options import GRID_HELP, Grid
from .paper import paper
from .respond import respond
from .sensitivity import sensitivity
from .spectra import rocking_spectrum, spectrum
from .tradeoff import tradeoff
from .validate import validate
from .wrong_calls import describe_wrong_call, name_options

# In the order in which help lists them, the first for newcomers. The name of a command is the
# one of its function, with dashes; its options are the parameters, its help is the docstring.
COMMANDS = (
    assess,
    spectrum,
    respond,
    rocking_spectrum,
    fragility,
    inventory,
    critical,
    sensitivity,
    harmonic,
    fit,
    validate,
    tradeoff,
    paper,
)


def make_application() -> App:
    """Make the parser of command lines, which knows all commands."""
    application = App(
        name="jaxrock",
        help="Rocking of rigid blocks: whether a block rocks, how far, and what overturns it.",
        version=read_version,
        # Without `negative`, a flag such as --force has no twin --no-force. Lists take all
        # words up to the next option, as in --width 0.4 0.8.
        default_parameter=Parameter(
            negative="", consume_multiple=True, show_default=_write_default
        ),
        help_format="markdown",
    )
    for place, command in enumerate(COMMANDS):
        kinds = command.__annotations__.values()
        takes_grid = any(Grid in (kind, *get_args(kind)) for kind in kinds)
        application.command(
            command, sort_key=place, help_epilogue=GRID_HELP if takes_grid else None
        )
    application.register_install_completion_command()
    return application


def _write_default(value: object) -> str | None:
    """Write a default as it would be typed; None if there is none to be shown in help."""
    if isinstance(value, tuple):
        return " ".join(str(_write_default(item)) for item in value) or None
    if isinstance(value, float):
        return f"{value:.6g}"
    return None if value is None or value is False else str(value)


def run_command(words: Sequence[str]) -> int:
    """Run the command of a command line, print its answer or the error; return the exit code."""
    # Commands answer in float64, whatever the default of the library is, and draw into files.
    jax.config.update("jax_enable_x64", True)
    os.environ["MPLBACKEND"] = "agg"
    gc.freeze()  # imported modules stay, and need not be looked through again
    # Tracing makes many objects, and few of them are garbage.
    gc.set_threshold(100_000, 20, 50)
    try:
        with _show_messages():
            answer = _compute_answer(words)
        return 0 if answer is None else _print_answer(answer)
    # What a user can do something about. All else is a fault of jaxrock, and shows its
    # traceback.
    except (ValueError, OSError, MemoryError, ModuleNotFoundError) as error:
        _complain(f"error: {error}")
        return 2


def _compute_answer(words: Sequence[str]) -> Answer | None:
    """Return the answer of a command; None after help or the version, which are printed."""
    if not words:
        raise ValueError("a command must be given; --help lists them")
    try:
        os.getcwd()
    except FileNotFoundError:
        # JAX asks for it, and its error does not say why.
        raise ValueError("the current folder is gone; change to one that exists") from None
    if "" in words[1:]:
        raise ValueError(f"{words[words.index('', 1) - 1]} must have a value, got ''")
    application = make_application()
    try:
        command, given, _ = application.parse_args(
            words, print_error=False, exit_on_error=False
        )
    except CycloptsError as error:
        raise ValueError(describe_wrong_call(error, words, application)) from None
    try:
        with keep_compiled():
            answer = command(*given.args, **given.kwargs)
    except ValueError as error:
        raise ValueError(name_options(str(error), application[words[0]])) from error
    # Help and the version are functions of cyclopts, which print when they are called.
    return answer if isinstance(answer, Answer) else None


def _print_answer(answer: Answer) -> int:
    """Print an answer; return its exit code, or another if nobody can read it."""
    try:
        # Now, and not at the end of Python, where an error would be a traceback.
        print(answer, flush=True)
    except OSError as error:
        # Python tries again at its end, with what is left in the buffer: that goes nowhere.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        # As in `jaxrock ... | head`: the reader has enough, which is no error. The exit code
        # is the one of a program that SIGPIPE ends, which Python ignores: 128 plus 13.
        if isinstance(error, BrokenPipeError):
            return 141
        raise ValueError(f"standard output cannot be written to: {error.strerror}") from error
    return answer.code


def _complain(text: str) -> None:
    """Print a line on standard error."""
    # It may be closed or full; the exit code says the same. Without a standard error `print`
    # would write to the standard output.
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            print(f"jaxrock: {text}", file=sys.stderr)


@contextlib.contextmanager
def _show_messages() -> Iterator[None]:
    """Print warnings and messages of the library inside, each as one line."""
    handler = logging.Handler()
    handler.emit = lambda record: _complain(record.getMessage())
    logger = logging.getLogger("jaxrock")
    level = logger.level
    show = functools.cache(lambda message: _complain(f"warning: {message}"))
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        with warnings.catch_warnings():
            # Without the path and the line of code; once, however often one is given.
            warnings.showwarning = lambda message, *_, **__: show(str(message))
            yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
