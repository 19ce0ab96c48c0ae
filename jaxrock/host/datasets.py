"""Labelled datasets that follow the CF conventions when they are written to files."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .version import read_version

if TYPE_CHECKING:
    import xarray

# Dimensions, values, attributes.
Labelled = tuple[str | Sequence[str], object, Mapping[str, object]]


def make_dataset(
    title: str,
    variables: Mapping[str, Labelled],
    coordinates: Mapping[str, Labelled],
    attributes: Mapping[str, object],
) -> "xarray.Dataset":
    """Make a dataset with the attributes that the CF conventions ask for."""
    import xarray

    no_fill_value = {"_FillValue": None}  # coordinates have no missing values
    described = {name: (*entry, no_fill_value) for name, entry in coordinates.items()}
    dataset = xarray.Dataset(variables, described)
    # CF does not allow coordinates that are not monotone: then it does not claim to follow it.
    signs = [np.sign(np.diff(values)) for values in dataset.indexes.values()]
    if all(sign.size == 0 or (sign[0] and (sign == sign[0]).all()) for sign in signs):
        dataset.attrs["Conventions"] = "CF-1.9"  # the first with NumPy's integers of 64 bits
    source = f"jaxrock {read_version()}"
    return dataset.assign_attrs({"title": title, "source": source, **attributes})


def add_names(
    dataset: "xarray.Dataset", **names: tuple[Sequence[str], str]
) -> "xarray.Dataset":
    """Add names along dimensions: for each dimension the names, and a word for what they name.

    CF wants numbers along dimensions, so that the dataset no longer claims to follow it.
    """
    coordinates = {
        dimension: (dimension, np.asarray(values, str), {"long_name": long_name})
        for dimension, (values, long_name) in names.items()
    }
    named = dataset.assign_coords(coordinates)
    named.attrs = {n: value for n, value in dataset.attrs.items() if n != "Conventions"}
    return named
