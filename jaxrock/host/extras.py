"""Packages that not every user has installed."""

import importlib.util
from pathlib import Path
from types import ModuleType


def import_optional(module: str, extra: str) -> ModuleType:
    """Import a module; a `ModuleNotFoundError` says what to install."""
    find_optional(module.partition(".")[0], extra)
    return importlib.import_module(module)


def find_optional(package: str, extra: str) -> Path:
    """Find the folder of a package without importing it; an error as `import_optional`."""
    specification = importlib.util.find_spec(package)
    if specification is None:
        message = f"{package} is not installed; pip install 'jaxrock[{extra}]' brings it"
        raise ModuleNotFoundError(message, name=package)
    return Path(str(specification.origin)).parent
