"""Grids: their named axes, their division into chunks, and their labels."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..host import labelled
from ..validation import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain, Number, check

if TYPE_CHECKING:
    import xarray

Values = Number | Sequence[float | int]
Chunk = tuple[slice, ...]


class _Axis(NamedTuple):
    long_name: str
    units: str
    domain: Domain


_AXES = {
    "slenderness": _Axis("slenderness, height over width", "1", POSITIVE),
    "width": _Axis("full width 2b of the base", "m", POSITIVE),
    "restitution": _Axis("coefficient of restitution, ratio of velocities", "1", UNIT_INTERVAL),
    "intensity": _Axis("intensity of each pulse", "m s-1", NON_NEGATIVE),
    "period": _Axis("period 2 pi / p of the block", "s", POSITIVE),
    "frequency_ratio": _Axis("frequency of the pulse over p", "1", POSITIVE),
    "amplitude_ratio": _Axis(
        "amplitude of the pulse over what just lifts the block", "1", NON_NEGATIVE
    ),
}


def axis(name: str, value: Values) -> np.ndarray:
    """The values along an axis: one or more, different, and all in its domain."""
    try:
        values = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number or numbers, got {value!r}") from None
    if values.ndim > 1 or values.size == 0:
        raise ValueError(
            f"{name} must be a number or a one-dimensional array of at least one,"
            f" got an array of shape {values.shape}"
        )
    check(name, values, _AXES[name].domain)
    values = np.atleast_1d(values)
    distinct, counts = np.unique(values, return_counts=True)
    if distinct.size < values.size:
        raise ValueError(f"{name} must not have a value twice, got {distinct[counts > 1][0]:g}")
    return values


def label(name: str) -> dict[str, str]:
    """The attributes of what is named like an axis."""
    return {"long_name": _AXES[name].long_name, "units": _AXES[name].units}


def labelled_grid(
    title: str,
    axes: Mapping[str, np.ndarray],
    dims: Sequence[str],
    variables: Mapping[str, tuple[Any, Any, Mapping[str, Any]]],
    attributes: Mapping[str, Any],
) -> "xarray.Dataset":
    """A dataset; an axis that is no dimension becomes a scalar coordinate."""
    coordinates = {
        name: ((name,), values, label(name)) if name in dims else ((), values[0], label(name))
        for name, values in axes.items()
    }
    return labelled(title, variables, coordinates, attributes)


def chunks_of(sizes: Sequence[int], largest: int) -> Iterator[Chunk]:
    """Divide a grid into chunks of at most `largest` points, the first axes before the last."""
    lengths, left = [], largest
    for size in reversed(sizes):
        lengths.insert(0, min(size, max(left, 1)))
        left //= max(lengths[0], 1)
    starts = (range(0, size, length) for size, length in zip(sizes, lengths, strict=True))
    for corner in itertools.product(*starts):
        yield tuple(
            slice(start, min(start + length, size))
            for start, length, size in zip(corner, lengths, sizes, strict=True)
        )


def parts_of(axes: Mapping[str, np.ndarray], chunk: Chunk) -> list[np.ndarray]:
    """The values along each axis in a chunk."""
    return [values[part] for values, part in zip(axes.values(), chunk, strict=True)]
