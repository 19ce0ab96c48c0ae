"""Packages that not every user has installed, and modules of ours that need them."""

import importlib
import importlib.util
from pathlib import Path
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
        raise _make_error(str(error.name).partition(".")[0], extra) from error


def find_optional(package: str, extra: str) -> Path:
    """Find the folder of a package without importing it, for the data in it.

    A `ModuleNotFoundError` says what to install.
    """
    specification = importlib.util.find_spec(package)
    if specification is None or not specification.submodule_search_locations:
        raise _make_error(package, extra)
    return Path(specification.submodule_search_locations[0])


def _make_error(missing: str, extra: str) -> ModuleNotFoundError:
    """Make the error of a package that is not installed."""
    package = __name__.partition(".")[0]
    message = f"{missing} is not installed; pip install '{package}[{extra}]' brings it"
    return ModuleNotFoundError(message, name=missing)
