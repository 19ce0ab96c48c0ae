"""Suites that jaxrock finds by name."""

from .files import FEMA_SETS, example_suite, fema_p695_suite
from .suite import Suite


def find_suite(name: str, vertical: bool = False) -> Suite:
    """Find a suite by its name: ``"example"``, or ``"fema-"`` and a set of FEMA P695.

    Raises
    ------
    ValueError
        If there is no such suite, or none with a vertical component.
    """
    if name == "example":
        return example_suite(vertical=vertical)
    names = {f"fema-{record_set}": record_set for record_set in FEMA_SETS}
    if name not in names:
        raise ValueError(
            f"records must be a folder that exists, example, {', '.join(names)}, got {name!r}"
        )
    if vertical:
        raise ValueError(f"{name} has no vertical component")
    return fema_p695_suite(names[name])
