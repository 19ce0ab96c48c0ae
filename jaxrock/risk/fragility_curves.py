"""Fragility: shares of a suite that bring a block beyond limits, over the intensity."""

import functools
from collections.abc import Iterable, Mapping, Sequence
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
    AnyArray,
    Number,
    Numbers,
    as_name,
    as_real,
    as_text,
    check,
    check_kind,
)
from .exceedance import Threshold, add_curves, describe_variable
from .objects import Objects, draw_objects, gather_objects

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
    names: Sequence[str] | None = None,
    scatter: Mapping[str, float] | None = None,
    samples: int = 64,
    seed: int = 0,
) -> "xarray.Dataset":
    """Compute shares of a suite that bring blocks beyond thresholds, at levels of a measure.

    Parameters
    ----------
    block : Block
        One block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; one, or one for each block.
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
        Lengths along object, record, sample and level, for a lazy dataset; see
        `resonance_spectrum`.
    names : sequence of str, optional
        Names of the blocks; their numbers by default.
    scatter : mapping, optional
        Coefficients of variation of uncertain numbers by name, such as ``{"restitution":
        0.05}``: of the ``width`` at this height and the ``height`` at this width, or of the
        ``half_width`` at this slenderness and the ``slenderness``; of the ``inertia_ratio``
        and the ``restitution``. Distributions are those of `sensitivity.propagate`.
    samples, seed : int
        Number of samples of uncertain numbers, a power of 2, and the seed that they are drawn
        with. All records, levels and blocks share them.

    Returns
    -------
    xarray.Dataset
        Over level and threshold ``exceedance``, the share of records, with the exact
        (binomial) interval ``exceedance_low`` to ``exceedance_high``, and ``lognormal``, the
        most likely lognormal curve; both take the records for independent. Over threshold its
        ``lognormal_median`` and ``lognormal_dispersion``, and a ``remark``, which says where
        it does not fit: overturning is not monotone in the level. Over level
        ``share_within_tolerance``; elsewhere the response is chaotic. Over record and level
        every response, and the factor on the record. Many blocks add the dimension
        ``object``, in front.

        With `scatter` the responses have the dimension ``sample`` as well, and the shares are
        those of records and samples. The interval takes the records for independent, each
        with the share of its samples, so that it covers both kinds of scatter. Over threshold,
        ``dispersion_of_records`` and ``dispersion_of_parameters`` say how much of the
        dispersion is due to which: the root mean square dispersion of the curves of single
        samples, and the standard deviation of the logarithms of their medians.

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
    check_kind("suite", suite, Suite)
    objects = gather_objects(block, restitution, names)
    if any(np.shape(record.scale) for record in suite):
        raise ValueError("scales of records must be single ones, got arrays of them")
    places = _check_levels(levels)
    if not isinstance(confidence, float | int) or not 0 < confidence < 1:
        raise ValueError(
            f"confidence must be a number between 0 and 1, got {confidence!r:.60}"
        )
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    thresholds_named = name_thresholds(thresholds)
    model = as_model(model)
    measure = as_name("measure", measure, MEASURES)
    strengths = np.asarray(require_positive_measures(suite, measure, objects.block))
    drawn = objects if scatter is None else draw_objects(objects, scatter, samples, seed)
    # A record travels with its intensity, so that a chunk of some records has theirs; so does
    # an object with its number, its block and its restitution.
    axes = {
        "object": as_object_array(
            [(number, *drawn.select(number)) for number in range(objects.number)]
        ),
        "record": as_object_array(list(zip(suite, strengths, strict=True))),
        "sample": np.arange(1 if scatter is None else samples),
        "level": places,
    }
    labels = {"level": describe_variable(*MEASURES[measure][:2])}
    labels["sample"] = describe_variable("number of the sample of uncertain numbers")
    axis_names = {"record": (suite.names, "ground motion")}
    # One block has no axis of objects, and without scatter there is none of samples.
    dims = ["record", "level"]
    if scatter is not None:
        dims.insert(1, "sample")
    if objects.shape:
        dims.insert(0, "object")
        axis_names["object"] = (objects.names, "object")
    variables = {
        name: GridVariable(tuple(dims), dtype, describe_variable(long_name, units))
        for name, (dtype, long_name, units) in _RESPONSES.items()
    }
    attributes: dict[str, object] = {
        "model": model.name,
        **_describe_objects(objects),
        "measure": measure,
        "records": len(suite),
        "tolerance": tolerance,
        "confidence": confidence,
    }
    if scatter is not None:
        attributes |= {f"scatter_of_{name}": value for name, value in scatter.items()}
        attributes |= {"samples": samples, "seed": seed}
    axes = {name: values for name, values in axes.items() if name in dims}
    grid = Grid(
        "Fragility",
        axes,
        variables,
        attributes,
        functools.partial(_follow_scaled_records, tolerance, model, tuple(dims)),
        _LARGEST,
        _USUAL,
        names=axis_names,
        labels=labels,
        shared=None if objects.shape else (0, *drawn.select(0)),
    )
    return add_curves(
        grid.build_dataset(chunks),
        thresholds,
        thresholds_named,
        confidence,
        MEASURES[measure][1],
    )


def _check_levels(levels: Numbers) -> np.ndarray:
    """Return levels as an array; a `ValueError` if they are not allowed."""
    check("levels", as_real("levels", levels), POSITIVE)
    places = np.asarray(levels, float)
    if places.ndim != 1 or not places.size:
        raise ValueError(
            f"levels must be one-dimensional, got an array of shape {places.shape}"
        )
    if (np.diff(places) <= 0).any():
        raise ValueError("levels must be increasing, got values that do not increase")
    return places


def _describe_objects(objects: Objects) -> dict[str, object]:
    """Collect the numbers of the blocks as attributes: one, or one for each object."""
    numbers = {**vars(objects.block), "restitution": objects.restitution}
    return {
        name: np.asarray(values, float).tolist() if np.ndim(values) else float(values)
        for name, values in numbers.items()
    }


def _follow_scaled_records(
    tolerance: float,
    model: RockingModel,
    dims: tuple[str, ...],
    shared: tuple[int, Block, AnyArray | np.floating] | None,
    *parts: np.ndarray,
) -> dict[str, np.ndarray]:
    """Follow blocks under some records, which come with their intensities, at some levels."""
    at = dict(zip(dims, parts, strict=True))
    # A record and a level have an axis each; objects and samples have one where they are
    # dimensions. The axis of the records leads in a batch.
    of_objects = [shared] if shared is not None else list(at["object"])
    suite = Suite([record for record, _ in at["record"]])
    strengths = np.stack([strength for _, strength in at["record"]])
    if strengths.ndim > 1:
        strengths = strengths[:, [number for number, *_ in of_objects]]
    block, restitution = jax.tree.map(
        lambda *leaves: np.stack(leaves), *[(block, c) for _, block, c in of_objects]
    )
    if "sample" in at:
        block, restitution = jax.tree.map(
            lambda leaf: leaf[:, at["sample"]] if leaf.ndim > 1 else leaf[:, None],
            (block, restitution),
        )
    else:
        block, restitution = jax.tree.map(lambda leaf: leaf[:, None], (block, restitution))
    # Axes from here on: records, objects, samples, levels.
    levels = np.asarray(as_real("levels", at["level"]))
    strengths = strengths.reshape(len(suite), -1, 1, 1)
    factors = np.broadcast_to(
        levels / strengths, (len(suite), *restitution.shape, levels.size)
    )
    block, restitution = jax.tree.map(lambda leaf: leaf[..., None], (block, restitution))
    batch = Batch.of(block, restitution, suite).scaled(factors)
    estimate = follow_within(batch, tolerance, model)
    response = estimate.response
    if not np.asarray(response.complete).all():
        raise ValueError("motion could not be followed to its end for every record and level")
    ratio = np.asarray(response.peak_rotation) / np.asarray(block.critical_angle)
    values = {**vars(estimate), **vars(response), "factor": factors, "rotation_ratio": ratio}
    order = ("record", "object", "sample", "level")
    # Only the axes that are dimensions stay, in the order of the dimensions.
    single = tuple(k for k, name in enumerate(order) if name not in dims)
    kept = [name for name in order if name in dims]

    def arrange(entries: np.ndarray) -> np.ndarray:
        return np.transpose(entries.squeeze(single), [kept.index(name) for name in dims])

    return {name: arrange(np.asarray(values[name])) for name in _RESPONSES}


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
    threshold = as_text(threshold)
    if isinstance(threshold, str):
        if threshold not in _WORDS:
            must = f"thresholds must be rotation ratios, {' or '.join(map(repr, _WORDS))}"
            raise ValueError(f"{must}, got {threshold!r}")
        return threshold
    check("thresholds", as_real("thresholds", threshold), POSITIVE)
    return f"{float(threshold):g}"
