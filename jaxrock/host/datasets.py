"""Labelled datasets that follow the CF conventions when they are written to files."""

import importlib.metadata
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray


def make_dataset(
    title: str,
    variables: Mapping[str, tuple],
    coordinates: Mapping[str, tuple],
    attributes: Mapping[str, object],
) -> "xarray.Dataset":
    """Make a dataset with the attributes that the CF conventions ask for.

    A variable or coordinate is a tuple of its dimensions, values and attributes.
    """
    import xarray

    # Coordinates have no missing values.
    described = {name: (*entry, {"_FillValue": None}) for name, entry in coordinates.items()}
    dataset = xarray.Dataset(variables, described)
    # CF does not allow coordinates that are not monotone: then it does not claim to follow it.
    indexes = dataset.indexes.values()
    if all(i.is_monotonic_increasing or i.is_monotonic_decreasing for i in indexes):
        dataset.attrs["Conventions"] = "CF-1.9"  # the first with NumPy's integers of 64 bits
    version = importlib.metadata.version("jaxrock")
    return dataset.assign_attrs(title=title, source=f"jaxrock {version}", **attributes)


def add_names(
    dataset: "xarray.Dataset", **names: tuple[Sequence[str], str]
) -> "xarray.Dataset":
    """Add names along dimensions: for each dimension the names, and a word for what they name.

    CF wants numbers along dimensions, so that the dataset no longer claims to follow it.
    """
    coordinates = {
        dimension: (dimension, [*values], {"long_name": long_name})
        for dimension, (values, long_name) in names.items()
    }
    named = dataset.assign_coords(coordinates)
    named.attrs.pop("Conventions", None)
    return named
