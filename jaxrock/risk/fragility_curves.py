"""Fragility: probabilities of exceeding thresholds under a suite, over the intensity."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
import numpy.typing as npt

from ..block import Block, size_of
from ..driven import (
    Batch,
    BatchResponse,
    Labels,
    follow_batch,
    follow_within,
    require_complete,
)
from ..grids import DataType, Grid, GridVariable, apply_padded
from ..ground_motion import MEASURES, Suite, describe_suite, require_positive_measures
from ..host import add_names
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..sensitivity import Uncertain
from ..validation import (
    POSITIVE,
    AnyArray,
    Number,
    Numbers,
    as_name,
    as_real,
    check,
    check_increasing,
    check_kind,
)
from .boundary_sums import find_uplift_levels, sum_boundaries
from .exceedance import (
    NAMED_THRESHOLDS,
    Threshold,
    add_curves,
    describe_variable,
    name_thresholds,
)
from .floor_samples import vary_motions
from .lognormal import sum_powers
from .objects import Objects, gather_objects
from .site import require_single_scales

if TYPE_CHECKING:
    import xarray

    from ..grids import Chunks

_LARGEST = 2**14  # responses that are simulated at once
_USUAL = 2**11  # responses in a chunk of a lazy dataset
_SUMS = "sums of ln(level)^k where exceedance begins, minus where it ends, for k = 0, 1, 2"
# Type, long name and unit of the variables over record and level.
_RESPONSES: dict[str, tuple[DataType, str, str]] = {
    "factor": (float, "factor on the record", "1"),
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "peak_rotation": (float, "peak rotation", "rad"),
    "overturned": (np.int8, "1 where the block overturns", "1"),
    "margin": (float, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (int, "number of impacts", "1"),
    "error": (float, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (np.int8, "1 where the error is within the tolerance", "1"),
}


def fragility(  # noqa: PLR0913
    block: Block,
    restitution: Number,
    suite: Suite,
    levels: Numbers | None = None,
    measure: str = "pgv",
    thresholds: Sequence[Threshold] = ("uplift", 0.5, 1.0, "overturning"),
    *,
    uncertain: Uncertain | None = None,
    tolerance: float = 1e-3,
    confidence: float = 0.95,
    model: ModelLike = Nonlinear(),
    chunks: "Chunks | None" = None,
    names: Sequence[str] | None = None,
) -> "xarray.Dataset":
    """Compute fragility curves: probabilities of exceeding thresholds under a suite.

    Parameters
    ----------
    block : Block
        A single block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; for all blocks, or an array with a value for each.
    suite : Suite
    levels : array_like, shape (n,), optional
        Increasing levels to which each record is scaled [unit of the measure]; by default 25
        levels, from far below uplift of blocks of this size to far above overturning.
    measure : str
        ``"pgv"``, ``"pga"``, ``"pgv_ratio"`` or ``"pga_ratio"``; see `intensity_measure`.
    thresholds : sequence of float or str
        Rotation ratios alpha_max / alpha_c [-], greater than 0; ``"uplift"``, any rotation;
        ``"overturning"``, which exceeds every ratio as well.
    uncertain : Uncertain, optional
        Coefficients of variation of sizes, of the ``inertia_ratio``, ``gravity`` and
        ``restitution``, of ``floor_period`` and ``floor_damping`` under a suite on a floor, and
        the samples to draw. Records, levels and blocks share the samples.
    tolerance : float
        Relative error of peak rotations; see `respond_within`.
    confidence : float
        Confidence level of the intervals, between 0 and 1.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    chunks : mapping of str to int or "auto", optional
        Lengths along object, record, sample and level, for a lazy dataset; see
        `resonance_spectrum`.
    names : sequence of str, optional
        Names of the blocks; ``"1"``, ``"2"``, ... by default.

    Returns
    -------
    xarray.Dataset
        Many blocks add the leading dimension ``object`` to all variables.

        - Over level and threshold: ``exceedance``, the probability of exceedance, counted over
          the records, with its Clopper-Pearson interval ``exceedance_low`` to
          ``exceedance_high``; ``lognormal``, the maximum-likelihood lognormal fragility curve.
          Both assume independent records, and take the mean of both directions of a record
          where the suite has both.
        - Over threshold: ``lognormal_median``, ``lognormal_dispersion``, and a ``remark``,
          which says where the curve does not fit, since overturning is not monotone in the
          level. The curve is fitted to the levels at which each record begins or ceases to
          exceed the threshold: exact for uplift, and located between two levels for others.
        - Over level: ``fraction_within_tolerance``. The other responses are chaotic.
        - Over record and level: every response, and the factor on the record. Over record and
          threshold: ``boundary_sums``, the numbers to which the curve is fitted.

        With `uncertain` the responses have the dimension ``sample`` as well, and the
        probabilities are averaged over samples and records. The intervals treat the records as
        the independent units, each with the fraction of its samples that exceed the threshold.
        They cover both kinds of uncertainty. Two variables over threshold split the dispersion:
        ``dispersion_of_records`` is the root mean square of the dispersions of single samples,
        ``dispersion_of_parameters`` the standard deviation of the logarithms of their medians.

    Raises
    ------
    ValueError
        If an argument is out of range, a record has no intensity, or the integration of a
        motion did not finish.

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
    require_single_scales(suite)
    if not isinstance(confidence, float | int) or not 0 < confidence < 1:
        raise ValueError(
            f"confidence must be a number between 0 and 1, got {confidence!r:.60}"
        )
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    threshold_names = name_thresholds(thresholds)
    limits = [float(NAMED_THRESHOLDS.get(value, value)) for value in thresholds]
    model = as_model(model)
    measure = as_name("measure", measure, MEASURES)
    if levels is None:
        levels = _choose_levels(objects.block, measure)
    levels = _check_levels(levels)
    strengths = np.asarray(require_positive_measures(suite, measure, objects.block))
    # A single block has no axis of objects; without uncertainty there is none of samples.
    axes = {"object": np.arange(objects.number)} if objects.shape else {}
    axes["record"] = np.arange(len(suite))
    if uncertain is not None:
        check_kind("uncertain", uncertain, Uncertain)
        axes["sample"] = np.arange(uncertain.samples)
    of_record = (*axes, "threshold", "power")
    axes["level"] = levels
    variables = {
        name: GridVariable(tuple(axes), dtype, describe_variable(long_name, units))
        for name, (dtype, long_name, units) in _RESPONSES.items()
    }
    variables["boundary_sums"] = GridVariable(of_record, float, describe_variable(_SUMS))
    attributes: dict[str, object] = {
        "model": model.name,
        **_describe_objects(objects, uncertain),
        "measure": measure,
        "records": suite.recordings,
        **describe_suite(suite),
        "tolerance": tolerance,
        "confidence": confidence,
    }
    grid = Grid(
        "Fragility",
        axes,
        variables,
        attributes,
        functools.partial(_simulate_scaled_records, tolerance, model, tuple(axes), limits),
        max(_LARGEST, levels.size),
        _USUAL,
        labels={"level": describe_variable(*MEASURES[measure][:2])},
        columns={"threshold": len(threshold_names), "power": 3},
        shared=_gather_input(
            objects, uncertain, suite, strengths, model if 0.0 in limits else None
        ),
        whole="level",
    )
    labels = {"record": (suite.names, "ground motion")}
    if objects.shape:
        labels["object"] = (objects.names, "object")
    responses = add_names(grid.build_dataset(chunks), **labels)
    return add_curves(responses, limits, threshold_names, confidence, suite.directions)


def _choose_levels(block: Block, measure: str) -> np.ndarray:
    """Choose levels around the intensities that lift and overturn blocks of these sizes."""
    uplift = block.gravity / block.slenderness
    if measure.startswith("pga"):
        unit = 1.0 if measure == "pga_ratio" else uplift
        low = 0.5
        high = 16.0
    else:
        # Velocities scale with 1 / p: it takes a faster ground to overturn a larger block.
        unit = 1.0 if measure == "pgv_ratio" else uplift / block.frequency_parameter
        low = 0.1
        high = 3.0
    smallest = np.min(unit)
    return smallest * np.geomspace(low, high * np.max(unit) / smallest, 25)


def _check_levels(levels: Numbers) -> np.ndarray:
    """Return levels as an array; a `ValueError` if they are not allowed."""
    check("levels", as_real("levels", levels), POSITIVE)
    values = np.asarray(levels, float)
    if values.ndim != 1 or not values.size:
        raise ValueError(
            f"levels must be one-dimensional and not empty, got an array of shape {values.shape}"
        )
    check_increasing("levels", values)
    return values


def _describe_objects(objects: Objects, uncertain: Uncertain | None) -> dict[str, object]:
    """Collect parameters, coefficients of variation and correlations as attributes."""
    parameters = {**size_of(objects.block, "shape"), "restitution": objects.restitution}
    attributes: dict[str, object] = {
        name: np.asarray(value, float).tolist() for name, value in parameters.items()
    }
    if objects.block.one_sided:
        attributes["one_sided"] = 1
    if uncertain is not None:
        for name, value in uncertain.coefficients_of_variation.items():
            attributes[f"coefficient_of_variation_of_{name}"] = np.asarray(value).tolist()
        for (first, second), value in uncertain.correlations.items():
            attributes[f"correlation_of_{first}_and_{second}"] = value
        attributes |= {"samples": uncertain.samples, "seed": uncertain.seed}
    return attributes


class _SimulationInput(NamedTuple):
    """Input of all simulations, of which a chunk takes the parts that its indices say.

    Attributes
    ----------
    batch : Batch, shape (records, objects, samples)
        Under the records as they are.
    strengths : ndarray, shape (records, objects)
        Intensities of the records [unit of the measure].
    critical_angle : ndarray, shape (objects, samples)
        Of the blocks [rad].
    names : dict
        Names of the records and of the objects, for messages.
    uplift : ndarray, shape (records, objects, samples), or None
        Levels from which on blocks are lifted; None where uplift is no threshold.
    """

    batch: Batch
    strengths: AnyArray
    critical_angle: AnyArray
    names: dict[str, tuple[str, ...]]
    uplift: AnyArray | None


def _gather_input(
    objects: Objects,
    uncertain: Uncertain | None,
    suite: Suite,
    strengths: np.ndarray,
    model: RockingModel | None,
) -> _SimulationInput:
    """Gather the parameters of all objects, samples and records; uplift if there is a model."""
    parameters = (objects.block, objects.restitution)
    floors = None
    if uncertain is not None:
        draws = uncertain.draw(*parameters, on_floor=suite.floor is not None)
        parameters = (draws.block, draws.restitution)
        floors = jax.tree.map(lambda leaf: leaf.reshape(objects.number, -1), draws.floor)
    # Samples are drawn in float64, and simulated in the precision of their medians.
    dtype = objects.restitution.dtype
    block, restitution = jax.tree.map(
        lambda leaf: np.asarray(leaf, dtype).reshape(objects.number, -1), parameters
    )
    flat = jax.tree.map(np.ravel, block)
    angles = apply_padded(lambda padded: padded.critical_angle, flat)
    motions = vary_motions(suite, floors)
    strengths = np.broadcast_to(
        strengths.reshape(len(suite), -1), (len(suite), objects.number)
    )
    uplift = None
    if model is not None:
        shape = (len(suite), *block.half_width.shape)
        intensities = np.broadcast_to(strengths[..., None], shape).reshape(len(suite), -1)
        uplift = find_uplift_levels(flat, motions, intensities, model).reshape(shape)
        uplift = uplift.astype(dtype)  # as all other answers, however they are computed
    return _SimulationInput(
        Batch.of(block, restitution, motions),
        strengths,
        angles.reshape(objects.number, -1),
        {"object": objects.names, "record": suite.names},
        uplift,
    )


def _simulate_scaled_records(
    tolerance: float,
    model: RockingModel,
    dims: tuple[str, ...],
    limits: list[float],
    parameters: _SimulationInput,
    *parts: np.ndarray,
) -> dict[str, np.ndarray]:
    """Simulate blocks under records that are scaled to all levels, and locate boundaries."""
    # Dimensions that the dataset lacks have one entry, the first.
    index: dict[str, npt.NDArray | int] = {"object": 0, "sample": 0}
    index |= zip(dims[:-1], np.meshgrid(*parts[:-1], indexing="ij"), strict=True)
    shape = tuple(part.size for part in parts[:-1])
    record, place, sample = (
        np.broadcast_to(index[name], shape).reshape(-1)
        for name in ("record", "object", "sample")
    )
    places = (record, place, sample)
    levels = np.asarray(as_real("levels", parts[-1]))
    labels: dict[str, Labels] = {
        dim: [parameters.names[dim][k] for k in part] if dim in parameters.names else part
        for dim, part in zip(dims, parts, strict=True)
    }
    batch, factor = _scale_batch(
        parameters, places, np.arange(places[0].size)[:, None], levels
    )
    estimate = follow_within(batch, tolerance, model)
    response = estimate.response
    require_complete(response.complete.reshape(*shape, levels.size), **labels)
    angles = np.asarray(parameters.critical_angle)[places[1:]][:, None]
    ratio = np.asarray(response.peak_rotation) / angles
    values = {**vars(estimate), **vars(response), "factor": factor, "rotation_ratio": ratio}

    def evaluate(cases: np.ndarray, between: np.ndarray) -> np.ndarray:
        """Return which thresholds are exceeded at levels between those of the dataset."""
        batch, _ = _scale_batch(parameters, places, cases, between)
        response = follow_batch(batch, model)
        require_complete(np.ravel(response.complete), level=np.ravel(between))
        between_ratio = np.asarray(response.peak_rotation) / angles[cases[:, 0]]
        return _exceed(between_ratio, response, limits)

    exceeded = np.moveaxis(_exceed(ratio, response, limits), -1, 1)
    # The level of uplift is known exactly: nothing has to be located.
    is_uplift = np.array(limits) == NAMED_THRESHOLDS["uplift"]
    sums = sum_boundaries(
        exceeded & ~is_uplift[:, None], levels, evaluate, parameters.batch.shape[2]
    )
    if parameters.uplift is not None:
        uplift = np.asarray(parameters.uplift)[places]
        is_lifted = np.isfinite(uplift)
        replaced = np.where(is_lifted, uplift, 1.0)[:, None, None]
        sums[:, is_uplift] = sum_powers(replaced, is_lifted[:, None, None])
    answers = {name: np.asarray(values[name]) for name in _RESPONSES}
    answers["boundary_sums"] = sums
    return {name: array.reshape(*shape, *array.shape[1:]) for name, array in answers.items()}


def _scale_batch(
    parameters: _SimulationInput,
    places: tuple[np.ndarray, np.ndarray, np.ndarray],
    cases: np.ndarray,
    levels: np.ndarray,
) -> tuple[Batch, np.ndarray]:
    """Scale cases, which are places among records, objects and samples, to levels."""
    record, block, sample = (place[cases] for place in places)
    which = np.ravel_multi_index((record, block, sample), parameters.batch.shape)
    factor = levels / np.asarray(parameters.strengths)[record, block]
    batch = parameters.batch.select(np.broadcast_to(which, factor.shape))
    return batch.scaled(factor), factor


def _exceed(ratio: np.ndarray, response: BatchResponse, limits: list[float]) -> np.ndarray:
    """Return which thresholds responses exceed, along a last axis."""
    overturned = np.asarray(response.overturned, bool)
    return (np.asarray(ratio)[..., None] > np.array(limits)) | overturned[..., None]
