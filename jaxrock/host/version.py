"""The version of jaxrock."""

import importlib.metadata


def read_version() -> str:
    """Return the version that is installed."""
    return importlib.metadata.version("jaxrock")
