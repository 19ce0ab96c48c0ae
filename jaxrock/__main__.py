"""Run the commands, as ``python -m jaxrock``."""

from .cli import main

main()
