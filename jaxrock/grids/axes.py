"""The axes and variables of grids: names, units, types, and the values that axes may have."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from typing_extensions import TypeAliasType

from ..tables import QUANTITIES, UNITS
from ..validation import Number, as_real, check, check_concrete

if TYPE_CHECKING:
    import xarray

_Data = TypeVar("_Data", "xarray.DataArray", "xarray.Dataset")
Values = TypeAliasType("Values", Number | Sequence[float | int])
Chunks = TypeAliasType("Chunks", Mapping[str, int | Sequence[int]] | str)

DataType = type | np.dtype | str  # type of NumPy arrays


class GridVariable(NamedTuple):
    """A variable over a grid: its dimensions, the type of its numbers, its attributes."""

    dims: Sequence[str]
    dtype: DataType
    attributes: Mapping[str, object]


def as_axis(name: str, value: Values) -> np.ndarray:
    """Check the values along an axis: one or more, different, and all in its domain.

    A number stays one, without a dimension: it becomes a scalar coordinate of the dataset.
    """
    quantity = QUANTITIES[name]
    check_concrete(value, f"{name} is an axis of a dataset")
    # This only raises for anything but numbers. Its array has the precision of JAX; the axis
    # stays in float64, since coordinates are compared with the values that were asked for.
    as_real(name, value, unit=UNITS[name].removeprefix("-"))
    values = np.asarray(value, dtype=float)
    if values.ndim > 1 or values.size == 0:
        raise ValueError(
            f"{name} must be a number or a one-dimensional array of at least one,"
            f" got an array of shape {values.shape}"
        )
    check(name, values, quantity.domain)
    # If an axis had a value twice, selecting it would give two points instead of one.
    distinct, counts = np.unique(values, return_counts=True)
    if distinct.size < values.size:
        raise ValueError(
            f"{name} must not have a value twice, got {distinct[counts > 1][0]:g}"
        )
    return values


def describe_axis(name: str) -> dict[str, str]:
    """Return the attributes of the coordinate along an axis."""
    return {"long_name": QUANTITIES[name].words, "units": QUANTITIES[name].unit}


def expand_scalars(data: _Data, *names: str) -> _Data:
    """Make scalar coordinates dimensions of length 1: some axes have one value."""
    scalars = [name for name in names if name in data.coords and name not in data.dims]
    return data.expand_dims(scalars)
