"""The command line; each command is a file: its options as fields, `check`, `run`."""

from .application import main
from .commands import COMMANDS
from .study import Run

__all__ = ["COMMANDS", "Run", "main"]
