"""The command line: a command is a function, its parameters are the options."""

import os
import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; by default the one of this process, which signals end.

    Raises
    ------
    SystemExit
        With 2 if the command is refused or fails, 141 if the reader of its output has gone, and
        with the code of its answer if that is not 0. Ctrl-C ends the process with 130, SIGTERM
        with 143.
    """
    signals = [] if arguments is not None else [signal.SIGINT, signal.SIGTERM]
    # A process in the background of a shell does not hear Ctrl-C, and goes on.
    heard = [number for number in signals if signal.getsignal(number) != signal.SIG_IGN]
    for number in heard:
        # While JAX is imported, which takes a second, no file is open.
        signal.signal(number, lambda came, _: os._exit(128 + came))
    from ..host import end_process
    from .application import run_command

    for number in heard:
        signal.signal(number, end_process)
    code = run_command(sys.argv[1:] if arguments is None else arguments)
    if code:
        raise SystemExit(code)
