"""Probabilities of exceedance, counted from responses, and curves fitted to them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..grids import DataType
from ..host import add_names
from ..numerics import bound_probabilities
from ..validation import POSITIVE, as_real, as_text, check
from .lognormal import BoundarySums, LognormalFit, fit_lognormal

if TYPE_CHECKING:
    import xarray

Threshold = float | int | str
# Rotation ratios beyond which a response exceeds a threshold that has a name. Whatever
# overturns exceeds all of them.
NAMED_THRESHOLDS: dict[Threshold, float] = {"uplift": 0.0, "overturning": np.inf}


def name_thresholds(thresholds: Sequence[Threshold]) -> list[str]:
    """Name the thresholds; a `ValueError` if they are not allowed."""
    if isinstance(thresholds, str) or not isinstance(thresholds, Iterable):
        raise ValueError(f"thresholds must be a list, got {thresholds!r:.60}")
    names = [_name_threshold(threshold) for threshold in thresholds]
    if not names or len(set(names)) < len(names):
        listed = ", ".join(names) or "none"
        raise ValueError(f"thresholds must be at least one, each only once, got {listed}")
    return names


def _name_threshold(threshold: Threshold) -> str:
    """Name a threshold; a `ValueError` if it is none."""
    threshold = as_text(threshold)
    if isinstance(threshold, str):
        if threshold not in NAMED_THRESHOLDS:
            allowed = f"rotation ratios, {' or '.join(map(repr, NAMED_THRESHOLDS))}"
            raise ValueError(f"thresholds must be {allowed}, got {threshold!r}")
        return threshold
    check("thresholds", as_real("thresholds", threshold), POSITIVE)
    return f"{float(threshold):g}"


def describe_variable(long_name: str, units: str = "1") -> dict[str, str]:
    """Make the attributes of a variable, with its unit as CF writes it."""
    return {
        "long_name": long_name,
        "units": units.replace("m/s2", "m s-2").replace("m/s", "m s-1"),
    }


# Dimensions beside object and threshold, type, and long name of the variables of a curve. The
# remark has no unit, the median has the one of the levels.
_VARIABLES: dict[str, tuple[tuple[str, ...], DataType, str]] = {
    "exceedance": (("level",), float, "probability of exceedance"),
    "exceedance_low": (("level",), float, "lower limit of the Clopper-Pearson interval"),
    "exceedance_high": (("level",), float, "upper limit of the Clopper-Pearson interval"),
    "lognormal": (("level",), float, "maximum-likelihood lognormal fragility curve"),
    "lognormal_median": ((), float, "median of the lognormal curve"),
    "lognormal_dispersion": ((), float, "standard deviation of ln(level) of that curve"),
    # Long enough for the longest remark: a lazy dataset and a store must know the type before
    # there is any.
    "remark": ((), "<U200", "remark on the lognormal curve"),
}
_PARTS_OF_DISPERSION: dict[str, tuple[tuple[str, ...], DataType, str]] = {
    "dispersion_of_records": ((), float, "standard deviation of ln(level) due to the records"),
    "dispersion_of_parameters": (
        (),
        float,
        "standard deviation of ln(level) due to uncertain parameters",
    ),
}


class _FragilityCurve(NamedTuple):
    """Exceedance of one threshold by one object; the fields are variables of the dataset."""

    exceedance: np.ndarray
    exceedance_low: np.ndarray
    exceedance_high: np.ndarray
    lognormal: np.ndarray
    lognormal_median: float
    lognormal_dispersion: float
    remark: str
    dispersion_of_records: float
    dispersion_of_parameters: float


def add_curves(
    responses: "xarray.Dataset",
    limits: Sequence[float],
    names: Sequence[str],
    confidence: float,
    directions: int,
) -> "xarray.Dataset":
    """Put fragility curves over the level before the responses that they are counted from.

    Both `directions` of a record count as one record, by their mean.

    The responses may have dimensions of objects and of samples as well. The curves are lazy if
    the responses are.
    """
    import xarray

    ratios = xarray.DataArray(limits, dims="threshold")
    exceeded = (responses.rotation_ratio > ratios) | (responses.overturned > 0)
    counts = exceeded.sum("record")
    sums = responses.boundary_sums
    if responses.chunks:
        # Summed at once, or the chunks would decide the last bit.
        sums = sums.chunk({"record": -1})
    sums = sums.sum("record")
    if directions > 1:
        counts = counts / directions
        sums = sums / directions
    if "sample" in counts.dims:
        variables = _VARIABLES | _PARTS_OF_DISPERSION
    else:
        variables = _VARIABLES
        counts = counts.expand_dims("sample")
        sums = sums.expand_dims("sample")
    dims, dtypes, long_names = zip(*variables.values(), strict=True)
    chunks = responses.chunks
    if chunks:
        # A curve is of all samples and all levels.
        counts = counts.chunk({"sample": -1, "level": -1})
        sums = sums.chunk({"sample": -1})
    arrays = xarray.apply_ufunc(
        _compute_curves,
        counts,
        sums,
        ratios == NAMED_THRESHOLDS["uplift"],
        kwargs={
            "levels": responses.level.values,
            "records": responses.sizes["record"] // directions,
            "confidence": confidence,
            "dtypes": dict(zip(variables, dtypes, strict=True)),
        },
        input_core_dims=[["sample", "level"], ["sample", "power"], []],
        output_core_dims=dims,
        output_dtypes=dtypes,
        dask="parallelized",
    )
    curves = responses.drop_vars(list(responses.data_vars))
    for name, long_name, array in zip(variables, long_names, arrays, strict=True):
        curves[name] = array.transpose(..., "threshold").assign_attrs(
            describe_variable(long_name)
        )
    curves["lognormal_median"].attrs["units"] = responses.level.attrs["units"]
    del curves["remark"].attrs["units"]
    averaged = [dim for dim in ("record", "sample") if dim in responses.factor.dims]
    within = responses.within_tolerance.mean(averaged)
    curves["fraction_within_tolerance"] = within.assign_attrs(
        describe_variable("fraction of responses within the tolerance")
    )
    if chunks:
        # Variables of a dataset must agree about the chunks along a dimension.
        curves = curves.chunk(level=chunks["level"])
    return add_names(curves.assign(responses.data_vars), threshold=(names, "threshold"))


def _compute_curves(
    counts: np.ndarray,
    sums: np.ndarray,
    is_uplift: np.ndarray,
    levels: np.ndarray,
    records: int,
    confidence: float,
    dtypes: Mapping[str, DataType],
) -> tuple[np.ndarray, ...]:
    """Compute variables of these types for counts of shape (..., samples, levels)."""
    *shape, samples, _ = counts.shape
    uplift = np.broadcast_to(is_uplift, shape).reshape(-1)
    curves = [
        _compute_curve(lines, powers, bool(known), levels, records, confidence)
        for lines, powers, known in zip(
            counts.reshape(-1, samples, levels.size),
            sums.reshape(-1, samples, 3),
            uplift,
            strict=True,
        )
    ]
    variables = []
    for name, dtype in dtypes.items():
        values = np.array([getattr(curve, name) for curve in curves], dtype)
        variables.append(values.reshape(*shape, *values.shape[1:]))
    return tuple(variables)


def _compute_curve(
    counts: np.ndarray,
    sums: np.ndarray,
    is_uplift: bool,
    levels: np.ndarray,
    records: int,
    confidence: float,
) -> _FragilityCurve:
    """Compute counted and fitted probabilities of one threshold; counts (samples, levels)."""
    # A record counts by the fraction of its samples, whose variance is smaller than that of a
    # single outcome with the same mean: the interval is too wide, never too narrow.
    mean = counts.mean(axis=0)
    low, high = bound_probabilities(mean, records, confidence)
    ends = (float(levels[0]), float(levels[-1]))

    def fit(count: float, powers: np.ndarray) -> LognormalFit:
        """Fit a curve where `count` records exceed at the lowest level."""
        # The level of uplift is known also outside of the levels.
        below = 0.0 if is_uplift else float(count)
        above = max(records - below - float(powers[0]), 0.0)
        return fit_lognormal(BoundarySums(below, above, powers), ends)

    curve = fit(float(mean[0]), sums.mean(axis=0))
    fitted = curve.at(levels)
    remarks = [curve.remark] if curve.remark else []
    if not is_uplift and not ends[0] <= curve.median <= ends[1] and curve.median > 0:
        remarks.append("the median lies outside of the levels")
    outside = int(((fitted < low) | (fitted > high)).sum())
    if outside:
        remarks.append(
            f"the curve is outside of the intervals at {outside} of {levels.size} levels"
        )
    # Counts need not increase with the level: a block that a record overturns may survive the
    # same record made stronger. A lognormal curve hides that, so the remark says it.
    falls = int((np.diff(mean) < 0).sum())
    if falls:
        places = f"{falls} level{'s' * (falls > 1)}"
        remarks.append(f"at {places} fewer records exceed it than at the next lower level")
    curves = (
        [curve]
        if len(counts) == 1
        else [fit(float(c), p) for c, p in zip(counts[:, 0], sums, strict=True)]
    )
    return _FragilityCurve(
        mean / records,
        low,
        high,
        fitted,
        curve.median,
        curve.dispersion,
        "; ".join(remarks),
        *_split_dispersion(curves),
    )


def _split_dispersion(fits: Sequence[LognormalFit]) -> tuple[float, float]:
    """Split the dispersion by the law of total variance, given the curve of each sample.

    Within a sample only the records differ; from sample to sample, the medians do. NaN where
    no more than half of the samples have a curve.
    """
    # Samples without a curve never or always exceed: without them, if they were many, the
    # dispersion would be too small.
    parameters = np.array([fit[:2] for fit in fits if np.isfinite(fit.median)])
    if len(parameters) <= len(fits) // 2:
        return np.nan, np.nan
    medians, dispersions = parameters.T
    return (dispersions**2).mean() ** 0.5, np.log(medians).std()
