"""Which version of jaxrock this is."""

import importlib.metadata


def version() -> str:
    """The version that is installed."""
    return importlib.metadata.version("jaxrock")
