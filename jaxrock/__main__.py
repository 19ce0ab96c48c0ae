"""``python -m jaxrock``."""

from .cli import main

main()
