"""The command line; a command is a class: its options as fields, `check`, `run`."""

from .commands import COMMANDS
from .main_program import main
from .study import Run

__all__ = ["COMMANDS", "Run", "main"]
