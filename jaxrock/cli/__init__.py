"""The command line; a command is a class: its options as fields, `check`, `run`."""

import signal
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command. A command that is not allowed or cannot be done ends with exit code 2.

    Without arguments it is the command of this process, which signals may end and which starts
    from what others have compiled. With them, Ctrl-C raises `SystemExit` with exit code 130.
    """
    if arguments is None and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # While JAX is imported, which takes a second, Ctrl-C ends the process without a word.
        # The handlers that end it with a line are installed only after that, in `run_main`.
        # One that was set by somebody else stays.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Imported here, so that the line above comes before everything that is slow.
    from .main_program import run_main

    run_main(arguments)
