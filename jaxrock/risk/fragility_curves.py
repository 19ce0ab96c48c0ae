"""Fragility: probabilities of exceeding thresholds under a suite, over the intensity."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..block import Block, size_of
from ..ground_motion import MEASURES, Suite, describe_suite
from ..host import add_names, format_table, make_dataset
from ..numerics import bound_probabilities
from ..resonance import ModelLike, Nonlinear, as_model
from ..sensitivity import Uncertain
from ..validation import POSITIVE, Number, Numbers, as_name, as_real, check, check_kind
from .hazard import check_levels
from .lognormal import LognormalFit, fit_lognormal
from .objects import gather_objects
from .response_table import simulate_responses
from .site import require_single_scales

if TYPE_CHECKING:
    import xarray

Threshold = float | int | str
# Rotation ratios beyond which a response exceeds a threshold that has a name. Whatever
# overturns exceeds all of them.
NAMED_THRESHOLDS: dict[Threshold, float] = {"uplift": 0.0, "overturning": np.inf}
_CONFIDENCE = 0.95  # of the intervals
MEASURE_UNIT = "measure"  # a variable in the unit of the measure
_OF_LEVELS = "object threshold level"
_OF_CURVES = "object threshold"
_OF_RESPONSES = "record object sample level"
_DISPERSION = "standard deviation of ln(level)"
# Dimensions, as they are computed, long name and unit of each variable.
_VARIABLES: dict[str, tuple[str, str, str]] = {
    "exceedance": (_OF_LEVELS, "probability of exceedance", "1"),
    "exceedance_low": (_OF_LEVELS, "lower limit of the Clopper-Pearson interval", "1"),
    "exceedance_high": (_OF_LEVELS, "upper limit of the Clopper-Pearson interval", "1"),
    "lognormal": (_OF_LEVELS, "maximum-likelihood lognormal fragility curve", "1"),
    "lognormal_median": (_OF_CURVES, "median of the lognormal curve", MEASURE_UNIT),
    "lognormal_dispersion": (_OF_CURVES, f"{_DISPERSION} of that curve", "1"),
    "remark": (_OF_CURVES, "remark on the lognormal curve", ""),
    "rotation_ratio": (_OF_RESPONSES, "peak rotation over critical angle", "1"),
    "overturned": (_OF_RESPONSES, "1 where the block overturns", "1"),
}


def fragility(
    block: Block,
    restitution: Number,
    suite: Suite,
    levels: Numbers | None = None,
    measure: str = "pgv",
    thresholds: Sequence[Threshold] = ("uplift", 0.5, 1.0, "overturning"),
    *,
    uncertain: Uncertain | None = None,
    model: ModelLike = Nonlinear(),
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
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    xarray.Dataset
        Many blocks add the leading dimension ``object`` to all variables, from 1 on.

        - Over level and threshold: ``exceedance``, the probability of exceedance, counted over
          the records, with its Clopper-Pearson interval ``exceedance_low`` to
          ``exceedance_high``; ``lognormal``, the maximum-likelihood lognormal fragility curve.
          Both assume independent records, and take the mean of both directions of a record
          where the suite has both.
        - Over threshold: ``lognormal_median``, ``lognormal_dispersion``, and a ``remark``,
          which says where the probability decreases, since overturning is not monotone in the
          level. The curve is fitted to the levels at which each record begins or ceases to
          exceed the threshold, located between the levels.
        - Over record and level: the ``rotation_ratio``, and whether the block ``overturned``.

        With `uncertain` the responses have the dimension ``sample`` as well, and the
        probabilities are averaged over samples and records. The intervals treat the records as
        the independent units, each with the fraction of its samples that exceed the threshold.
        They cover both kinds of uncertainty.

    Raises
    ------
    ValueError
        If an argument is out of range, a record has no intensity, or the integration of a
        motion did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, a, a, -a, -a, 0.0], 0.1) for a in (2.0, 3.0)])
    >>> curves = jr.risk.fragility(jr.Block(0.1, 5.0), 0.8, suite, [0.2, 0.8])
    >>> print(curves.exceedance.sel(threshold="overturning").values)
    [0. 1.]
    """
    check_kind("suite", suite, Suite)
    objects = gather_objects(block, restitution)
    block, coefficient = objects
    require_single_scales(suite)
    threshold_names = name_thresholds(thresholds)
    limits = np.array([float(NAMED_THRESHOLDS.get(value, value)) for value in thresholds])
    model = as_model(model)
    measure = as_name("measure", measure, MEASURES)
    if levels is None:
        levels = _choose_levels(block, measure)
    check_levels("levels", levels)
    levels = np.asarray(levels, float)
    table = simulate_responses(objects, suite, levels, measure, uncertain, model)
    # The directions of a record count as one record, by their mean; samples by theirs.
    counts = table.exceed(limits).mean(axis=2).sum(axis=0) / suite.directions
    samples = table.rotation_ratio.shape[2]
    owner, limit, boundary, sign = table.locate_boundaries(limits)
    weight = sign / (samples * suite.directions)
    shape = counts.shape[:2]
    curves = []
    for k, t in np.ndindex(shape):
        own = (owner == k) & (limit == t)
        parts = (counts[k, t], boundary[own], weight[own])
        curves.append(_fit_curve(*parts, levels, suite.recordings))
    # A record counts by the fraction of its samples, whose variance is smaller than that of a
    # single outcome with the same mean: the interval is too wide, never too narrow.
    low, high = bound_probabilities(counts, suite.recordings, _CONFIDENCE)
    values = {
        "exceedance": counts / suite.recordings,
        "exceedance_low": low,
        "exceedance_high": high,
        "lognormal": np.reshape([curve.at(levels) for curve in curves], counts.shape),
        "lognormal_median": np.reshape([curve.median for curve in curves], shape),
        "lognormal_dispersion": np.reshape([curve.dispersion for curve in curves], shape),
        "remark": np.reshape([curve.remark for curve in curves], shape),
        "rotation_ratio": table.rotation_ratio,
        # Files have no booleans.
        "overturned": np.asarray(table.response.overturned).astype(np.int8),
    }
    long_name, unit, _ = MEASURES[measure]
    variables = label_variables(_VARIABLES, values, unit)
    coordinates = {
        "level": ("level", levels, describe_variable(long_name, unit)),
    }
    parameters = {**size_of(block, "shape"), "restitution": coefficient}
    attributes = {
        "model": model.name,
        **{name: np.asarray(value, float).tolist() for name, value in parameters.items()},
        **({"one_sided": 1} if block.one_sided else {}),
        **({} if uncertain is None else {"uncertain": str(uncertain)}),
        "measure": measure,
        "records": suite.recordings,
        **describe_suite(suite),
        "confidence": _CONFIDENCE,
    }
    dataset = make_dataset("Fragility", variables, coordinates, attributes)
    dataset = add_names(
        dataset,
        object=([str(k + 1) for k in range(coefficient.size)], "object"),
        record=(suite.names, "ground motion"),
        threshold=(threshold_names, "threshold"),
    ).transpose("object", "record", "sample", "level", "threshold")
    # A single block has no axis of objects; without uncertainty there is none of samples.
    if uncertain is None:
        dataset = dataset.isel(sample=0, drop=True)
    return dataset if coefficient.ndim else dataset.isel(object=0, drop=True)


def describe_fragility(curves: "xarray.Dataset") -> str:
    """Write medians and dispersions of the curves of one block, and remarks on them."""
    measure = curves.attrs["measure"]
    unit = "" if MEASURES[measure][2] else f" [{MEASURES[measure][1]}]"
    low, high = curves.level.values[[0, -1]]
    names = curves.threshold.values.tolist()
    labels = [n if n in NAMED_THRESHOLDS else f"rotation ratio {n}" for n in names]
    columns = {
        f"median{unit}": curves["lognormal_median"].values,
        "dispersion": curves["lognormal_dispersion"].values,
    }
    number = curves.sizes["level"]
    title = (
        f"lognormal curves from {number} levels of {measure}, {low:.4g} to {high:.4g}{unit}"
    )
    lines = [format_table(title, labels, **columns)]
    if "record_source" in curves.attrs:
        lines.insert(0, f"records: {curves.attrs['record_source']}")
    remarks = zip(labels, curves.remark.values, strict=True)
    return "\n".join([*lines, *(f"{label}: {remark}" for label, remark in remarks if remark)])


def tabulate_fragility(curves: "xarray.Dataset") -> dict[str, object]:
    """List thresholds, medians, dispersions and remarks of the curves of one block."""
    names = {"thresholds": "threshold", "median": "lognormal_median", "remarks": "remark"}
    names |= {"dispersion": "lognormal_dispersion"}
    source = {name: text for name, text in curves.attrs.items() if name == "record_source"}
    columns = {name: curves[variable].values.tolist() for name, variable in names.items()}
    return {"records": curves.sizes["record"], **source, **columns}


def _choose_levels(block: Block, measure: str) -> np.ndarray:
    """Choose levels around the intensities that lift and overturn blocks of these sizes."""
    by_acceleration = measure.startswith("pga")
    low, high = (0.5, 16.0) if by_acceleration else (0.1, 3.0)
    unit = block.gravity / block.slenderness
    if measure.endswith("ratio"):
        unit = np.ones(1)
    elif not by_acceleration:
        # Velocities scale with 1 / p: it takes a faster ground to overturn a larger block.
        unit = unit / block.frequency_parameter
    smallest = np.min(unit)
    return smallest * np.geomspace(low, high * np.max(unit) / smallest, 25)


def name_thresholds(thresholds: Sequence[Threshold]) -> list[str]:
    """Name the thresholds; a `ValueError` if they are not allowed."""
    names = []
    for threshold in thresholds:
        if isinstance(threshold, str):
            names.append(as_name("thresholds", threshold, map(str, NAMED_THRESHOLDS)))
        else:
            check("thresholds", as_real("thresholds", threshold), POSITIVE)
            names.append(f"{float(threshold):g}")
    return names


def label_variables(
    descriptions: Mapping[str, tuple[str, str, str]],
    values: Mapping[str, np.ndarray],
    measure_unit: str,
) -> dict[str, tuple]:
    """Label values by dimensions, long name and unit; "" for none."""
    labelled = {}
    for name, array in values.items():
        dims, long_name, unit = descriptions[name]
        unit = measure_unit if unit == MEASURE_UNIT else unit
        labelled[name] = (dims.split(), array, describe_variable(long_name, unit))
    return labelled


def describe_variable(long_name: str, units: str = "1") -> dict[str, str]:
    """Make the attributes of a variable, with its unit, if any, as CF writes it."""
    units = units.replace("m/s2", "m s-2").replace("m/s", "m s-1")
    return {"long_name": long_name} | ({"units": units} if units else {})


def _fit_curve(
    counts: np.ndarray,
    boundaries: np.ndarray,
    weights: np.ndarray,
    levels: np.ndarray,
    records: int,
) -> LognormalFit:
    """Fit the curve of one threshold, and remark on the counts that it does not show.

    Parameters
    ----------
    counts : ndarray, shape (levels,)
        Numbers of records under which it is exceeded. They need not be whole.
    boundaries, weights : ndarray, shape (boundaries,)
        See `fit_lognormal`.
    levels : ndarray, shape (levels,)
    records : int
        Number of independent records.
    """
    # Of uplift also the boundaries below the levels are known: then no record is without one.
    below = round(float(counts[-1] - weights.sum()), 9)
    curve = fit_lognormal(boundaries, weights, below, records - float(counts[-1]), levels)
    remarks = [curve.remark] * bool(curve.remark)
    if curve.median > levels[-1] or (below and curve.median < levels[0]):
        remarks.append("the median lies outside of the levels")
    # Counts need not increase with the level: a block that a record overturns may survive the
    # same record made stronger. A lognormal curve hides that, so the remark says it.
    falls = int((np.diff(counts) < 0).sum())
    if falls:
        number = f"{falls} level{'s' * (falls > 1)}"
        remarks.append(f"some records exceed it at {number}, but not at the next higher one")
    return curve._replace(remark="; ".join(remarks))
