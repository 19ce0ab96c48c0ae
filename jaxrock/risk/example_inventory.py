"""The example of an inventory that comes with the library: a table of objects and a hazard."""

from importlib.resources import as_file, files
from pathlib import Path

from .hazard import Hazard
from .hazard_files import read_hazard
from .inventory import Inventory
from .inventory_files import read_inventory

# Names of the files as a user finds them.
EXAMPLE_FILES = ("objects.csv", "hazard.csv")
_DATA = files("jaxrock") / "data"


def read_example_inventory() -> tuple[Inventory, Hazard]:
    """Read the objects and the hazard of the example; both are made up."""
    with as_file(_DATA / "example_objects.csv") as path:
        inventory = read_inventory(path)
    with as_file(_DATA / "example_hazard.csv") as path:
        hazard = read_hazard(path)
    return inventory, hazard


def write_example_inventory(folder: Path) -> None:
    """Write the files of the example, for users to replace objects and hazard by theirs."""
    for name in EXAMPLE_FILES:
        (folder / name).write_bytes((_DATA / f"example_{name}").read_bytes())
