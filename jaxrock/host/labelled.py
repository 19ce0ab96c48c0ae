"""Labelled datasets, such that files made of them follow the CF conventions."""

from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray

# The first version with whole numbers of 64 bits, which NumPy's are.
CONVENTIONS = "CF-1.9"

Labelled = tuple[Any, Any, Mapping[str, Any]]  # dimensions, values, attributes


def labelled(
    title: str,
    variables: Mapping[str, Labelled],
    coordinates: Mapping[str, Labelled],
    attributes: Mapping[str, Any],
) -> "xarray.Dataset":
    """A dataset with what CF asks for.

    Coordinates have no value that stands for a missing one. The attribute Conventions is left
    out where a coordinate goes up and down, which CF does not allow.
    """
    import xarray

    none_missing = {"_FillValue": None}
    placed = {name: (*described, none_missing) for name, described in coordinates.items()}
    found = xarray.Dataset(variables, placed)
    ways = [np.sign(np.diff(values)) for values in found.indexes.values()]
    if all(way.size == 0 or (way[0] and (way == way[0]).all()) for way in ways):
        found.attrs["Conventions"] = CONVENTIONS
    about = {"title": title, "source": f"jaxrock {version('jaxrock')}"}
    return found.assign_attrs({**about, **attributes})
