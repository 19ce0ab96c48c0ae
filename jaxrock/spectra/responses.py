"""Responses at the points of a spectrum, as the batch computes them."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..driven import Batch, follow_batch, follow_within, require_complete
from ..grids import DataType, apply_padded
from ..resonance import RockingModel

LARGEST = 2**14  # blocks of a spectrum that are simulated at once
# Type, long name and unit.
RESPONSES: dict[str, tuple[DataType, str, str]] = {
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "peak_rotation": (float, "peak rotation", "rad"),
    "overturned": (np.int8, "1 where the block overturns", "1"),
    "margin": (float, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (int, "number of impacts", "1"),
}
ESTIMATES: dict[str, tuple[DataType, str, str]] = {
    "rtol": (float, "tolerance used for this block", "1"),
    "error": (float, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (np.int8, "1 where the error is within the tolerance", "1"),
}


def compute_responses(
    batch: Batch,
    model: RockingModel,
    tolerance: float | None,
    labels: Mapping[str, Sequence[str] | np.ndarray],
) -> dict[str, np.ndarray]:
    """Compute the variables of responses over a part of a grid, whose axes have labels."""
    if tolerance is None:
        response = estimate = follow_batch(batch, model)
    else:
        estimate = follow_within(batch, tolerance, model)
        response = estimate.response
    sizes = {name: np.size(along) for name, along in labels.items()}
    complete = np.reshape(response.complete, [*sizes.values()])
    require_complete(complete, **{name: np.atleast_1d(labels[name]) for name in sizes})
    # One value for blocks of one shape, else one for each point.
    angles = apply_padded(lambda block: block.critical_angle, batch.block)
    ratio = np.asarray(response.peak_rotation) / angles
    # The estimate has what it says of itself, and the response within it all else.
    values = {"rotation_ratio": ratio, **vars(estimate), **vars(response)}
    shape = [sizes[name] for name, along in labels.items() if np.ndim(along)]
    names = RESPONSES if tolerance is None else RESPONSES | ESTIMATES
    return {name: np.asarray(values[name]).reshape(shape) for name in names}
