"""Fragility: shares of a suite that bring a block beyond limits, over the intensity."""

import functools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np

from ..block import Block
from ..driven import Batch, follow_within
from ..grids import DataType, Grid, GridVariable, as_object_array
from ..ground_motion import MEASURES, Suite, require_positive_measures
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    POSITIVE,
    UNIT_INTERVAL,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    check_kind,
)
from .exceedance import Threshold, add_curves, describe_variable

if TYPE_CHECKING:
    import xarray

    from ..grids import Chunks

_WORDS = ("uplift", "overturning")
_LARGEST = 2**14  # responses that are followed at once
_USUAL = 2**11  # responses in a chunk of a lazy dataset
# Type, long name and unit of the variables over record and level.
_RESPONSES: dict[str, tuple[DataType, str, str]] = {
    "factor": (float, "factor on the record", "1"),
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "peak_rotation": (float, "peak rotation", "rad"),
    "overturned": (np.int8, "1 where the block overturns", "1"),
    "margin": (float, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (int, "number of impacts", "1"),
    "error": (float, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (np.int8, "1 where that is within the tolerance", "1"),
}


def fragility(
    block: Block,
    restitution: Number,
    suite: Suite,
    levels: Numbers,
    measure: str = "pgv",
    thresholds: Sequence[Threshold] = ("uplift", 0.5, 1.0, "overturning"),
    *,
    tolerance: float = 1e-3,
    confidence: float = 0.95,
    model: ModelLike = Nonlinear(),
    chunks: "Chunks | None" = None,
) -> "xarray.Dataset":
    """Compute shares of a suite that bring a block beyond thresholds, at levels of a measure.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        C [-], between 0 and 1.
    suite : Suite
    levels : array_like, shape (n,)
        Increasing levels to which each record is scaled [unit of the measure].
    measure : str
        ``"pgv"``, ``"pga"``, ``"pgv_ratio"`` or ``"pga_ratio"``; see `intensity_measure`.
    thresholds : sequence of float or str
        Rotation ratios alpha_max / alpha_c [-], greater than 0, ``"uplift"``, which is any
        rotation, or ``"overturning"``, which is beyond every ratio as well.
    tolerance : float
        On peak rotations, relative; see `respond_within`.
    confidence : float
        Of the intervals, between 0 and 1.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    chunks : mapping of str to int or "auto", optional
        Lengths along record and level, for a lazy dataset; see `resonance_spectrum`.

    Returns
    -------
    xarray.Dataset
        Over level and threshold ``exceedance``, the share of records, with the exact
        (binomial) interval ``exceedance_low`` to ``exceedance_high``, and ``lognormal``, the
        most likely lognormal curve; both take the records for independent. Over threshold its
        ``lognormal_median`` and ``lognormal_dispersion``, and a ``remark``, which says where
        it does not fit: overturning is not monotone in the level. Over level
        ``share_within_tolerance``; elsewhere the response is chaotic. Over record and level
        every response, and the factor on the record.

    Raises
    ------
    ValueError
        If an argument is out of range, a record has no intensity, or a motion
        could not be followed.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, a, a, -a, -a, 0.0], 0.1) for a in (2.0, 3.0)])
    >>> curves = jr.fragility(jr.Block(0.1, 5.0), 0.8, suite, [0.2, 0.8])
    >>> print(curves.exceedance.sel(threshold="overturning").values)
    [0. 1.]
    """
    check_kind("block", block, Block)
    check_kind("suite", suite, Suite)
    restitution = as_real("restitution", restitution)
    if any(leaf.shape for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be single ones, got arrays of them")
    if any(np.shape(record.scale) for record in suite):
        raise ValueError("scales of records must be single ones, got arrays of them")
    check("levels", as_real("levels", levels), POSITIVE)
    places = np.asarray(levels, float)
    if places.ndim != 1 or not places.size:
        raise ValueError(
            f"levels must be one-dimensional, got an array of shape {places.shape}"
        )
    if (np.diff(places) <= 0).any():
        raise ValueError("levels must be increasing, got values that do not increase")
    if not isinstance(confidence, float | int) or not 0 < confidence < 1:
        raise ValueError(
            f"confidence must be a number between 0 and 1, got {confidence!r:.60}"
        )
    check("restitution", restitution, UNIT_INTERVAL)
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    names = name_thresholds(thresholds)
    model = as_model(model)
    strengths = np.asarray(require_positive_measures(suite, measure, block))
    # A record travels with its intensity, so that a chunk of some records has theirs.
    axes = {
        "record": as_object_array(list(zip(suite, strengths, strict=True))),
        "level": places,
    }
    variables = {
        name: GridVariable(("record", "level"), dtype, describe_variable(long_name, units))
        for name, (dtype, long_name, units) in _RESPONSES.items()
    }
    attributes = {
        "model": model.name,
        "half_width": float(block.half_width),
        "slenderness": float(block.slenderness),
        "gravity": float(block.gravity),
        "inertia_ratio": float(block.inertia_ratio),
        "restitution": float(restitution),
        "measure": measure,
        "records": len(suite),
        "tolerance": tolerance,
        "confidence": confidence,
    }
    grid = Grid(
        "Fragility",
        axes,
        variables,
        attributes,
        functools.partial(_follow_scaled_records, tolerance, model),
        _LARGEST,
        _USUAL,
        names={"record": (suite.names, "ground motion")},
        labels={"level": describe_variable(*MEASURES[measure][:2])},
        shared=(block, restitution),
    )
    return add_curves(
        grid.build_dataset(chunks), thresholds, names, confidence, MEASURES[measure][1]
    )


def _follow_scaled_records(
    tolerance: float,
    model: RockingModel,
    shared: tuple[Block, Reals],
    records: np.ndarray,
    levels: np.ndarray,
) -> dict[str, np.ndarray]:
    """Follow a block under some records, which come with their intensities, at some levels."""
    block, restitution = shared
    suite = Suite([record for record, _ in records])
    strengths = np.stack([strength for _, strength in records])
    factors = np.asarray(as_real("levels", levels))[None, :] / strengths[:, None]
    batch = Batch.of(block, restitution[None], suite).scaled(factors)
    estimate = follow_within(batch, tolerance, model)
    response = estimate.response
    if not np.asarray(response.complete).all():
        raise ValueError("motion could not be followed to its end for every record and level")
    ratio = np.asarray(response.peak_rotation) / np.asarray(block.critical_angle)
    values = {**vars(estimate), **vars(response), "factor": factors, "rotation_ratio": ratio}
    return {name: np.asarray(values[name]) for name in _RESPONSES}


def name_thresholds(thresholds: Sequence[Threshold]) -> list[str]:
    """Name the thresholds; a `ValueError` if they are not allowed."""
    if isinstance(thresholds, str) or not isinstance(thresholds, Iterable):
        raise ValueError(f"thresholds must be a list of them, got {thresholds!r:.60}")
    names = [_name_threshold(threshold) for threshold in thresholds]
    if not names or len(set(names)) < len(names):
        got = ", ".join(names) or "none"
        raise ValueError(f"thresholds must be at least one, each only once, got {got}")
    return names


def _name_threshold(threshold: Threshold) -> str:
    """Name a threshold; a `ValueError` if it is none."""
    if isinstance(threshold, str):
        if threshold not in _WORDS:
            must = f"thresholds must be rotation ratios, {' or '.join(map(repr, _WORDS))}"
            raise ValueError(f"{must}, got {threshold!r}")
        return threshold
    check("thresholds", as_real("thresholds", threshold), POSITIVE)
    return f"{float(threshold):g}"
