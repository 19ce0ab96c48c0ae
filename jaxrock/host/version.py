"""Which version of jaxrock this is."""

import importlib.metadata


def version() -> str:
    """Return the version that is installed."""
    return importlib.metadata.version("jaxrock")
