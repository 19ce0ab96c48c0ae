"""Rocking spectra: responses of blocks of many sizes and shapes to ground motions."""

import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..driven import Batch, follow_batch, follow_within, require_complete
from ..grids import Chunks, Grid, Values, apply_padded, list_points
from ..ground_motion import Harmonic, Motion, Pulse, Record, Suite, describe_suite
from ..host import add_names
from ..overturning import check_single
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, as_real, check, check_kind
from .blocks import (
    VariableTable,
    describe_blocks,
    estimate_restitution,
    make_axes,
    make_variables,
    take_magnitudes,
)

if TYPE_CHECKING:
    import xarray

LARGEST = 2**14  # number of blocks that are simulated at once
# Type, long name and unit.
RESPONSES: VariableTable = {
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "peak_rotation": (float, "peak rotation", "rad"),
    "overturned": (np.int8, "1 where the block overturns", "1"),
    "margin": (float, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (int, "number of impacts", "1"),
}
_ESTIMATES: VariableTable = {
    "rtol": (float, "tolerance used for this block", "1"),
    "error": (float, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (np.int8, "1 where the error is within the tolerance", "1"),
}


def rocking_spectrum(  # noqa: PLR0913
    motion: Motion | Suite,
    free_period: Values,
    slenderness: Values,
    restitution: Values | None = None,
    *,
    gravity: float = 9.81,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    factor: Values | None = None,
    model: ModelLike = Nonlinear(),
    tolerance: float | None = None,
    chunks: Chunks | None = None,
) -> "xarray.Dataset":
    """Compute responses of blocks of many sizes and shapes to one or several ground motions.

    Parameters
    ----------
    motion : Motion or Suite
        A pulse, a `Harmonic` or a `Record`, the same for all blocks; or a `Suite`, each
        record of which acts on all blocks.
    free_period : array_like
        2 pi / p of the blocks [s], a number or one-dimensional. Here and below an array makes
        a dimension of the dataset, a number a scalar coordinate.
    slenderness : array_like
        lambda [-] of the blocks.
    restitution : array_like, optional
        C [-]. By default Housner's value for each block, which adds no dimension.
    gravity, inertia_ratio, one_sided : float, float, bool
        g [m/s2], kappa [-], and whether all blocks stand against a wall; see `Block`. For
        one-sided blocks the restitution is by default `one_sided_restitution`, and its axis
        has magnitudes.
    factor : array_like, optional
        Factors on the ground motion [-].
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    tolerance : float, optional
        Compute each block to this relative error of the peak rotation; see `respond_within`.
        The dataset then also has the variables rtol, error and within_tolerance. The last is
        0 where the response is so chaotic that no tolerance suffices.
    chunks : mapping of str to int or "auto", optional
        For a lazy dataset; see `resonance_spectrum`.

    Returns
    -------
    xarray.Dataset
        Has the dimensions or scalar coordinates (record,) free_period, slenderness
        (, restitution and factor), and the variables rotation_ratio, peak_rotation,
        overturned, margin and impacts at the end of the input.

    Raises
    ------
    ValueError
        If an argument is out of range, or an integration did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.rocking_spectrum(jr.Sine(4.0, 0.5), [2.0, 4.0], slenderness=5.0)
    >>> print(spectrum.overturned.values)
    [1 0]
    """
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    suite = motion if isinstance(motion, Suite) else None
    if not isinstance(motion, Suite):
        check_single(motion)
    model = as_model(model)
    block, attributes = describe_blocks(model.name, gravity, inertia_ratio, one_sided)
    first: Any = suite.records[0] if suite else motion
    attributes["motion"] = first.name
    if one_sided and restitution is not None:
        restitution = take_magnitudes(restitution)
    axes = make_axes(
        free_period=free_period,
        slenderness=slenderness,
        restitution=restitution,
        factor=factor,
    )
    table = RESPONSES
    if tolerance is not None:
        check("tolerance", as_real("tolerance", tolerance), POSITIVE)
        attributes["tolerance"] = tolerance
        table = RESPONSES | _ESTIMATES
    if suite is not None:
        attributes |= describe_suite(suite)
        axes = {"record": np.arange(len(suite)), **axes}
    dataset = Grid(
        "Rocking spectrum",
        axes,
        make_variables((*axes,), table),
        attributes,
        functools.partial(_simulate_part, (*axes,), model, tolerance),
        LARGEST,
        shared=(block, motion),
    ).build_dataset(chunks)
    if suite is None:
        return dataset
    return add_names(dataset, record=(suite.names, "ground motion"))


def _simulate_part(
    names: Sequence[str],
    model: RockingModel,
    tolerance: float | None,
    shared: tuple[Block, Motion | Suite],
    *coordinates: np.ndarray,
) -> dict[str, np.ndarray]:
    """Simulate blocks over a part of a grid with these coordinates along its axes."""
    block, motion = shared
    labels: dict[str, Any] = dict(zip(names, coordinates, strict=True))
    axes: Sequence[np.ndarray] = coordinates
    if isinstance(motion, Suite):
        # A chunk has neighbouring records, perhaps in one direction only. A slice of a suite
        # in both directions refuses that, so that a plain suite is made.
        records, *axes = coordinates
        chosen = slice(records[0], records[-1] + 1)
        motion = Suite(motion.records[chosen], motion.names[chosen])
        labels["record"] = motion.names
    _, points = list_points(*axes)
    at = dict(zip(names[-len(axes) :], points, strict=True))
    gravity = float(block.gravity)
    inertia_ratio = float(block.inertia_ratio)
    # p^2 = g / (kappa R), with kappa = I / (m R^2).
    half_diagonal = 1 / inertia_ratio * gravity * (at["free_period"] / (2 * math.pi)) ** 2
    half_width = half_diagonal / np.sqrt(1 + at["slenderness"] ** 2)
    blocks = Block(
        half_width, at["slenderness"], gravity, inertia_ratio, one_sided=block.one_sided
    )
    c = at.get("restitution")
    if c is None:
        c = apply_padded(estimate_restitution, blocks)
    # A suite needs a factor for each record, here the same for all.
    if "factor" in at:
        records = (len(motion),) if isinstance(motion, Suite) else ()
        motion = motion.scaled(np.broadcast_to(at["factor"], (*records, at["factor"].size)))
    batch = Batch.of(blocks, as_real("restitution", c, unit=""), motion)
    return compute_responses(batch, model, tolerance, labels)


def compute_responses(
    batch: Batch,
    model: RockingModel,
    tolerance: float | None,
    labels: Mapping[str, Any],
) -> dict[str, np.ndarray]:
    """Compute the variables of responses over a part of a grid with labelled axes."""
    if tolerance is None:
        response = estimate = follow_batch(batch, model)
    else:
        estimate = follow_within(batch, tolerance, model)
        response = estimate.response
    sizes = {name: np.size(along) for name, along in labels.items()}
    complete = np.reshape(response.complete, [*sizes.values()])
    require_complete(complete, **{name: np.atleast_1d(labels[name]) for name in sizes})
    # There is one angle for blocks of one shape, otherwise one for each point.
    angles = apply_padded(lambda block: block.critical_angle, batch.block)
    ratio = np.asarray(response.peak_rotation) / angles
    # The estimate has the tolerance and the error, the response all other variables.
    values = {"rotation_ratio": ratio, **vars(estimate), **vars(response)}
    shape = [sizes[name] for name, along in labels.items() if np.ndim(along)]
    names = RESPONSES if tolerance is None else RESPONSES | _ESTIMATES
    return {name: np.asarray(values[name]).reshape(shape) for name in names}
