"""Fragility: probabilities of exceeding thresholds under a suite, over the intensity."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..block import Block, size_of
from ..grids import describe_axis
from ..ground_motion import MEASURES, Suite, describe_suite
from ..host import add_names, make_dataset
from ..resonance import ModelLike, Nonlinear, as_model
from ..sensitivity import Uncertain
from ..validation import (
    POSITIVE,
    Number,
    Numbers,
    as_name,
    as_real,
    check,
    check_kind,
)
from .exceedance import (
    NAMED_THRESHOLDS,
    Threshold,
    compute_curve,
    describe_variable,
    name_thresholds,
)
from .objects import Objects, gather_objects
from .response_table import simulate_responses
from .site import check_levels, require_single_scales

if TYPE_CHECKING:
    import xarray

_OF_LEVELS = "object threshold level"
_OF_CURVES = "object threshold"
_OF_RESPONSES = "record object sample level"
_DISPERSION = "standard deviation of ln(level)"
# Dimensions, as they are computed, long name and unit of each variable; without a unit, it has
# the one of the measure, or none.
_VARIABLES: dict[str, tuple[str, str, str]] = {
    "exceedance": (_OF_LEVELS, "probability of exceedance", "1"),
    "exceedance_low": (_OF_LEVELS, "lower limit of the Clopper-Pearson interval", "1"),
    "exceedance_high": (_OF_LEVELS, "upper limit of the Clopper-Pearson interval", "1"),
    "lognormal": (_OF_LEVELS, "maximum-likelihood lognormal fragility curve", "1"),
    "lognormal_median": (_OF_CURVES, "median of the lognormal curve", ""),
    "lognormal_dispersion": (_OF_CURVES, f"{_DISPERSION} of that curve", "1"),
    "remark": (_OF_CURVES, "remark on the lognormal curve", ""),
    "dispersion_of_records": (_OF_CURVES, f"{_DISPERSION} due to the records", "1"),
    "dispersion_of_parameters": (
        _OF_CURVES,
        f"{_DISPERSION} due to uncertain parameters",
        "1",
    ),
    "fraction_within_tolerance": (
        "object level",
        "fraction of responses within the tolerance",
        "1",
    ),
    "factor": (_OF_RESPONSES, "factor on the record", "1"),
    "rotation_ratio": (_OF_RESPONSES, "peak rotation over critical angle", "1"),
    "peak_rotation": (_OF_RESPONSES, "peak rotation", "rad"),
    "overturned": (_OF_RESPONSES, "1 where the block overturns", "1"),
    "margin": (_OF_RESPONSES, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (_OF_RESPONSES, "number of impacts", "1"),
    "error": (_OF_RESPONSES, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (_OF_RESPONSES, "1 where the error is within the tolerance", "1"),
    "boundary_sums": (
        "record object sample threshold power",
        "sums of ln(level)^k where exceedance begins, minus where it ends, for k = 0, 1, 2",
        "1",
    ),
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
    limits = np.array([float(NAMED_THRESHOLDS.get(value, value)) for value in thresholds])
    model = as_model(model)
    measure = as_name("measure", measure, MEASURES)
    if levels is None:
        levels = _choose_levels(objects.block, measure)
    check_levels("levels", levels)
    levels = np.asarray(levels, float)
    if uncertain is not None:
        check_kind("uncertain", uncertain, Uncertain)
    table = simulate_responses(objects, suite, levels, measure, uncertain, tolerance, model)
    sums = table.sum_boundaries(limits)
    # The directions of a record count as one record, by their mean.
    counts = table.exceed(limits).sum(axis=0) / suite.directions
    powers = sums.sum(axis=0) / suite.directions
    curves = [
        [
            compute_curve(
                counts[k, :, t],
                powers[k, :, t],
                threshold == "uplift",
                levels,
                suite.recordings,
                confidence,
            )
            for t, threshold in enumerate(threshold_names)
        ]
        for k in range(objects.number)
    ]
    values = table.list_responses() | {"boundary_sums": sums}
    values["fraction_within_tolerance"] = values["within_tolerance"].mean(axis=(0, 2))
    for name in curves[0][0]:
        values[name] = np.array([[curve[name] for curve in row] for row in curves])
    long_name, unit, _ = MEASURES[measure]
    variables = {
        name: (dims.split(), values[name], describe_variable(words, units or unit))
        for name, (dims, words, units) in _VARIABLES.items()
    }
    del variables["remark"][2]["units"]
    coordinates = {
        "sample": ("sample", np.arange(counts.shape[1]), describe_axis("sample")),
        "level": ("level", levels, describe_variable(long_name, unit)),
    }
    attributes = {
        "model": model.name,
        **_describe_objects(objects, uncertain),
        "measure": measure,
        "records": suite.recordings,
        **describe_suite(suite),
        "tolerance": tolerance,
        "confidence": confidence,
    }
    dataset = make_dataset("Fragility", variables, coordinates, attributes)
    dataset = add_names(
        dataset,
        object=(objects.names or ["1"], "object"),
        record=(suite.names, "ground motion"),
        threshold=(threshold_names, "threshold"),
    ).transpose("object", "record", "sample", "level", "threshold", "power")
    # A single block has no axis of objects; without uncertainty there is none of samples.
    if uncertain is None:
        dataset = dataset.isel(sample=0, drop=True)
        dataset = dataset.drop_vars(["dispersion_of_records", "dispersion_of_parameters"])
    return dataset if objects.shape else dataset.isel(object=0, drop=True)


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
