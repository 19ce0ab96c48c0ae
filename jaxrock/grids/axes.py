"""The axes and variables of grids: names, units, types, and the values that axes may have."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from typing_extensions import TypeAliasType

from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Domain,
    Number,
    as_real,
    carries_unit,
    check,
    check_concrete,
    convert_to_si,
)

if TYPE_CHECKING:
    import xarray

_Data = TypeVar("_Data", "xarray.DataArray", "xarray.Dataset")
Values = TypeAliasType("Values", Number | Sequence[float | int])

DataType = type | np.dtype | str  # of NumPy arrays


class GridVariable(NamedTuple):
    """A variable over a grid: its dimensions, the type of its numbers, its attributes."""

    dims: Sequence[str]
    dtype: DataType
    attributes: Mapping[str, object]


_AXES: dict[str, tuple[str, str, Domain]] = {  # long name, unit and domain
    "slenderness": ("slenderness, height over width", "1", POSITIVE),
    "width": ("full width 2b of the base", "m", POSITIVE),
    "restitution": ("coefficient of restitution, ratio of velocities", "1", UNIT_INTERVAL),
    "intensity": ("intensity of each pulse", "m s-1", NON_NEGATIVE),
    "factor": ("factor on the ground motion", "1", FINITE),
    "free_period": ("period 2 pi / p of the block", "s", POSITIVE),
    "frequency_ratio": ("frequency of the pulse over p", "1", POSITIVE),
    "amplitude_ratio": (
        "amplitude of the pulse over the one that just lifts the block",
        "1",
        NON_NEGATIVE,
    ),
    "frequency": ("frequency of the floor", "Hz", POSITIVE),
    "amplitude": ("amplitude of the floor", "m s-2", NON_NEGATIVE),
    "object": ("index of the object", "1", NON_NEGATIVE),
    "record": ("index of the record", "1", NON_NEGATIVE),
    "sample": ("index of the sample of uncertain parameters", "1", NON_NEGATIVE),
}


def as_axis(name: str, value: Values) -> np.ndarray:
    """Check the values along an axis: one or more, different, and all in its domain.

    A number stays one, without a dimension: it becomes a scalar coordinate of the dataset.
    """
    _, unit, domain = _AXES[name]
    check_concrete(value, f"{name} is an axis of a dataset")
    if carries_unit(value):
        value = convert_to_si(name, value, unit)
    # This only raises for anything but numbers. Its array has the precision of JAX; the axis
    # stays in float64, since coordinates are compared with the values that were asked for.
    as_real(name, value)
    values = np.asarray(value, dtype=float)
    if values.ndim > 1 or values.size == 0:
        raise ValueError(
            f"{name} must be a number or a one-dimensional array of at least one,"
            f" got an array of shape {values.shape}"
        )
    check(name, values, domain)
    # Asked for a value that it has twice, a dataset would give two points instead of one.
    distinct, counts = np.unique(values, return_counts=True)
    if distinct.size < values.size:
        raise ValueError(
            f"{name} must not have a value twice, got {distinct[counts > 1][0]:g}"
        )
    return values


def describe_axis(name: str) -> dict[str, str]:
    """Return the attributes of the coordinate along an axis."""
    long_name, units, _ = _AXES[name]
    return {"long_name": long_name, "units": units}


def expand_scalars(data: _Data, *names: str) -> _Data:
    """Make scalar coordinates dimensions of length 1: some axes have one value."""
    scalars = [name for name in names if name in data.coords and name not in data.dims]
    return data.expand_dims(scalars)
