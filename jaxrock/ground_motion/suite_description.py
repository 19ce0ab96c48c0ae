"""The attributes that a suite gives a dataset."""

from .suite import Suite


def describe_suite(suite: Suite) -> dict[str, int | str]:
    """Make the attributes of a dataset about the source of the records, directions and floor."""
    described: dict[str, int | str] = {}
    if suite.source:
        described["record_source"] = suite.source
    if suite.directions != 1:
        described["directions"] = suite.directions
    if suite.ground is not None:
        described["floor"] = "given by records" if suite.floor is None else str(suite.floor)
    return described
