"""The application: all commands, and how one of them is run.

A new command is a function in a file of this room and a line in `COMMANDS`.
"""

import contextlib
import functools
import gc
import os
import shlex
import sys
import warnings
from collections.abc import Sequence

import jax
from cyclopts import App, CycloptsError, Parameter

from .answers import Answer, show_message
from .compiled_programs import keep_compiled
from .measured import fit, validate
from .one_block import assess, critical, respond
from .options import COMMAND_LINE
from .research import harmonic, paper, rocking_spectrum, spectrum, tradeoff
from .sensitivity import driven_sensitivity, sensitivity
from .suites import fragility, inventory

# In the order in which help lists them, by panels. The name of a command is the one of its
# function, with dashes; its options are the parameters, its help is the docstring.
COMMANDS = {
    "Commands": (
        assess, respond, critical, fragility, inventory, rocking_spectrum, sensitivity,
        driven_sensitivity, fit, validate,
    ),
    "Research": (spectrum, harmonic, tradeoff, paper),
}  # fmt: skip


def make_application() -> App:
    """Make the parser of command lines, which knows all commands."""
    application = App(
        name="jaxrock",
        help="Rocking of rigid blocks: whether a block rocks, how far, and what overturns it.",
        # Without `negative`, a flag such as --force has no twin --no-force. Lists take all
        # words up to the next option, as in --width 0.4 0.8.
        default_parameter=Parameter(
            negative="", consume_multiple=True, show_default=_write_default
        ),
        help_format="markdown",
    )
    for group, commands in COMMANDS.items():
        for place, command in enumerate(commands):
            application.command(command, group=group, sort_key=place)
    application.register_install_completion_command()
    return application


def _write_default(value: object) -> str | None:
    """Write a default as it would be typed; None if there is none to be shown in help."""
    items = value if isinstance(value, tuple) else (value,)
    return " ".join(str(item) for item in items if item not in (None, False)) or None


def run_command(words: Sequence[str]) -> int:
    """Run the command of a command line, print its answer or the error; return the exit code."""
    # Commands answer in float64, whatever the default of the library is, and draw into files.
    jax.config.update("jax_enable_x64", True)
    os.environ["MPLBACKEND"] = "agg"
    # Tracing makes many objects, and few of them are garbage.
    gc.set_threshold(100_000, 20, 50)
    keep_compiled()
    try:
        with warnings.catch_warnings():
            # Without the path and the line of code; once, however often one is given.
            show = functools.cache(lambda message: show_message(f"warning: {message}"))
            warnings.showwarning = lambda message, *_, **__: show(str(message))
            answer = _compute_answer(words)
        if answer is None:
            return 0
        # Now, and not at the end of Python, where an error would be a traceback.
        print(answer, flush=True)
        return answer.code
    # What a user can do something about. All else is a fault of jaxrock, and shows its
    # traceback.
    except (ValueError, OSError, MemoryError, ModuleNotFoundError) as error:
        show_message(f"error: {error}")
        # Python would try again at its end to write what is left in the buffer.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2


def _compute_answer(words: Sequence[str]) -> Answer | None:
    """Return the answer of a command; None after help or the version, which are printed."""
    COMMAND_LINE.set(shlex.join(["jaxrock", *words]))
    try:
        command, given, _ = make_application().parse_args(
            words, print_error=False, exit_on_error=False
        )
    except CycloptsError as error:
        sentence = " ".join(str(error).split()).rstrip(",. ")
        raise ValueError(
            f"{sentence}; write numbers without units behind their options, as in --width 0.8;"
            " jaxrock COMMAND --help lists options and units"
        ) from None
    # Help and the version are functions of cyclopts, which print when they are called.
    answer = command(*given.args, **given.kwargs)
    return answer if isinstance(answer, Answer) else None
