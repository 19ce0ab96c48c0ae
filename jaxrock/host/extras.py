"""Modules of the package that need packages which not every user has installed."""

import importlib
from types import ModuleType


def import_optional(module: str, extra: str) -> ModuleType:
    """Import a module of the package; a `ModuleNotFoundError` says what to install."""
    package = __name__.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        # A module of this package that is missing is our own error.
        if str(error.name).startswith(package):
            raise
        missing = str(error.name).partition(".")[0]
        said = f"{missing} is not installed; pip install '{package}[{extra}]' brings it"
        raise ModuleNotFoundError(said, name=error.name) from error
