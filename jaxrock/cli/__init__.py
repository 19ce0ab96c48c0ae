"""The command line: a command is a function, its parameters are the options."""

import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; by default the one of this process.

    Raises
    ------
    SystemExit
        With 2 if the command is refused or fails, 130 after Ctrl-C, 141 if the reader of its
        output has gone, and with the code of its answer if that is not 0.
    """
    handler = signal.getsignal(signal.SIGINT)
    if arguments is None and handler is signal.default_int_handler:
        # While JAX is imported, which takes a second, Ctrl-C ends the process at once: raised
        # amid its libraries, an exception is told in many lines.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .application import run_command

    try:
        if arguments is None:
            signal.signal(signal.SIGINT, handler)
        code = run_command(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        print("jaxrock: interrupted", file=sys.stderr)
        code = 128 + signal.SIGINT
    if code:
        raise SystemExit(code)
