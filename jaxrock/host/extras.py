"""Packages that not every user has installed."""

import importlib
from types import ModuleType


def import_optional(module: str, extra: str) -> ModuleType:
    """Import a module; a `ModuleNotFoundError` says what to install."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        message = f"{error.name} is not installed; pip install 'jaxrock[{extra}]' brings it"
        raise ModuleNotFoundError(message, name=error.name) from None
