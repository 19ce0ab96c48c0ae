"""Whether the site has an entry for every public name: ``python docs/check_names.py FOLDER``."""

import inspect
import sys
from pathlib import Path

from sphinx.util.inventory import InventoryFile

import jaxrock


def public_names():
    """Every name that jaxrock or one of its packages lists, by its first place."""
    described = {}
    for name in jaxrock.__all__:
        thing = getattr(jaxrock, name)
        if not inspect.ismodule(thing):
            described.setdefault(id(thing), f"jaxrock.{name}")
    for room in filter(inspect.ismodule, (getattr(jaxrock, name) for name in dir(jaxrock))):
        for name in getattr(room, "__all__", ()):
            if not inspect.ismodule(thing := getattr(room, name)):
                described.setdefault(id(thing), f"{room.__name__}.{name}")
    return set(described.values())


def main():
    """Name what is missing, and end with 1 if anything is."""
    content = Path(sys.argv[1], "objects.inv").read_bytes()
    inventory = InventoryFile.loads(content, uri="")
    there = {entry for kind in inventory.data.values() for entry in kind}
    missing = public_names() - there
    sys.exit(f"not in the reference: {', '.join(sorted(missing))}" if missing else 0)


if __name__ == "__main__":
    main()
